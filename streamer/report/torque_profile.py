"""The human's torque beside the robot's, by joint and time.

Torques are compared as shares of weight times leg length, by which moments of bodies of different size scale (Hof,
*Scaling gait data to body size*, Gait & Posture 4, 1996): the relative effort of a joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import Robot
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, ROOT_DOFS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.metrics import RobotFigures

Float = NDArray[np.float64]

COUNTERPARTS = {
    "hip_yaw": "hip_rotation",
    "hip_roll": "hip_adduction",
    "hip_pitch": "hip_flexion",
    "knee": "knee_flexion",
    "ankle_pitch": "ankle_dorsiflexion",
    "sho_pitch": "shoulder_flexion",
    "sho_roll": "shoulder_adduction",
    "el": "elbow_flexion",
}
"""Part of the robot's chain -> the human's joint coordinate. A human's ankle does not roll in this skeleton."""
CHAINS = {"left_leg": "l", "right_leg": "r", "left_arm": "l", "right_arm": "r"}
SAMPLE_S = 0.032
"""Distance of the samples [s]."""
MEAN_S = 0.16
"""Both are averaged over this time before they are compared: a robot steps at moments of its own [s]."""
SHORTEST_S, LONGEST_S = 0.6, 120.0
"""Torques of a clip without any are computed where it is this long: filters need the one, the other takes 6 s [s]."""
STILL = 1e-4
"""A standard deviation below this is no motion that could correlate, relative effort [1]."""


@dataclass(frozen=True)
class JointProfile:
    """One joint of the robot and its counterpart.

    Attributes:
        human_joint: name of the human's joint coordinate.
        human, robot: relative effort over the samples: torque over weight times leg length, (K,).
        load: share of the servo's envelope, (K,).
        correlation: of both over time; None where one of them does not change.
    """

    human_joint: str
    human: Float
    robot: Float
    load: Float
    correlation: float | None


@dataclass(frozen=True)
class TorqueProfile:
    """The human's relative effort beside the robot's.

    Attributes:
        t: time of the samples on the robot's clock, (K,) [s].
        joints: by the robot's joint name, in the order of its chains.
        correlation: over all joints and samples together; None where it is not defined.
    """

    t: Float
    joints: dict[str, JointProfile]
    correlation: float | None


def torque_profile(record: RunTrace, robot: Robot, figures: RobotFigures, motion: Motion) -> TorqueProfile | None:
    """Compare the torques of a run with those of the human that it followed.

    Args:
        record: the run; compared are the ticks whose reference is the human's and whose torque is known.
        motion: its frame 0 is at source time 0. Its torques are computed where it has none.

    Returns:
        None where the robot's or the human's torques are not known.
    """
    torques = _human_torques(motion)
    torque = record.torque
    rows = np.flatnonzero(np.isfinite(record.source_s) & (record.source_s >= 0.0) & np.isfinite(torque).all(axis=1))
    rows = rows[:: max(round(SAMPLE_S * record.rate_hz), 1)]
    if torques is None or len(rows) < 2:
        return None
    human_unit = motion.body.mass * GRAVITY * motion.body.leg
    robot_unit = figures.weight * figures.leg_ratio * motion.body.leg
    frames = np.arange(len(motion)) / motion.fps
    load = Envelope.of(robot).load(torque, np.nan_to_num(record.qd))
    width = max(round(MEAN_S / SAMPLE_S), 1)
    joints: dict[str, JointProfile] = {}
    chains = robot.mapping.chains()
    for chain, side in CHAINS.items():
        for part, joint in robot.chain(chain).items() if chain in chains else ():
            if part not in COUNTERPARTS:
                continue
            name = f"{COUNTERPARTS[part]}_{side}"
            made = np.abs(torques[:, len(ROOT_DOFS) + JOINTS.index(name)]) / human_unit
            human = _mean(np.interp(record.source_s[rows], frames, made), width)
            own = _mean(np.abs(torque[rows, joint]) / robot_unit, width)
            joints[robot.joint_names[joint]] = JointProfile(
                name, human, own, load[rows, joint], _correlation(human, own)
            )
    every = [np.concatenate([getattr(one, who) for one in joints.values()]) for who in ("human", "robot")]
    return TorqueProfile(rows / record.rate_hz, joints, _correlation(*every))


def _human_torques(motion: Motion) -> Float | None:
    """Generalised forces of root and joints, (T, 32) [N, N·m]; None where they cannot be computed."""
    if motion.torques is not None:
        return motion.torques
    if not SHORTEST_S <= motion.duration <= LONGEST_S:
        return None
    # Its solvers take .2 s to load: only where torques have to be computed.
    from flexmotion.biomechanics.dynamics import dynamics

    return dynamics(motion).motion.torques


def _mean(values: Float, width: int) -> Float:
    """Mean over `width` samples around each, fewer at the ends."""
    ones = np.convolve(np.ones(len(values)), np.ones(width), mode="same")
    return np.convolve(values, np.ones(width), mode="same") / ones


def _correlation(one: Float, other: Float) -> float | None:
    """Pearson's correlation; None where one of them is constant."""
    if min(one.std(), other.std()) < STILL:
        return None
    return float(np.corrcoef(one, other)[0, 1])
