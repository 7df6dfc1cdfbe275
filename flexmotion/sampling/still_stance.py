"""`StillStance`: pelvis and legs of a human that stands on both feet stay as they are.

The pelvis of a standing person moves by millimetres, and hardly more in a wave or a look around. A sampled pelvis
trembles: points of the legs jerked by 3 to 8 m/s³ in stands and gestures, those of people by .1 to .4. Nothing in the
words asks the legs to move, so that they come to rest once the human stands. In a gesture it stands as it does, but for
a pelvis that leans; in a stand it comes upright, since one that follows a bow would be bowed by 10 degrees for ever.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.sole import REACH
from flexmotion.human.kinematics import foot_points, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, LEG_JOINTS, SIDES
from flexmotion.sampling.settling import settled, stopped
from flexmotion.spatial.heading import heading
from flexmotion.spatial.tilt import lean_of
from flexmotion.spatial.transitions import decaying

Float = NDArray[np.float64]

SETTLING_S, UPRIGHT_S = 0.15, 0.4
"""Time constants with which they come to rest, and with which a pelvis comes upright [s]."""

SEEN = 4
"""Last known frames in which the human has to stand."""

SLOW, SLOW_TURN = 0.06, 0.25
"""Speeds below which pelvis and feet stand still [m/s], and the pelvis's turning [rad/s]: a human that sways is slower,
one that rises from a squat is faster."""

BENT, LEANING = np.radians(45.0), np.radians(12.0)
"""Knees that are bent further than this, and pelvises that lean further from that of the rest pose, are on their way
[rad]: no human stays in half a squat, or bowed. Knees of recorded people that stand are bent by up to 38°."""

BOWED = np.radians(16.0)
"""Trunks that lean by less than this over such a pelvis [rad] are not bowed: one of the recorded people stands with a
pelvis by 18° off the rest pose under a trunk that leans by 8°."""

SWAYING = 0.07
"""A pelvis that leans by more than this from that of the rest pose [rad] comes upright in a gesture, too."""

RESTED = 1e-4
"""Joints and pelvis that move by less in a frame rest [rad, m]."""

SUNK, ABOVE = 1e-3, 0.01
"""Heels and toes that are higher than the second, or under the floor, come down to it, or up [m]; as far as the first
off they stay. Left as they were after a step, heels stayed 3 cm in the floor, or over it."""

_LEGS = [JOINTS.index(f"{joint}_{side}") for side in SIDES for joint in LEG_JOINTS]
_KNEES = [JOINTS.index(f"knee_flexion_{side}") for side in SIDES]


@dataclass(frozen=True)
class StillStance:
    """How a human stands.

    Attributes:
        past: the last known frames, at least two.
        rest: orientation of the pelvis in a rest pose with its heading, w x y z, (4,).
        leans: how far the pelvis leans from there [rad].
        feet: heel and toe of both feet in the last known frame, in the world, (2, 2, 3) [m].
    """

    past: Motion
    rest: Float
    leans: float
    feet: Float

    @classmethod
    def of(cls, past: Motion, rest: Motion) -> StillStance | None:
        """That of a motion at its end; None: its human is on the move, or does not stand on both feet.

        Args:
            past: at least one frame.
            rest: a standing human, whose last frame counts.
        """
        last = past[max(0, len(past) - SEEN) :]
        if len(last) < 2 or (last.joints[-1, _KNEES] > BENT).any():
            return None
        # What takes least comes first: most that do not stand still are seen by their speed.
        seconds = (len(last) - 1) / last.fps
        turned = np.linalg.norm(last.root_quaternion[-1] - last.root_quaternion[0]) * 2.0
        moved = np.linalg.norm(last.root_position[-1] - last.root_position[0])
        if moved > SLOW * seconds or turned > SLOW_TURN * seconds:
            return None
        own = last.root_quaternion[-1]
        upright = _turned(rest.root_quaternion[-1], float(heading(own) - heading(rest.root_quaternion[-1])))
        leaning, straight = lean_of(np.array([own, upright]))
        leans = float(np.hypot(*(leaning - straight)))
        if leans > LEANING and _trunk_leans(last) > BOWED:
            return None
        feet = foot_points(last)
        if feet[..., 2].max() > REACH or np.ptp(feet, axis=0).max() > SLOW * seconds:
            return None
        return cls(last, upright if own @ upright > 0.0 else -upright, leans, feet[-1])

    @property
    def rests(self) -> bool:
        """Whether nothing moves any more, with both soles on the floor."""
        last = self.past[len(self.past) - 2 :]
        moved = max(np.ptp(last.joints[:, _LEGS], axis=0).max(), np.ptp(last.root_position, axis=0).max())
        return bool(moved < RESTED and np.abs(self.feet[..., 2] - self._on_floor).max() < SUNK)

    def places(self, frames: int) -> Float:
        """Where heel and toe of both feet are to be in a window after it: down to the floor, (T, 2, 2, 3) [m]."""
        found = np.tile(self.feet, (frames, 1, 1, 1))
        passed = np.arange(1, frames + 1)[:, None, None] / self.past.fps
        off = self.feet[..., 2] - self._on_floor
        found[..., 2] = self._on_floor + decaying(off, np.zeros_like(off), 1.0 / SETTLING_S, passed)
        return found

    @property
    def _on_floor(self) -> Float:
        """Heights of heels and toes on the floor, (2, 2) [m]."""
        found: Float = np.clip(self.feet[..., 2], 0.0, ABOVE)
        return found

    def kept(self, window: Motion, *, upright: bool) -> Motion:
        """A window after it whose pelvis and legs come to rest; place, speed and acceleration are continuous.

        Args:
            window: as sampled.
            upright: whether the pelvis comes to lean as in the rest pose; else it stays as it is.
        """
        joints = window.joints.copy()
        past, end = self.past, (len(window), window.fps)
        joints[:, _LEGS] = stopped(past.joints[:, _LEGS], *end, SETTLING_S)
        quaternion = (
            settled(past.root_quaternion, self.rest, *end, UPRIGHT_S)
            if upright
            else stopped(past.root_quaternion, *end, SETTLING_S)
        )
        return window.changed(
            joints=joints,
            root_position=stopped(past.root_position, *end, SETTLING_S),
            root_quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        )


def _trunk_leans(motion: Motion) -> float:
    """How far the trunk leans in the last frame [rad]."""
    return float(np.arccos(np.clip(forward(motion[len(motion) - 1 :]).torso_rotation[0, 2, 2], -1.0, 1.0)))


def _turned(quaternion: Float, yaw: float) -> Float:
    """A unit quaternion w x y z turned about the vertical by an angle [rad]."""
    (w, x, y, z), cosine, sine = quaternion, np.cos(yaw / 2.0), np.sin(yaw / 2.0)
    return np.array([cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w])
