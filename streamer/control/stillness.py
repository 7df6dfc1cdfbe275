"""`Stillness`: joints that stand still although their goals lead them on.

A joint that stands still while it should move, without a block, carries a load that changes by exactly as much as the
torque of its servo, tick by tick. That happens for moments, where a foot strikes or a joint begins to move, and within
dry friction. A joint that has stood still while its prediction moved by `FAR_SHARE` of its servo's usable torque and
the servo made as much torque, and that goes on standing still for `STILL_S` in which the prediction is elsewhere, is
blocked. A prediction that went out and came back before the joint could follow asks for no motion any more, and is
forgotten after `RETURNED_S`. This tells a blocked joint from a loaded one long before the load itself does: what a goal
implies is bounded at the joint's position, so that a blocked joint whose plan carries a load never seems overloaded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.masks import every, some

Float = NDArray[np.float64]

FAR_SHARE = 0.4
"""Torque over the servo's usable torque: that the motion of a prediction implies, and that the servo makes with a goal
so far from its joint; dry friction in both directions comes on top."""
SLIP, SLIP_TICKS = 0.1, 2
"""A joint that moves less than this share of what its prediction does, and servo units, stands still."""
LEAST_TICKS = 20
"""Least of these motions and distances, for a servo of any stiffness: ten times what counts as standing still [servo
units]."""
STILL_S = 0.15
"""Time for which a joint must go on standing still after its prediction has moved so far, counted while the prediction
is at least half as far from the joint [s]: 3.3 times the time constant b / kp of OP3's servos. OP3 without a blocked
joint, with its standard perturbations: at most a third of it, in shoulders that are set in motion. The time constant of
a joint that follows with a share of its stiffness is longer by 1 over that share, and so is this time. Where joints
are read in turns, a turn counts on after the prediction is back: a joint that swings once between two readings, all the
time (2.5 to 3 Hz where every twentieth tick reads it), is called blocked, and that one is stopped."""

RETURNED_S = 0.5
"""Time for which a prediction must be back at its joint, for what it was before to be forgotten [s], and a turn more
where joints are read in turns: half a second of walking, whose joints swing to and fro once in it. A joint that is held
goes on being led away."""


class Stillness:
    """Follows every joint and its prediction, tick by tick; allocates nothing that grows.

    Args:
        turns: ticks within which every joint is read once, and is sent its goal.

    Attributes:
        span: by how much each joint should have moved since it stands still, (n,) [rad].
    """

    def __init__(self, robot: Robot, turns: int = 1) -> None:
        n = robot.n
        friction = np.array([servo.frictionloss for servo in robot.servos])
        needed = (FAR_SHARE * robot.usable_torque + 2 * friction) / robot.kp
        self._far = np.maximum(needed, LEAST_TICKS * robot.tick_rad)
        self._slip = SLIP_TICKS * robot.tick_rad
        # Where joints are read in turns, a position and what it was moved by are up to two turns apart: a joint may
        # have been away and back in one of them, and for another it is not known that its prediction is back.
        self._turns = turns
        self._patience = round(STILL_S * robot.rate_hz) + (2 * turns if turns > 1 else 0)
        self._where, self._away, self.span = np.zeros(n), np.zeros(n), np.zeros(n)
        # Of the prediction, and of the goal, beginning at the joint.
        self._led, self._lowest, self._highest, self._spans = (np.zeros((2, n)) for _ in range(4))
        self._late, self._any_late = np.zeros(n), False  # in ticks of a stiff joint
        self._returned, self._returned_for = np.zeros(n, np.intp), turns + round(RETURNED_S * robot.rate_hz)  # in ticks

    @property
    def worst(self) -> int | None:
        """The joint that stands still for longest; None while none does for too long."""
        if not self._any_late:
            return None
        joint = int(np.argmax(self._late))
        return joint if self._late[joint] > self._patience else None

    def reset(self, position: Float) -> None:
        """Begin with joints and predictions at `position`, (n,) [rad]."""
        for values in (self._where, self._lowest, self._highest):
            np.copyto(values, position)
        self.span.fill(0.0)
        self._late.fill(0.0)
        self._returned.fill(0)
        self._any_late = False

    def update(self, position: Float, predicted: Float, goal: Float, known: NDArray[np.bool_], share: Float) -> None:
        """One tick.

        Args:
            position: measured last, (n,) [rad].
            predicted: where the goals should have brought the joints, (n,) [rad].
            goal: in effect since the last tick, (n,) [rad].
            known: joints whose position was measured; the others are not judged.
            share: of its stiffness with which each joint follows, (n,) in (0, 1].
        """
        away, span, led, lowest, highest = self._away, self.span, self._led, self._lowest, self._highest
        np.subtract(position, self._where, out=away)
        np.abs(away, out=away)
        moves = away > SLIP * span + self._slip
        if not every(known):
            moves |= ~known
        if some(moves):
            self._begin(moves, position, predicted)
        led[0], led[1] = predicted, goal
        np.minimum(lowest, led, out=lowest)
        np.maximum(highest, led, out=highest)
        np.subtract(highest, lowest, out=self._spans)
        np.minimum(self._spans[0], self._spans[1], out=span)
        late = span > self._far
        if not some(late) and not self._any_late:
            return
        np.subtract(position, predicted, out=away)
        np.abs(away, out=away)
        gone = away > 0.5 * self._far
        self._returned += 1
        self._returned[gone | ~late] = 0
        np.add(self._late, share, out=self._late, where=self._returned < self._turns)
        self._late[~late] = 0.0
        forgotten = self._returned > self._returned_for
        if some(forgotten):
            self._begin(forgotten, position, predicted)
            self._late[forgotten] = 0.0
        self._any_late = some(self._late)

    def _begin(self, which: NDArray[np.bool_], position: Float, predicted: Float) -> None:
        """What some joints were led by counts from here on."""
        self._led[0], self._led[1] = predicted, position
        np.copyto(self._where, position, where=which)
        for values in (self._lowest, self._highest):
            np.copyto(values, self._led, where=which)
