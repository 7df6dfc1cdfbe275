"""What is told where a motion is eased: an event for the operator, and what the answer to a target says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from flexmotion.configs.robot import Robot
from flexmotion.retarget.easing import Eased
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.motion.heard import Heard

EASED = "eased: "
"""How an event about an eased motion begins; the report collects them."""
REFUSED = f"{EASED}refused"
"""How it begins where the motion is refused."""
_WHOLE_S = 2.0
"""After this time without easing the motion goes on as asked: the next easing is told again [s]."""


class Degree(IntEnum):
    """How far a motion is eased, least first."""

    WHOLE = 0
    SLOWED = 1
    SMALLER = 2
    REFUSED = 3

    @classmethod
    def of(cls, eased: Eased) -> Degree:
        """The degree of one plan."""
        if eased.refused:
            return cls.REFUSED
        if eased.ease.size < 1.0:
            return cls.SMALLER
        return cls.SLOWED if eased.ease.pace < 1.0 else cls.WHOLE


@dataclass(frozen=True)
class EaseNote:
    """One message.

    Attributes:
        degree: of the easing.
        message: for the operator.
        slowed: what the answer to a target says it is slowed to; None: refused.
    """

    degree: Degree
    message: str
    slowed: str | None

    def answer(self, heard: Heard) -> Heard:
        """The answer to the target that is followed, with this in it."""
        if self.slowed is None:
            return heard.model_copy(update={"state": "refused", "reason": self.message})
        state = "slowed" if heard.state == "accepted" else heard.state
        slowed = self.slowed if heard.slowed is None else f"{heard.slowed}, {self.slowed}"
        return heard.model_copy(update={"state": state, "slowed": slowed, "notes": (*heard.notes, self.message)})


class EaseNotes:
    """Tells each further degree of easing once for each target, until the motion has gone on as asked for a while."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._told, self._eased_tick, self._target = Degree.WHOLE, 0, 0

    def of(self, plan: Plan, target: int = 0) -> EaseNote | None:
        """What there is to tell of a new plan, which follows the target of this id; None: nothing new."""
        eased = plan.eased
        if target != self._target:
            self._told, self._target = Degree.WHOLE, target
        if eased is None:
            return None
        degree = Degree.of(eased)
        if degree is Degree.WHOLE:
            if plan.start_tick - self._eased_tick > _WHOLE_S * self.robot.rate_hz:
                self._told = degree
            return None
        self._eased_tick = plan.start_tick
        if degree <= self._told:
            return None
        self._told = degree
        return EaseNote(degree, f"{EASED}{self._words(eased, degree, plan)}", _slowed(eased, degree))

    def _words(self, eased: Eased, degree: Degree, plan: Plan) -> str:
        most = eased.first if eased.drafts > 1 else eased.effort
        joint = self.robot.joint_names[most.joint]
        at_s = (plan.start_tick + most.row) / self.robot.rate_hz
        if most.cap is not None:
            needs = f"{joint} needs {most.torque:.2f} N·m at {at_s:.2f} s, its cap is {most.cap:g} N·m"
        else:
            needs = f"{joint} needs {most.load:.2f} times its servo's envelope ({most.torque:.2f} N·m) at {at_s:.2f} s"
        if degree is Degree.REFUSED and eased.effort.cap is not None:
            return f"refused, the robot comes to a stand: {needs}, however it is eased"
        if degree is Degree.REFUSED:
            behind = f"falls {math.degrees(eased.lag):.0f}° behind, however it is eased"
            return f"refused, the robot comes to a stand: {needs} and {behind}"
        return f"{_slowed(eased, degree)}: {needs}"


def _slowed(eased: Eased, degree: Degree) -> str | None:
    if degree is Degree.REFUSED:
        return None
    pace = f"{100 * eased.ease.pace:.0f} % of its pace"
    return pace if degree is Degree.SLOWED else f"{pace} and {100 * eased.ease.size:.0f} % of its size"
