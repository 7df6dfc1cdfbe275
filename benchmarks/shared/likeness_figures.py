"""How alike arms and trunk of an executed motion are: directions of segments, swings of their own, range of the bend.

Arm directions are compared in each one's own trunk frame (x forward, y left, z up along the torso): that is what the
joints of an arm can follow. What the trunk itself lacks (a bow that is not deep enough, a heading that lags) is
measured by its own figures and would otherwise count twice. Every sample counts, also those that no pose of the arm
reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.directions import angle, human_directions, pitch, robot_directions, trunk_of

Float = NDArray[np.float64]

SWING_S = 0.5
"""Length of the window in which a swing is looked for [s]."""
SWING_RAD = np.deg2rad(60.0)
"""A segment that turns by this much more than the human's within that window swings of its own accord."""
SWING_SLACK_S = 0.25
"""The human's movement is looked for in a window longer by this much at either end, so that lag is no swing [s]."""
RANGE_PERCENTILES = (2.0, 98.0)
"""The range of a channel is between these percentiles, so that one sample does not decide it."""
BENDING_DEG = 15.0
"""Range of pitch from which on a human bends [degrees]."""


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
    steps = angle(segments[1:], segments[:-1])
    path = np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])
    rows = np.arange(max(len(segments) - window, 1))
    end = np.minimum(rows + window + slack, len(path) - 1)
    found: Float = path[end] - path[np.maximum(rows - slack, 0)]
    return found


def pitch_range(tilt: Float) -> float:
    """Range of the trunk's pitch without its rare extremes [rad]."""
    low, high = np.percentile(tilt, RANGE_PERCENTILES)
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
    robot = robot_directions(chain, record.true_q[rows], trunk_of(record.true_base[rows], record.ticks.tilt[rows]))
    times = np.arange(len(motion)) / motion.fps
    human = human_directions(forward(motion)).at(times, record.source_s[rows])
    upper, fore = np.degrees(angle(robot.segments, human.segments).mean(axis=(0, 1)))
    return LikenessFigures(
        upper_arm_deg=float(upper),
        forearm_deg=float(fore),
        spurious_swings=spurious_swings(robot.segments, human.segments, record.rate_hz),
        pitch_range_deg=float(np.degrees(pitch_range(pitch(robot.trunk)))),
        human_pitch_range_deg=float(np.degrees(pitch_range(pitch(human.trunk)))),
        allowed_pitch_range_deg=float(np.degrees(pitch_range(np.clip(pitch(human.trunk), *pitch_bounds)))),
    )
