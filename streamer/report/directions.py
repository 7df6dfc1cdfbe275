"""Likeness of arms and trunk: directions of the segments of the executed motion against the human's.

Arm directions are compared in each one's own trunk frame (x forward, y left, z up along the torso): that is what the
joints of an arm can follow. What the trunk itself lacks (a bow that is not deep enough, a heading that lags) is
measured by its own figures and would otherwise count twice. Every sample counts, also those that no pose of the arm
reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.spatial.rotations import matrices
from flexmotion.streamer.control.run_trace import RunTrace

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

SWING_S = 0.5
"""Length of the window in which a swing is looked for [s]."""
SWING_RAD = np.deg2rad(60.0)
"""A segment that turns by this much more than the human's within that window swings of its own accord."""
SWING_SLACK_S = 0.25
"""The human's movement is looked for in a window longer by this much at either end, so that lag is no swing [s]."""
RANGE_PERCENTILES = (2.0, 98.0)
"""The range of a channel is between these percentiles, so that one sample does not decide it."""


@dataclass(frozen=True)
class SegmentDirections:
    """Directions of the arms' segments in the trunk frame, and the trunk's own tilt.

    Attributes:
        segments: unit vectors of upper arm and forearm, (T, 2 sides, 2 segments, 3).
        pitch: tilt of the torso in its heading's frame, forward positive, (T,) [rad].
    """

    segments: Float
    pitch: Float

    @classmethod
    def of_human(cls, human: HumanKinematics) -> SegmentDirections:
        """Of every frame of a motion; the forearm ends at the fist."""
        torso = human.torso_rotation[:, None, None].swapaxes(-1, -2)
        along = np.stack([human.elbow - human.shoulder, human.hand - human.elbow], axis=2)
        return cls(_unit((torso @ along[..., None])[..., 0]), torso_pitch(human.torso_rotation))

    @classmethod
    def of_robot(cls, chain: ArmChain, base: Float, q: Float) -> SegmentDirections:
        """Of torso poses (T, 7) and joint angles (T, n) [rad]."""
        poses = chain.poses(q[:, chain.joints])
        return cls(np.stack([poses.upper, poses.fore], axis=2), torso_pitch(matrices(base[:, 3:])))

    def at(self, times: Float, wanted: Float) -> SegmentDirections:
        """Linear interpolation from ascending times (T,) to wanted times (K,) [s], constant beyond the ends."""
        place = np.interp(wanted, times, np.arange(len(times)))
        low = np.minimum(place.astype(int), max(len(times) - 2, 0))
        share = (place - low)[:, None, None, None]
        high = np.minimum(low + 1, len(times) - 1)
        segments = _unit((1.0 - share) * self.segments[low] + share * self.segments[high])
        return SegmentDirections(segments, np.interp(wanted, times, self.pitch))


def torso_pitch(rotation: Float) -> Float:
    """Forward tilt of torsos (T, 3, 3) seen from the side, positive forward, (T,) [rad]."""
    up, front = rotation[:, :, 2], rotation[:, :2, 0]
    # A torso that is bent by 90 degrees looks down: its heading is then where its up axis points.
    heading = np.where((rotation[:, 2, 2] > 0.0)[:, None], front, up[:, :2])
    heading = heading / np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)
    return np.arctan2(np.sum(up[:, :2] * heading, axis=1), up[:, 2])


def direction_errors(robot: Float, human: Float) -> Float:
    """Angles between unit vectors (..., 3), (...) [rad]."""
    return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(robot - human, axis=-1), 0.0, 1.0))


def spurious_swings(robot: Float, human: Float, rate_hz: float) -> int:
    """Number of swings of a robot's arms that the human's do not make.

    A swing is a time in which a segment turns through an angle that is `SWING_RAD` greater within `SWING_S` than that
    of either segment of the human's arm in a slightly longer time. Segments of one arm that swing together count once.

    Args:
        robot, human: unit vectors of each segment, (T, 2 sides, 2 segments, 3), one row a tick.
        rate_hz: rows a second.
    """
    window, slack = round(SWING_S * rate_hz), round(SWING_SLACK_S * rate_hz)
    if len(robot) < 2:
        return 0
    own, humans = _turned(robot, window, 0), _turned(human, window, slack)
    swings = own.max(axis=2) > humans.max(axis=2) + SWING_RAD
    begins = swings & ~np.concatenate([np.zeros((1, 2), bool), swings[:-1]])
    return int(begins.sum())


def _turned(segments: Float, window: int, slack: int) -> Float:
    """Angle through which each segment turns within the window after each row, longer by slack at both ends."""
    steps = direction_errors(segments[1:], segments[:-1])
    path = np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])
    rows = np.arange(max(len(segments) - window, 1))
    end = np.minimum(rows + window + slack, len(path) - 1)
    found: Float = path[end] - path[np.maximum(rows - slack, 0)]
    return found


def pitch_range(pitch: Float) -> float:
    """Range of the trunk's pitch without its rare extremes [rad]."""
    low, high = np.percentile(pitch, RANGE_PERCENTILES)
    return float(high - low)


@dataclass(frozen=True)
class LikenessFigures:
    """How alike arms and trunk of the executed motion are. Units are in the names.

    Attributes:
        upper_arm_deg, forearm_deg: mean direction errors over both sides and all ticks that follow the human.
        spurious_swings: see `spurious_swings`.
        pitch_range_deg, human_pitch_range_deg: range of the trunk's pitch.
        allowed_pitch_range_deg: range of the human's pitch within the bounds of what the robot's balance allows.
    """

    upper_arm_deg: float
    forearm_deg: float
    spurious_swings: int
    pitch_range_deg: float
    human_pitch_range_deg: float
    allowed_pitch_range_deg: float

    @property
    def pitch_share(self) -> float | None:
        """Range of the trunk's pitch over the range that balance allows; None for a human who hardly bends."""
        if self.allowed_pitch_range_deg < BENDING_DEG:
            return None
        return self.pitch_range_deg / self.allowed_pitch_range_deg


BENDING_DEG = 15.0
"""Range of pitch from which on a human bends [degrees]."""


def likeness_figures(
    record: RunTrace, chain: ArmChain, motion: Motion, pitch_bounds: tuple[float, float]
) -> LikenessFigures | None:
    """Figures of a simulated run that followed a motion from its first frame.

    Args:
        record: with the true motion of the robot.
        motion: all of the human's.
        pitch_bounds: least and greatest pitch of the trunk that balance allows [rad].

    Returns:
        None without true motion of the robot, as on hardware.
    """
    known = np.isfinite(record.source_s) & (record.source_s >= 0.0) & np.isfinite(record.true_base).all(axis=1)
    rows = np.flatnonzero(known)
    if not len(rows):
        return None
    robot = SegmentDirections.of_robot(chain, record.true_base[rows], record.true_q[rows])
    times = np.arange(len(motion)) / motion.fps
    human = SegmentDirections.of_human(forward(motion)).at(times, record.source_s[rows])
    upper, fore = np.degrees(direction_errors(robot.segments, human.segments).mean(axis=(0, 1)))
    return LikenessFigures(
        upper_arm_deg=float(upper),
        forearm_deg=float(fore),
        spurious_swings=spurious_swings(robot.segments, human.segments, record.rate_hz),
        pitch_range_deg=float(np.degrees(pitch_range(robot.pitch))),
        human_pitch_range_deg=float(np.degrees(pitch_range(human.pitch))),
        allowed_pitch_range_deg=float(np.degrees(pitch_range(np.clip(human.pitch, *pitch_bounds)))),
    )


def _unit(vectors: Float) -> Float:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
