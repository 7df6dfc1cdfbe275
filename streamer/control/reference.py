"""`Reference`: what the robot is to do in one tick, from a plan, a slow move or a hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.plan import Plan

Float = NDArray[np.float64]


class Reference:
    """One tick's reference; allocated once and filled in place.

    Attributes:
        q, qd, torque: (n,) [rad, rad/s, N·m].
        stiffness: share of the robot file's stiffness with which each joint follows, (n,) in (0, 1].
        feet: sole centres and yaw, (2, 4) [m, m, m, rad]; contacts: (2,) bool; share: part of the load on the right
            foot.
        base: torso position [m] and quaternion w x y z, (7,); of a slow move its attitude alone.
        base_after: that of the plan's next row, (7,).
        com, dcm, zmp: horizontal, in the plan's world, (2,) [m].
        balanced: whether feet, com, dcm and zmp are valid, so that balance feedback may act.
    """

    def __init__(self, n: int) -> None:
        self.q, self.qd, self.torque = np.zeros(n), np.zeros(n), np.zeros(n)
        self.stiffness = np.ones(n)
        self.feet, self.contacts, self.share = np.zeros((2, 4)), np.ones(2, np.bool_), 0.5
        self.base = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self.base_after = self.base.copy()
        self.com, self.dcm, self.zmp = np.zeros(2), np.zeros(2), np.zeros(2)
        self.balanced = False

    def take(self, plan: Plan, place: float) -> None:
        """Read `plan` at a row, interpolated linearly between rows; past the end the last row is held at rest."""
        last = len(plan) - 1
        row = int(min(max(place, 0.0), last))
        following = min(row + 1, last)
        part = min(max(place - row, 0.0), 1.0)
        for name in ("q", "qd", "torque", "stiffness", "feet"):
            rows = getattr(plan, name)
            np.multiply(rows[following] - rows[row], part, out=getattr(self, name))
            getattr(self, name)[...] += rows[row]
        if place > last:
            self.qd[:] = 0.0
        self.contacts[:] = plan.contacts[row]
        self.share = float(plan.load_share[row])
        self.base[:], self.base_after[:] = plan.base[row], plan.base[following]
        self.com[:], self.dcm[:], self.zmp[:] = plan.com[row, :2], plan.dcm[row], plan.zmp[row]
        self.balanced = True

    def copy(self, other: Reference) -> None:
        """Copy the joints of another reference (a slow move needs no look-ahead)."""
        for name in ("q", "qd", "torque", "stiffness"):
            getattr(self, name)[:] = getattr(other, name)
        self.balanced = other.balanced
