"""`GestureWay`: how far a gesture has brought the robot from its stand, as a person beside it sees it.

A person sees hands, head, trunk and bent legs, and no joint angles: arms may hang from shoulder joints that are turned
over by 160°.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arms import UpperBody
from flexmotion.text.phrases import seen_parts
from flexmotion.text.sides import LEFT, sides

Float = NDArray[np.float64]

_HAND_SEEN = 0.35
"""Least way of a hand that is seen as a gesture, over the length of its arm: an arm that turns by 20°."""
_HEAD_SEEN, _TRUNK_SEEN, _LEG_SEEN = np.radians(10.0), np.radians(25.0), 0.35
"""Likewise of a head that turns (the least nod of gestures.yaml is 13°), a trunk that leans and a leg's joint [rad].

The model's bow is judged at 30°, OP3 follows to 40; at 15 a lean of 18° before a bow was taken for it."""


class GestureWay:
    """Measures one robot; the same for measured joints and for true ones.

    Args:
        robot: the robot file.
        upper: its arms and head.
    """

    def __init__(self, robot: Robot, upper: UpperBody) -> None:
        self._chain, self._arms = upper.chain, upper.arms
        self._head = np.array(sorted(upper.head.values()), dtype=int)
        self._legs = np.setdiff1d(np.arange(robot.n), upper.joints)
        stand = robot.stand_pose
        self._hands, self._gaze = self._of_hands(stand), stand[self._head]

    def __call__(self, kind: str, q: Float, tilt: Float, began: Float) -> Float:
        """How far the parts that make a kind of gesture are from where they stand; 1: far enough to be seen.

        Hands and head are measured from the stand pose, the trunk from upright, legs from where they began: robots
        stand on legs that are bent more or less. A gesture of one side is looked for on that side.

        Args:
            kind: of motion; what of it is seen is in `phrases.yaml`.
            q: joint angles, (..., n) [rad].
            tilt: roll and pitch of the torso, (..., 2) [rad].
            began: joint angles as the gesture began, (n,) [rad].

        Returns:
            (...).
        """
        seen = seen_parts(kind)
        way = np.zeros(q.shape[:-1])
        if "arm" in seen:
            hands = np.linalg.norm(self._of_hands(q) - self._hands, axis=-1) / _HAND_SEEN
            named = sides(kind)
            own = hands if len(named) != 1 else hands[..., [0 if LEFT in named else 1]]
            way = np.maximum(way, own.max(axis=-1))
        if "head" in seen:
            turned = np.abs(q[..., self._head] - self._gaze).max(axis=-1, initial=0.0) / _HEAD_SEEN
            way = np.maximum(way, turned)
        if "trunk" in seen:
            way = np.maximum(way, np.abs(tilt).max(axis=-1) / _TRUNK_SEEN)
        if "leg" in seen:
            way = np.maximum(way, np.abs(q - began)[..., self._legs].max(axis=-1, initial=0.0) / _LEG_SEEN)
        return way

    def _of_hands(self, q: Float) -> Float:
        """Places of the hands from their shoulders in the torso's frame, over the arms' lengths, (..., 2, 3)."""
        arms = self._chain.poses(q[..., self._arms])
        return (arms.hand - arms.shoulder) / self._chain.lengths.sum(axis=1)[:, None]
