"""`HumanWindow`: features of the human motion that a plan is given."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.segment_motion import AT_REST
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.kinematics import FORWARD, HumanKinematics, forward, named_arrays
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import matrix_heading

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Swing:
    """A period in which a human foot carries no load.

    Attributes:
        side: 0 left, 1 right.
        lift_s, land_s: source time of lift-off and touch-down [s]; the window's edge where the event is outside it.
        landed: whether the touch-down is inside the window.
    """

    side: int
    lift_s: float
    land_s: float
    landed: bool


class HumanWindow:
    """Features of human motion over source time: kinematics, contacts, swings, yaws.

    Args:
        motion: the frames.
        start_s: source time of the first frame [s].
        detector_state: contact detector's state before the first frame.
        yaws: yaw of left foot, right foot and pelvis before the first frame, (3,) [rad]: angles are unwrapped
            from these on, so that they are continuous over windows. None: from the first frame.
    """

    def __init__(self, motion: Motion, start_s: float, detector_state: Float, yaws: Float | None) -> None:
        self.motion = motion
        self.times = start_s + np.arange(len(motion)) / motion.fps
        # Poses are laid out once, also for `limb_tension` of a motion with torques.
        names = FORWARD if motion.torques is None else (*FORWARD, *(name for name in AT_REST if name not in FORWARD))
        self.arrays = named_arrays(motion, names)
        self.kinematics: HumanKinematics = forward(motion, self.arrays)
        # Plausible ground forces show which foot is loaded better than heights and speeds of the feet.
        force = None if motion.wrenches is None else motion.wrenches[:, :, 2] / (motion.body.mass * GRAVITY)
        self.contacts, self.detector_states = ContactDetector().detect(
            self.kinematics, motion.fps, detector_state, force
        )
        kin = self.kinematics
        feet = 0.5 * (kin.heel + kin.toe)
        along = kin.toe - kin.heel
        yaw = np.column_stack([np.arctan2(along[:, :, 1], along[:, :, 0]), matrix_heading(kin.pelvis_rotation)])
        if yaws is not None:
            yaw = np.concatenate([yaws[None], yaw])
        self.yaws = np.unwrap(yaw, axis=0)[(yaws is not None) :]
        self.feet = np.concatenate([feet[:, :, :2], self.yaws[:, :2, None]], axis=2)
        self.swings = self._swings()

    @property
    def end_s(self) -> float:
        """Source time of the last frame [s]."""
        return float(self.times[-1])

    def _swings(self) -> list[Swing]:
        found = []
        half = 0.5 / self.motion.fps
        for side in range(len(SIDES)):
            free = np.concatenate([[False], ~self.contacts[:, side], [False]]).astype(int)
            edges = np.diff(free)
            for lift, land in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
                landed = bool(land < len(self.times))
                found.append(
                    Swing(
                        side,
                        float(self.times[lift] - (half if lift else 0.0)),
                        float(self.times[land] - half) if landed else self.end_s,
                        landed,
                    )
                )
        return sorted(found, key=lambda swing: swing.lift_s)

    def frame_before(self, seconds: Float) -> NDArray[np.int64]:
        """Index of the last frame at or before each time, clipped to the window."""
        return np.clip(np.searchsorted(self.times, seconds + 1e-9, side="right") - 1, 0, len(self.times) - 1)

    def at(self, values: Float, seconds: Float) -> Float:
        """Linear interpolation of per-frame `values` (F, ...) at source times (T,) [s], constant beyond the ends."""
        place = np.clip((seconds - self.times[0]) * self.motion.fps, 0.0, len(self.times) - 1)
        low = np.minimum(place.astype(int), max(len(self.times) - 2, 0))
        share = (place - low).reshape(-1, *[1] * (values.ndim - 1))
        return values[low] + share * (values[np.minimum(low + 1, len(values) - 1)] - values[low])

    def at_one(self, values: Float, second: float) -> Float:
        """What `at` gives for one time, (...): a tenth of its time, and the steps of a plan ask for some thirty."""
        last = len(self.times) - 1
        place = min(max((second - float(self.times[0])) * self.motion.fps, 0.0), float(last))
        low = min(int(place), max(last - 1, 0))
        found: Float = values[low] + (place - low) * (values[min(low + 1, last)] - values[low])
        return found

    def frames_between(self, start_s: float, end_s: float) -> slice:
        """The frames between two source times [s], those at the times included; may be none."""
        first, after = np.searchsorted(self.times, (start_s - 1e-9, end_s + 1e-9))
        return slice(int(first), int(after))

    def foot(self, side: int, second: float) -> Float:
        """Ground pose x, y, yaw of a foot, (3,) [m, m, rad]."""
        return self.at_one(self.feet[:, side], second)

    def place(self, side: int, second: float) -> Float:
        """Position of a foot on the ground, (2,) [m]: of one that swings, where it lands, if that is in the window."""
        for swing in self.swings:
            if swing.side == side and swing.landed and swing.lift_s <= second < swing.land_s:
                second = swing.land_s
        return self.foot(side, second)[:2]

    def left(self, side: int, second: float) -> Float:
        """Position of a foot on the ground, (2,) [m]: of one that swings, where it lifted, if that is in the window."""
        for swing in self.swings:
            if swing.side == side and swing.lift_s <= second < swing.land_s:
                second = swing.lift_s
        return self.foot(side, second)[:2]

    def mean_heading(self, start_s: float, end_s: float) -> float:
        """Mean yaw of the pelvis between two source times [rad]."""
        yaws = self.yaws[self.frames_between(start_s, end_s), 2]
        return float(yaws.mean() if len(yaws) else self.at_one(self.yaws[:, 2], end_s))

    def foot_height(self, side: int, start_s: float, end_s: float) -> float:
        """Greatest height of the foot between two source times, over its height at the first [m]."""
        height = 0.5 * (self.kinematics.heel[:, side, 2] + self.kinematics.toe[:, side, 2])
        first = float(self.at_one(height, start_s))
        return float(height[self.frames_between(start_s, end_s)].max(initial=first)) - first

    @cached_property
    def tilt(self) -> Float:
        """Roll (to the right positive) and pitch (forward positive) of the torso, (F, 2) [rad].

        Measured in the frame of the torso's heading: Euler angles flip where a human bows by more than 90 degrees.
        """
        torso = self.kinematics.torso_rotation
        yaw, up = matrix_heading(torso), torso[:, :, 2]
        cos, sin = np.cos(yaw), np.sin(yaw)
        forward, left = cos * up[:, 0] + sin * up[:, 1], cos * up[:, 1] - sin * up[:, 0]
        return np.column_stack([-np.arcsin(np.clip(left, -1.0, 1.0)), np.arctan2(forward, up[:, 2])])
