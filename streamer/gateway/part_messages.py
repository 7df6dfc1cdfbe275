"""Messages about one part of the body, arms, head and feet; the rest goes on with what it does.

Places and directions of arms and head are seen from the robot's trunk: origin and axes of the robot file's `torso`
body, x forward, y left, z up along the trunk; the place of a foot is seen from the other one, that of the head from the
middle between both. A part is let go when its
time to live is over; without one it is held for `part_holds_s` of the stream settings.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, field_validator, model_validator

from flexmotion.configs.problems import Wording
from flexmotion.streamer.gateway.joint_messages import Joint
from flexmotion.streamer.gateway.message_base import MessageBase
from flexmotion.streamer.gateway.restriction_messages import NAMED_JOINT
from flexmotion.streamer.motion.part_intents import (
    FARTHEST_FOOT_M,
    FARTHEST_HAND_M,
    LEAST_DIRECTION,
    LONGEST_S,
    FootPlace,
    Hand,
    HeadPlace,
    JointAngle,
    Look,
    PartIntent,
    Point,
    Relax,
)
from flexmotion.streamer.motion.part_values import Side
from flexmotion.streamer.motion.restriction_intents import TENSION, TENSION_LIMBS

_Coordinate = Annotated[float, Field(ge=-FARTHEST_HAND_M, le=FARTHEST_HAND_M)]
_OnFloor = Annotated[float, Field(ge=-FARTHEST_FOOT_M, le=FARTHEST_FOOT_M)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_PARTS = "all|left hand|right hand|head|head place|left foot|right foot|both feet"
_NAMED = rf"joint [\w./-]{{1,64}}|torque {NAMED_JOINT}|{TENSION}({'|'.join(TENSION_LIMBS)})"
_PART_WORDS = Wording(
    ", ".join((*_PARTS.split("|"), "joint NAME", "torque NAME", *(f"{TENSION}{limb}" for limb in TENSION_LIMBS)))
)
_InS = Annotated[float, Field(ge=0.0, le=LONGEST_S, description="time until it is there [s]")]
_Angle = Annotated[float, Field(ge=0.0, le=math.pi, description="[rad]")]


class PartMessage(MessageBase):
    """The fields of a message that brings a part somewhere.

    Attributes:
        in_s: time until it is there [s]; as soon as possible where the robot cannot be there in time.
    """

    in_s: _InS = 0.5

    @model_validator(mode="after")
    def _lives_long_enough(self) -> PartMessage:
        if self.ttl_s is not None and self.ttl_s <= self.in_s:
            raise ValueError(f"ttl_s: {self.ttl_s:g} s, expected more than in_s, {self.in_s:g} s")
        return self


class HandMessage(PartMessage):
    """Bring a hand to a place, and hold it there.

    Attributes:
        side: which hand.
        position_m: x, y, z in the trunk's frame [m].
        tolerance_m: a place out of reach is replaced by the nearest one within this distance; else it is refused [m].
    """

    type: Literal["hand"] = "hand"
    side: Side
    position_m: _Vector
    tolerance_m: Annotated[float, Field(ge=0.0, le=FARTHEST_HAND_M)] = 0.05


class FootMessage(PartMessage):
    """Make a step with a foot to a place seen from the other one, and stand there.

    Attributes:
        side: which foot.
        position_m: x, y of the centre of its sole from that of the other one, along the axes of the other sole: x to
            its toes, y left.
        heading_rad: of its toes, from those of the other foot, positive to the left [rad].
        tolerance_m: a place out of reach is replaced by the nearest one within this distance; else it is refused [m].
        tolerance_rad: a heading beyond what the foot may turn likewise [rad].
    """

    type: Literal["foot"] = "foot"
    side: Side
    position_m: tuple[_OnFloor, _OnFloor]
    heading_rad: Annotated[float, Field(ge=-math.pi, le=math.pi)] = 0.0
    in_s: _InS = 1.0
    tolerance_m: Annotated[float, Field(ge=0.0, le=FARTHEST_FOOT_M)] = 0.05
    tolerance_rad: _Angle = 0.1


class HeadMessage(PartMessage):
    """Bring the head to a place by hips and trunk while both feet stand, and hold it there.

    Attributes:
        position_m: x, y, z of the head's point from the middle between both soles on the floor: x as the feet point, y
            left, z up [m]. null for x or y: wherever the height leads.
        tolerance_m: a place out of reach is replaced by the nearest one within this distance; else it is refused [m].
    """

    type: Literal["head"] = "head"
    position_m: tuple[_Coordinate | None, _Coordinate | None, _Coordinate]
    in_s: _InS = 1.0
    tolerance_m: Annotated[float, Field(ge=0.0, le=FARTHEST_HAND_M)] = 0.05


class _DirectedMessage(PartMessage):
    """The fields of a message with a direction.

    Attributes:
        direction: x, y, z in the trunk's frame, of any length.
        tolerance_rad: a direction that cannot be taken is replaced by the nearest one within this angle; else it is
            refused [rad].
    """

    direction: _Vector
    tolerance_rad: _Angle = 0.35

    @field_validator("direction")
    @classmethod
    def _has_length(cls, direction: tuple[float, float, float]) -> tuple[float, float, float]:
        if math.hypot(*direction) < LEAST_DIRECTION:
            raise ValueError(f"expected a direction of length {LEAST_DIRECTION:g} or more")
        return direction


class PointMessage(_DirectedMessage):
    """Point with an arm, almost straight from shoulder to hand.

    Attributes:
        side: which arm.
    """

    type: Literal["point"] = "point"
    side: Side


class LookMessage(_DirectedMessage):
    """Look into a direction with the head; nothing else turns."""

    type: Literal["look"] = "look"


class JointMessage(PartMessage):
    """Bring one joint of arms or head to an angle, and hold it there.

    Attributes:
        joint: its name in the robot file.
        angle_rad: in the joint's own sign [rad].
        tolerance_rad: an angle beyond the joint's limits is replaced by the limit where that is within this angle; else
            it is refused [rad].
    """

    type: Literal["joint"] = "joint"
    joint: Joint
    angle_rad: Annotated[float, Field(ge=-math.tau, le=math.tau, description="[rad]")]
    tolerance_rad: _Angle = 0.1


class RelaxMessage(MessageBase):
    """Let a part go: it goes back to what the rest of the body does.

    Attributes:
        part: "left hand", "right hand", "head", "head place", "joint NAME", "left foot", "right foot", "both feet",
            "torque NAME", "tension LIMB"; "all": every part that is asked for something.
    """

    type: Literal["relax"] = "relax"
    part: Annotated[str, StringConstraints(pattern=rf"^({_PARTS}|{_NAMED})$"), _PART_WORDS] = "all"


PartMessages = HandMessage | FootMessage | HeadMessage | PointMessage | LookMessage | JointMessage | RelaxMessage


def part_intent_of(message: PartMessages) -> PartIntent:
    """The intent of a message about a part."""
    match message:
        case HandMessage(side=side, position_m=place, in_s=in_s, tolerance_m=tolerance):
            return Hand(side, place, in_s, tolerance)
        case FootMessage(side=side, position_m=floor, heading_rad=heading, in_s=in_s):
            return FootPlace(side, floor, heading, in_s, message.tolerance_m, message.tolerance_rad)
        case HeadMessage(position_m=head, in_s=in_s, tolerance_m=tolerance):
            return HeadPlace(head, in_s, tolerance)
        case PointMessage(side=side, direction=direction, in_s=in_s, tolerance_rad=tolerance):
            return Point(side, direction, in_s, tolerance)
        case LookMessage(direction=direction, in_s=in_s, tolerance_rad=tolerance):
            return Look(direction, in_s, tolerance)
        case JointMessage(joint=joint, angle_rad=angle, in_s=in_s, tolerance_rad=tolerance):
            return JointAngle(joint, angle, in_s, tolerance)
    return Relax(message.part)
