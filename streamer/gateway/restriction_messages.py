"""Messages that restrict what the robot does, whatever it is asked for: feet that stay down, torques that are capped.

They move nothing. Each holds until it is let go (`relax`), or its time to live is over; without one it has no end.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from flexmotion.streamer.gateway.message_base import MessageBase
from flexmotion.streamer.motion.restriction_intents import LEAST_NM, MOST_NM, Contact, Foot, Restriction, TorqueCap

NAMED_JOINT = r"[\w./-]([\w ./-]{0,62}[\w./-])?"
"""Pattern of the name of a joint in the robot file, or of the body: `left knee`."""


class ContactMessage(MessageBase):
    """Keep a foot on the ground where it is, or both: no step lifts it.

    What needs steps is refused meanwhile, and gestures are made on the spot. A robot that walks comes to a stand.

    Attributes:
        foot: left, right or both.
    """

    type: Literal["contact"] = "contact"
    foot: Foot


class TorqueMessage(MessageBase):
    """Ask no more than a torque of a joint's servo: motion is slowed and made smaller until it needs no more.

    Attributes:
        joint: its name in the robot file; or of the body, for both sides or for one: `knee`, `left knee`, `hip`,
            `ankle`, `shoulder`, `elbow`, `wrist`, `neck`.
        limit_nm: greatest torque, in either direction [N·m].
    """

    type: Literal["torque"] = "torque"
    joint: Annotated[str, StringConstraints(pattern=rf"^{NAMED_JOINT}$")]
    limit_nm: Annotated[float, Field(ge=LEAST_NM, le=MOST_NM)]


def restriction_of(message: ContactMessage | TorqueMessage) -> Restriction:
    """The intent of a message."""
    if isinstance(message, ContactMessage):
        return Contact(message.foot)
    return TorqueCap(message.joint, message.limit_nm)
