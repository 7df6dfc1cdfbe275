"""A motion for identification ends with torque off, whatever happens, and says what happened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.emulator.faults import Fault, FaultKind
from flexmotion.drivers.identification.excitation import plan
from flexmotion.drivers.identification.experiment import Experiment
from flexmotion.drivers.identification.limb import Limb
from flexmotion.drivers.identification.record import new_angles

from .stand import Stand, plain_copy

KNEE_ID = 14


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def stand(op3: Robot) -> Stand:
    return Stand.of(op3, op3)


def test_the_motion_stays_within_what_was_announced(op3: Robot, stand: Stand) -> None:
    knee = op3.index("l_knee")
    planned = stand.plan("l_knee")
    record = stand.experiment().run(planned)
    assert stand.limp and stand.body.receiver.violations == 0
    angle = record.position[:, knee]
    assert planned.lowest - 0.03 < angle.min() and angle.max() < planned.highest + 0.03
    assert planned.speed * planned.reach <= 0.25 and planned.torque <= 0.6 * op3.usable_torque[knee]
    assert np.abs(np.gradient(angle, record.time)).max() < 1.25 * planned.speed
    others = np.delete(np.ptp(record.position, axis=0), knee)
    assert others.max() < 0.05  # they hold
    assert planned.start < op3.lower[knee]  # limp, the knee hangs past its limit; it is brought back to that
    assert stand.body.position[knee] == pytest.approx(op3.lower[knee], abs=0.05)
    assert stand.driver.violations == 0


def test_a_blocked_joint_ends_it(stand: Stand, op3: Robot) -> None:
    planned = stand.plan("l_knee")
    stand.body.block(op3.index("l_knee"), True)
    with pytest.raises(DriverError, match=r"l_knee \(id 14\): is .* rad from its goal .* blocked, at a stop"):
        stand.experiment().run(planned)
    assert stand.limp


def test_a_stop_in_its_way_ends_it(stand: Stand, op3: Robot) -> None:
    """A stop that the robot file does not know."""
    planned = stand.plan("l_knee")
    model = stand.body.driver.model
    joint = model.joint("l_knee").id
    model.jnt_limited[joint] = True
    model.jnt_range[joint] = (-1.0, planned.centre + 0.1)
    with pytest.raises(DriverError, match=r"l_knee \(id 14\): is .* at a stop"):
        stand.experiment().run(planned)
    assert stand.limp


def test_a_limb_heavier_than_its_file_ends_it(stand: Stand, op3: Robot) -> None:
    planned = stand.plan("l_hip_pitch")
    model = stand.body.driver.model
    for body in ("l_ank_roll_link", "l_ank_pitch_link"):
        model.body_mass[model.body(body).id] *= 25
    with pytest.raises(DriverError, match=r"l_hip_pitch \(id 12\): .* planned were"):
        stand.experiment().run(planned)
    assert stand.limp


def test_a_servo_that_falls_silent_ends_it(op3: Robot, stand: Stand) -> None:
    planned = stand.plan("l_knee")
    stand.world.emulator.faults.append(Fault(FaultKind.DEAD, KNEE_ID, at=2.0))
    with pytest.raises(
        DriverError,
        match=r"l_knee \(id 14\): has not answered for 6 reads; nothing was stored, torque off is "
        r"not confirmed by: l_knee \(id 14\): switch the power off",
    ):
        stand.experiment().run(planned)
    enabled = stand.body.plant.enabled.copy()
    enabled[op3.index("l_knee")] = False  # it heard nothing
    assert not enabled.any()


def test_a_servo_that_overheats_ends_it(stand: Stand) -> None:
    planned = stand.plan("l_knee")
    stand.world.emulator.faults.append(Fault(FaultKind.OVERHEAT, KNEE_ID, at=1.0))
    with pytest.raises(DriverError, match=r"l_knee \(id 14\): (reports hardware error|has 85 °C).*torque is off"):
        stand.experiment().run(planned)
    assert stand.limp


def test_a_servo_that_is_read_in_turns_is_measured_when_its_angle_changes() -> None:
    """An LX-16A is read in every twentieth tick; its last angle was taken for a measurement of all of them."""
    position = np.array([[1.0], [1.0], [1.1], [1.1], [np.nan], [1.2]])
    answered = np.ones((6, 1), np.bool_)
    assert new_angles(position, answered, 1)[:, 0].tolist() == [True, True, True, True, False, True]
    assert new_angles(position, answered, 20)[:, 0].tolist() == [True, False, True, False, False, True]


def test_an_operator_ends_it(stand: Stand) -> None:
    planned, ticks = stand.plan("l_knee"), iter(range(10_000))
    experiment = stand.experiment()
    stopping = Experiment(
        stand.driver, bus_s=0.0, clock=experiment._clock, sleep=experiment._sleep, stopped=lambda: next(ticks) > 200
    )
    with pytest.raises(KeyboardInterrupt):
        stopping.run(planned)
    assert stand.limp


def test_a_robot_that_was_moved_after_the_announcement_is_left_alone(stand: Stand) -> None:
    planned = stand.plan("l_knee")
    elsewhere = replace(planned, pose=planned.pose + 0.3)
    with pytest.raises(DriverError, match="has been moved"):
        stand.experiment().run(elsewhere)
    assert stand.limp


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"amplitude": 1.5}, "l_knee.*amplitude 1.5 rad: expected 0.12 to"),
        ({"amplitude": 0.05}, "l_knee.*amplitude 0.05 rad: expected 0.12 to"),
        ({"up": np.array([60.0, 0.0, 60.0])}, "l_knee.*its limb weighs .* N·m on it, by the masses of the robot file"),
    ],
)
def test_a_motion_without_room_or_with_too_much_weight_is_refused(
    op3: Robot, change: dict[str, object], message: str
) -> None:
    with pytest.raises(DriverError, match=message):
        plan(op3, op3.index("l_knee"), op3.stand_pose, **change)  # type: ignore[arg-type]


def test_a_limb_between_others_is_refused(op3: Robot, spoilt: Callable[[str, list[float]], Robot]) -> None:
    narrow = spoilt("l_knee", [0.7, 0.9])
    with pytest.raises(DriverError, match=r"l_knee .id 14.: may move from .* bring the other joints out of its way"):
        plan(narrow, narrow.index("l_knee"), narrow.stand_pose)


def test_the_range_keeps_clear_of_the_robots_own_body(op3: Robot) -> None:
    """Arms hang beside the torso: the shoulder's limits reach through it."""
    planned = plan(op3, op3.index("l_sho_roll"), op3.stand_pose)
    pose = op3.stand_pose.copy()
    limb = Limb(op3, op3.index("l_hip_roll"))
    low, high = limb.free_range(pose)
    assert op3.lower[op3.index("l_hip_roll")] <= low < high
    assert high < op3.upper[op3.index("l_hip_roll")] - 0.05  # the other leg is before the limit
    assert planned.highest <= op3.upper[op3.index("l_sho_roll")]


@pytest.fixture
def spoilt(tmp_path: Path) -> Callable[[str, list[float]], Robot]:
    """Call with a joint and its limits: OP3 with these limits."""

    def make(joint: str, limits: list[float]) -> Robot:
        folder = plain_copy(tmp_path)
        content = yaml.safe_load((folder / "op3.yaml").read_text())
        next(each for each in content["joints"] if each["name"] == joint)["limits"] = limits
        content["rest_pose"]["l_knee"] = 0.8
        (folder / "op3.yaml").write_text(yaml.safe_dump(content))
        return load_robot(folder)

    return make
