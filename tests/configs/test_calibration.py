from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.calibration import (
    FILE,
    CalibratedImu,
    CalibratedJoint,
    Calibration,
    read_calibration,
    write_calibration,
)
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import ROBOTS, load_robot


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))


def calibration(joint: str = "l_knee", *, servo: str = "XM430-W350", id_: int = 14) -> Calibration:
    return Calibration(date="2026-01-01T00:00:00+00:00", joints={joint: CalibratedJoint(zero=0.1, servo=servo, id=id_)})


def test_a_robot_is_loaded_with_its_calibration(folder: Path) -> None:
    plain = load_robot(folder)
    write_calibration(folder, calibration())
    assert read_calibration(folder) == calibration()
    robot = load_robot(folder)
    knee = robot.index("l_knee")
    assert robot.zero[knee] == 0.1 and np.delete(robot.zero, knee).max() == 0
    shift = robot.to_ticks(robot.stand_pose) - plain.to_ticks(plain.stand_pose)
    assert shift[knee] == pytest.approx(0.1 / robot.tick_rad[knee], abs=1)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (calibration("l_kne"), "unknown joint 'l_kne', calibrate again"),
        (calibration(id_=15), r"was calibrated with XM430-W350 \(id 15\), .* has XM430-W350 \(id 14\)"),
    ],
)
def test_a_calibration_of_another_robot_is_refused(folder: Path, wrong: Calibration, says: str) -> None:
    write_calibration(folder, wrong)
    with pytest.raises(ConfigError, match=says):
        load_robot(folder)


def test_an_imu_is_mounted_as_calibrated_and_another_is_refused(folder: Path) -> None:
    sits = CalibratedImu(quaternion=(0.0, 1.0, 0.0, 0.0), driver="opencr")
    write_calibration(folder, calibration().model_copy(update={"imu": sits}))
    imu = load_robot(folder).config.imu
    assert imu is not None and imu.quaternion == (0.0, 1.0, 0.0, 0.0)
    write_calibration(folder, calibration().model_copy(update={"imu": sits.model_copy(update={"driver": "witmotion"})}))
    with pytest.raises(ConfigError, match="calibrated with driver 'witmotion', the robot file has 'opencr': calibrate"):
        load_robot(folder)


def test_a_calibration_cut_short_is_refused(folder: Path) -> None:
    """Regression: a file cut after its date counted as one without joints, and every zero was 0 again."""
    (folder / FILE).write_text("date: '2026-01-01T00:00:00+00:00'\n")
    with pytest.raises(ConfigError, match="joints"):
        load_robot(folder)


def test_a_calibration_that_cannot_be_written_leaves_the_old_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: a full disk during the write destroyed the old zeros."""
    write_calibration(folder, calibration())

    def full(_number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError, match="cannot be written: No space left on device"):
        write_calibration(folder, calibration().model_copy(update={"date": "2027-01-01T00:00:00+00:00"}))
    assert read_calibration(folder) == calibration()
    assert [path.name for path in folder.glob("calibration*")] == [FILE]
