"""What counts as a wave, as a raised hand, as a velocity, as a sentence that is understood: for every benchmark."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.spatial.heading import continuous_matrix_heading
from flexmotion.text.phrases import STAND
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import sides

Float = NDArray[np.float64]

SIDES: dict[str, tuple[int, ...]] = {"left": (0,), "right": (1,), "both": (0, 1)}
"""Columns of the hands that a prompt names."""

SWINGS = 2
"""Reversals of a raised hand from which on it waves."""

SAME_MOTION = {"dash": "run", NOTHING: STAND}
"""Kinds of motion that count as another: confusing the two is no mistake."""


def reversals(signal: Float, reach: float) -> int:
    """Number of times that a signal, (T,), turns back by at least `reach`, after it moved as far towards there."""
    return sum(len(find_peaks(sign * signal, prominence=reach)[0]) for sign in (1, -1))


def waves(hand: Float, raised: NDArray[np.bool_], reach: float, fewest: int) -> bool:
    """Whether a hand moves to and fro while it is up.

    Args:
        hand: positions seen from the torso, (T, 3) [m].
        raised: whether the hand is up, (T,).
        reach: shortest movement between two reversals that counts [m].
        fewest: raised frames without which there is no wave.
    """
    up = hand[raised]
    return len(up) >= fewest and max(reversals(axis, reach) for axis in up.T) >= SWINGS


def frame_velocities(motion: Motion) -> Float:
    """Velocity along and across the heading [m/s], and of turning [rad/s], from frame to frame, (T - 1, 3)."""
    yaw = continuous_matrix_heading(Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_matrix())
    step, turn = np.diff(motion.root_position[:, :2], axis=0) * motion.fps, np.diff(yaw) * motion.fps
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    along = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
    across = np.cos(middle) * step[:, 1] - np.sin(middle) * step[:, 0]
    return np.stack([along, across, turn], axis=1)


def at_least(value: float, wanted: float) -> bool:
    """Whether a value reaches a signed limit, in the limit's direction."""
    return value >= wanted if wanted >= 0 else value <= wanted


def understood(meant: str, found: str) -> bool:
    """Whether a sentence that means one kind of motion was understood so; nothing known counts as standing still."""
    return SAME_MOTION.get(meant, meant) == SAME_MOTION.get(found, found)


def confuses_sides(meant: str, found: str) -> bool:
    """Whether a kind of motion of one side was understood as one of the other side."""
    return len(sides(meant) | sides(found)) == 2
