"""`ArmGuard`: keeps the forearms out of the body over all rows of a plan, with the legs where this plan has them.

`BodyClearance` counts the body where it is in the stand pose, at the frames of the human. Between two frames, and while
the filters lead an arm from one clip to another, a forearm can pass a thigh that walks. So the finished rows are
checked once more, and where a forearm comes too near the arm is led around: along the shortest way out, or, where its
path goes through a leg from one side to the other, outward. The addition to the joints' path is smooth and goes through
the same filter, within the same speed and acceleration.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, label, maximum_filter1d

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_distance import LEG, REST, Approach, ArmDistance

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_TOLERANCE = 0.2
"""Share of that distance that may be missing after the last round."""
_ROUNDS = 6
"""Linear steps of an addition at most. Most plans need none."""
_WAIT_S, _LONGEST_WAIT_S, _CATCH_UP_S = 0.12, 0.25, 0.7
"""Where an addition is too late, an arm waits for so much longer, at most so long, and has caught up by then [s]."""
_LONGEST = 0.4
"""Longest linear step of a joint [rad]."""
_STRIDE = 4
"""Every fourth row is checked: a forearm at 5 rad/s moves 2 cm between two of them, by which it comes 2 mm nearer to a
thigh than they tell."""
_EASE_S = 0.16
"""Time before a near row from which the arm begins to be led away, and after it until it is back [s]: .3 rad need 18
rad/s² at their most."""
_ONE_SIDE = 0.5
"""Least cosine between the ways out of one approach and their mean: with less the path goes through."""
_DAMPING = 1e-4
"""Added to a squared lever arm [m²]: bounds the angle of joints that hardly move the point."""

Followed = tuple[Float, Float, NDArray[np.bool_], NDArray[np.bool_]]
Follow = Callable[[Float], Followed]


class ArmGuard:
    """Checks and corrects the arms of one robot.

    Args:
        robot: the robot file; what has no collision shape is not kept clear of.
        chain: its arms.
        first: column of the first arm joint in the filter's channels; arms come in the order of `chain.joints`.
        omega: natural frequency of the filter of the arms [1/s].
    """

    def __init__(self, robot: Robot, chain: ArmChain, first: int, omega: float) -> None:
        self.distance, self.joints = ArmDistance(robot, chain), chain.joints
        self.omega, self._rate = omega, robot.rate_hz
        self._channels = slice(first, first + chain.joints.size)
        self._lower, self._upper = chain.lower.ravel(), chain.upper.ravel()

    def keep_clear(
        self, targets: Float, start: tuple[Float, Float], followed: Followed, q: Float, follow: Follow
    ) -> Followed | None:
        """The filtered channels with the arms led around the body; None where they are clear of it already.

        Args:
            targets: of the filter, (T, C).
            start: position and velocity of its channels before the first row, (C,) each.
            followed: what `follow` gave for them: positions, velocities and which bounds were active, (T, C) each.
            q: all joint angles with these positions, (T, n) [rad].
            follow: the filter.
        """
        rows, columns = np.arange(0, len(q), _STRIDE), self.joints.ravel()
        near = self.distance.nearest(q[rows])
        if not near.missing.any():
            return None
        q, outward, allowed = q.copy(), np.zeros(2, dtype=bool), _TOLERANCE * self.distance.kept
        wait = np.zeros(2)
        while True:
            plain = q[:, columns]
            for _ in range(_ROUNDS):
                led = q[:, columns] + self._addition(near, rows, len(q), outward)
                q[:, columns] = np.clip(led, self._lower, self._upper)
                near = self.distance.nearest(q[rows])
                if near.missing.max() <= allowed:
                    break
            followed = follow(self._led(self._later(targets, start, wait), q[:, columns] - plain))
            q[:, columns] = followed[0][:, self._channels]
            short = self.distance.nearest(q[rows]).missing.max(axis=(0, 1)) > allowed
            wait = np.where(short, wait + _WAIT_S, wait)
            if not short.any() or wait.max() > _LONGEST_WAIT_S:
                return followed
            # The way out takes longer than the arm is away: it waits before it goes on.
            q[:, columns] = follow(self._later(targets, start, wait))[0][:, self._channels]
            near = self.distance.nearest(q[rows])

    def _later(self, targets: Float, start: tuple[Float, Float], wait: Float) -> Float:
        """Targets (T, C) whose arms stop for a time each, (2,) [s], and then catch up."""
        if not wait.any():
            return targets
        line, count = np.arange(len(targets), dtype=float), self.joints.shape[1]
        # Where the filter comes to rest without turning back.
        rest = start[0] + start[1] * (2.0 / self.omega)
        targets = targets.copy()
        for side in np.flatnonzero(wait):
            late = line - wait[side] * self._rate * np.clip(1.0 - line / (_CATCH_UP_S * self._rate), 0.0, 1.0)
            first = self._channels.start + side * count
            for channel in range(first, first + count):
                targets[:, channel] = np.interp(late, line, targets[:, channel], left=rest[channel])
        return targets

    def _led(self, targets: Float, addition: Float) -> Float:
        """Targets for which the filter's output is greater by the addition, (T, 2m) [rad], in the arms."""
        speed = np.gradient(addition, 1.0 / self._rate, axis=0)
        bend = np.gradient(speed, 1.0 / self._rate, axis=0)
        targets = targets.copy()
        own = targets[:, self._channels] + addition + speed * (2.0 / self.omega) + bend / self.omega**2
        targets[:, self._channels] = np.clip(own, self._lower, self._upper)
        return targets

    def _addition(self, near: Approach, rows: Int, count: int, outward: NDArray[np.bool_]) -> Float:
        """Smooth addition to the arms' joints that clears the checked rows, (count, 2m) [rad].

        Args:
            outward: arms that go around a leg outward, (2,); set for an arm whose path goes through one.
        """
        needed = np.zeros((len(rows), *self.joints.shape))
        for side in (0, 1):
            for kind in (REST, LEG):
                missing, way = near.missing[kind, :, side], near.way[kind, :, side]
                if not missing.any():
                    continue
                if kind == LEG:
                    outward[side] |= _through(missing, way)
                    if outward[side]:
                        missing, way = near.aside[:, side], np.array([[0.0, 1.0 - 2.0 * side, 0.0]])
                slope = np.sum(near.lever[kind, :, side] * way[:, None], axis=-1)
                needed[:, side] += slope * (missing / (np.sum(slope * slope, axis=1) + _DAMPING))[:, None]
        np.clip(needed, -_LONGEST, _LONGEST, out=needed)
        needed = needed.reshape(len(rows), -1)
        # Each way by itself: its greatest value within the ease, then the mean over the ease.
        span = 2 * round(_EASE_S * self._rate / _STRIDE) + 1
        most = [maximum_filter1d(np.maximum(way, 0.0), span, axis=0, mode="nearest") for way in (needed, -needed)]
        line = np.arange(count) / _STRIDE
        low = np.minimum(line.astype(int), len(rows) - 1)
        high, share = np.minimum(low + 1, len(rows) - 1), (line - low)[:, None]
        even = most[0] - most[1]
        every = even[low] + share * (even[high] - even[low])
        window = np.hanning(2 * round(_EASE_S * self._rate) + 1)
        smooth: Float = convolve1d(every, window / window.sum(), axis=0, mode="nearest")
        return smooth


def _through(missing: Float, way: Float) -> bool:
    """Whether any stretch of rows that lacks distance, (R,) [m], has ways out, (R, 3), to opposite sides."""
    spans, found = label(missing > 0.0)
    for span in range(1, found + 1):
        ways = way[spans == span]
        mean = ways.mean(axis=0)
        if (ways @ mean).min() < _ONE_SIDE * float(np.linalg.norm(mean)):
            return True
    return False
