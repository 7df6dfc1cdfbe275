"""`Obedience`: whether servos do what their goals ask, by what the servo plant predicts.

A position servo with goal g makes the torque kp (g - q) - b q'. If the load is `tau`, the joint therefore moves towards
g - tau / kp with the time constant b / kp. A joint that is elsewhere carries another load than planned: kp times the
distance, times the share of the stiffness with which it follows. Where that is most of what the servo can give, and
stays, the joint is blocked, or its servo does not act on the goals (`drivers/plant.py` has the same equations). Goals
are bounded to the torque that the servo has, so that a joint which follows with less than `SHARE` of its stiffness is
never found by this: it presses softly, and may be held. Where its goals lead it on, `Stillness` finds it. A joint
on its way to where the goals lead obeys them: an arm that is raised fast lags for half a second by as much as a blocked
one. Whether it is on its way is judged by the change of its position: what a servo reports as its speed may be wrong.

A slow bus reads its servos in turns and sends them goals in turns: a position is then some ticks old, and belongs to
one of the predictions of that time. Its joint is judged by the nearest of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.masks import every, some
from flexmotion.streamer.control.stillness import Stillness

Float = NDArray[np.float64]

SHARE = 0.6
"""Unplanned load that counts, over the servo's usable torque."""
PATIENCE_S = 0.5
"""Time for which it may last [s]; time without counts against it."""
CLOSING_SHARE, CLOSING_S = 0.06, 0.1
"""Speed towards its prediction from which a joint is on its way, over its servo's no-load speed, and the time over
which it is measured [s], longer where servos are read in turns. A servo whose load leaves it a twentieth of its speed
carries nearly all that it can; in 0.1 s the joint then moves by many units of its position and more than its play."""


class Obedience:
    """Follows every joint's prediction, tick by tick; allocates nothing that grows.

    Args:
        turns: ticks within which every joint is read, and is sent its goal.

    Attributes:
        predicted: where the goals should have brought the joints, (n,) [rad].
        load: unplanned load over the usable torque, (n,).
        overdue: time for which it was too large, (n,) [s].
    """

    def __init__(self, robot: Robot, turns: int = 1) -> None:
        self.robot = robot
        self._keeps = np.exp(-robot.kp / robot.back_emf / robot.rate_hz)
        self.predicted, self.load = np.zeros(robot.n), np.zeros(robot.n)
        self.overdue = np.zeros(robot.n)
        span = max(round(CLOSING_S * robot.rate_hz), turns)
        self._closing = CLOSING_SHARE * robot.no_load_speed * span / robot.rate_hz
        # Of the last ticks, in turns.
        self._positions, self._predictions = np.zeros((span, robot.n)), np.zeros((turns, robot.n))
        self._place = 0
        self._stillness = Stillness(robot, turns)
        self._aim, self._moved, self._away = np.zeros(robot.n), np.zeros(robot.n), np.zeros(robot.n)
        self._any_overdue = False

    @property
    def blocked(self) -> int | None:
        """The joint that stands still while its goals lead it on; None while all move."""
        return self._stillness.worst

    @property
    def worst(self) -> int | None:
        """The joint whose servo does not follow its goals; None while all do."""
        blocked = self.blocked
        if blocked is not None or not self._any_overdue:
            return blocked
        joint = int(np.argmax(self.overdue))
        return joint if self.overdue[joint] > PATIENCE_S else None

    def describe(self, joint: int) -> str:
        """What is wrong with a joint, for messages."""
        if joint == self.blocked:
            return f"it stands still while they lead it by {self._stillness.span[joint]:.2f} rad: it is blocked"
        return f"{abs(self._away[joint]):.2f} rad from where they lead, or it is blocked"

    def reset(self, position: Float) -> None:
        """Begin with joints at `position`, (n,) [rad]."""
        for row in (self.predicted, *self._positions, *self._predictions):
            np.copyto(row, position)
        self._stillness.reset(position)
        self.load[:] = self.overdue[:] = 0.0
        self._any_overdue = False

    def update(self, goal: Float, torque: Float, position: Float, known: NDArray[np.bool_], share: Float) -> None:
        """One tick.

        Args:
            goal: in effect since the last tick, of a joint that follows softly the stiff one, (n,) [rad].
            torque: planned load, (n,) [N·m].
            position: measured last, (n,) [rad].
            known: joints whose position was measured; the others are not judged.
            share: of its stiffness with which each joint follows, (n,) in (0, 1].
        """
        robot, dt = self.robot, 1.0 / self.robot.rate_hz
        aim, predicted, load, away = self._aim, self.predicted, self.load, self._away
        np.divide(torque, robot.kp, out=aim)
        np.subtract(goal, aim, out=aim)
        predicted -= aim
        predicted *= self._keeps
        predicted += aim
        self._stillness.update(position, predicted, goal, known, share)
        self._place += 1
        np.copyto(self._predictions[self._place % len(self._predictions)], predicted)
        before = self._positions[self._place % len(self._positions)]
        np.subtract(position, before, out=self._moved)
        np.copyto(before, position)
        if len(self._predictions) == 1:
            np.subtract(position, predicted, out=away)
        else:
            nearest = np.clip(position, self._predictions.min(axis=0), self._predictions.max(axis=0))
            np.subtract(position, nearest, out=away)
        np.multiply(away, robot.kp, out=load)
        load *= share  # a joint that follows softly makes so much less torque
        load /= robot.usable_torque
        if not every(known):
            np.copyto(load, 0.0, where=~known)
        heavy = np.abs(load) > SHARE
        if not some(heavy) and not self._any_overdue:
            return
        late = heavy & ~(-np.sign(load) * self._moved > self._closing)
        self.overdue += np.where(late, dt, -0.5 * dt)
        np.clip(self.overdue, 0.0, 2 * PATIENCE_S, out=self.overdue)
        self._any_overdue = bool(self.overdue.any())
