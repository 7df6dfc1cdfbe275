"""A clip retargeted offline: its file, its quality, its torque."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console, RenderableType

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.human.motion import Motion
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.planning.offline import Trajectory, retarget_offline
from flexmotion.streamer.report.trajectory_file import write_trajectory
from flexmotion.streamer.report.trajectory_quality import quality, render_quality

from ..stub_sampler import StubSampler


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def motion() -> Motion:
    return choose_motion()


@pytest.fixture(scope="module")
def trajectory(robot: Robot, motion: Motion) -> Trajectory:
    return retarget_offline(robot, ClipSource(motion), load_stream())


def test_whole_clip_is_followed_and_ends_standing(trajectory: Trajectory, motion: Motion) -> None:
    followed = trajectory.source_s[np.isfinite(trajectory.source_s)]
    assert followed[-1] == pytest.approx(motion.duration, abs=0.05)
    assert trajectory.duration > motion.duration
    assert trajectory.contacts[-1].all()
    assert np.abs(trajectory.qd[-1]).max() < 0.05
    assert trajectory.steps >= trajectory.inserted
    assert trajectory.human_steps > 0


@pytest.mark.parametrize(("seconds", "length"), [(1e9, "is 1e\\+09 s long"), (None, "has no end")])
def test_a_source_that_is_too_long_is_refused(robot: Robot, seconds: float | None, length: str) -> None:
    """`check torque --seconds 1e9` took 12 GB in seven minutes and did not end."""
    source = ModelSource(StubSampler(), [Item(0.0, Text("stand still"))], "model:stub", seconds=seconds)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=f"model:stub: {length}, expected 1800 s at most"):
        retarget_offline(robot, source, load_stream())


def test_plans_join_without_a_jump(trajectory: Trajectory, robot: Robot) -> None:
    steps = np.abs(np.diff(trajectory.q, axis=0)) * trajectory.rate_hz
    assert (steps.max(axis=0) <= 1.5 * robot.no_load_speed).all()
    assert np.abs(np.diff(trajectory.base[:, :3], axis=0)).max() * trajectory.rate_hz < 0.5


def test_csv_round_trip(trajectory: Trajectory, robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    write_trajectory(file, trajectory, robot)
    header = file.read_text().splitlines()[0].split(",")
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    assert len(table) == len(trajectory)
    model_joints = [robot.model.joint(i).name for i in range(1, robot.model.njnt)]
    assert header[0] == "time_s"
    assert header[1 : 1 + robot.n] == model_joints
    knee = table[:, header.index("l_knee")]
    assert knee == pytest.approx(trajectory.q[:, robot.index("l_knee")], abs=1e-6)
    assert table[1, 0] == pytest.approx(1 / trajectory.rate_hz)
    assert set(np.unique(table[:, -2:])) <= {0.0, 1.0}


def test_npz_round_trip(trajectory: Trajectory, robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "motion.npz"
    write_trajectory(file, trajectory, robot)
    with np.load(file) as content:
        knee = list(content["joint_names"]).index("l_knee")
        assert content["joint_position"][:, knee] == pytest.approx(trajectory.q[:, robot.index("l_knee")])
        assert str(content["robot"]) == "op3"
        assert len({len(content[name]) for name in ("joint_torque", "base_quaternion", "zmp", "contact")}) == 1


def test_quality(trajectory: Trajectory, robot: Robot, motion: Motion) -> None:
    result = quality(trajectory, robot, motion)
    assert result.net_path_ratio is not None
    assert 0.4 < result.net_path_ratio < 1.2
    assert result.steps_planned == trajectory.steps
    assert result.torque.joint in robot.joint_names
    assert json.loads(result.json_text())["schema"] == "flexmotion.retarget/1"
    assert "net path" in text_of(render_quality(result))


def text_of(result: RenderableType) -> str:
    console = Console(width=120)
    with console.capture() as capture:
        console.print(result)
    return capture.get()
