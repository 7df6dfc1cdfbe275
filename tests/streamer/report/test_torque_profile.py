"""The human's relative effort beside the robot's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS, ROOT_DOFS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.report.metrics import RobotFigures
from flexmotion.streamer.report.torque_profile import torque_profile

FPS, SECONDS = 30.0, 6.0


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


def effort(t: np.ndarray, phase: float = 0.0) -> np.ndarray:
    return 0.02 * (1.0 + np.sin(2 * np.pi * 0.5 * t + phase))


def person(joint: str, phase: float = 0.0) -> Motion:
    """A human whose one joint makes an effort."""
    frames = int(FPS * SECONDS)
    torques = np.zeros((frames, DOF_COUNT))
    motion = Motion(FPS, np.zeros((frames, 3)), np.tile([1.0, 0, 0, 0], (frames, 1)), np.zeros((frames, len(JOINTS))))
    unit = motion.body.mass * GRAVITY * motion.body.leg
    torques[:, len(ROOT_DOFS) + JOINTS.index(joint)] = -unit * effort(np.arange(frames) / FPS, phase)
    return replace(motion, torques=torques)


def ran(robot: Robot, joint: str, motion: Motion) -> RunTrace:
    """A run in which one joint makes the same effort, for the robot's size."""
    ticks = int((SECONDS - 0.1) * robot.rate_hz)
    record = RunTrace(robot.rate_hz, robot.joint_names)
    record.append(blank(TickRow.dtype(joints=robot.n), ticks))
    t = np.arange(ticks) / robot.rate_hz
    record.rows["tick"], record.rows["source_s"] = np.arange(ticks), t
    record.rows["true_torque"], record.rows["qd"] = 0.0, 0.0
    figures = RobotFigures.of(robot, motion.body.leg)
    unit = figures.weight * figures.leg_ratio * motion.body.leg
    record.rows["true_torque"][:, robot.index(joint)] = unit * effort(t)
    return record


@pytest.mark.parametrize(
    ("own", "human"), [("l_knee", "knee_flexion_l"), ("r_el", "elbow_flexion_r"), ("r_hip_roll", "hip_adduction_r")]
)
def test_equal_efforts_of_a_joint_and_its_counterpart(robot: Robot, own: str, human: str) -> None:
    motion = person(human)
    found = torque_profile(ran(robot, own, motion), robot, RobotFigures.of(robot, motion.body.leg), motion)
    assert found is not None
    joint = found.joints[own]
    assert joint.human_joint == human
    np.testing.assert_allclose(joint.human, joint.robot, atol=1e-3)
    assert joint.correlation == pytest.approx(1.0, abs=1e-3)
    assert found.correlation == pytest.approx(1.0, abs=1e-3)
    assert found.joints["l_hip_yaw"].correlation is None
    assert not any("ank_roll" in name or "head" in name for name in found.joints)


def test_an_effort_at_other_moments_does_not_correlate(robot: Robot) -> None:
    motion = person("knee_flexion_l", phase=np.pi / 2)
    found = torque_profile(ran(robot, "l_knee", motion), robot, RobotFigures.of(robot, motion.body.leg), motion)
    assert found is not None and found.joints["l_knee"].correlation == pytest.approx(0.0, abs=0.1)
    opposite = person("knee_flexion_l", phase=np.pi)
    found = torque_profile(ran(robot, "l_knee", opposite), robot, RobotFigures.of(robot, motion.body.leg), opposite)
    assert found is not None and found.joints["l_knee"].correlation == pytest.approx(-1.0, abs=0.05)


def test_unknown_torques_of_the_robot_or_of_too_short_a_clip(robot: Robot) -> None:
    motion = person("knee_flexion_l")
    record, figures = ran(robot, "l_knee", motion), RobotFigures.of(robot, motion.body.leg)
    assert torque_profile(record, robot, figures, replace(motion[:10], torques=None)) is None
    record.rows["true_torque"] = np.nan
    assert torque_profile(record, robot, figures, motion) is None


def test_torques_of_a_clip_are_computed_where_it_has_none(robot: Robot) -> None:
    """Standing on two legs, the hips and knees of a human bear part of its weight."""
    motion = choose_motion()[:60]
    assert motion.torques is None
    found = torque_profile(ran(robot, "l_knee", motion), robot, RobotFigures.of(robot, motion.body.leg), motion)
    assert found is not None
    assert 1e-4 < found.joints["l_hip_pitch"].human.mean() < 0.2


def test_report_and_page_have_it(outcome: Outcome, pictures: list[Path]) -> None:
    content = json.loads(outcome.report.json_text())["torque_profile"]
    assert set(content["joints"]["l_knee"]) == {"human_joint", "human", "robot", "peak_load", "correlation"}
    assert outcome.profile is not None
    assert len(outcome.profile.t) == len(outcome.profile.joints["l_knee"].human)
    assert "effort.png" in [picture.name for picture in pictures]
