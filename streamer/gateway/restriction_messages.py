"""Messages that restrict what the robot does, whatever it is asked for: feet, torques, how stiff arms and head follow.

They move nothing. Each holds until it is let go (`relax`), or its time to live is over; without one it has no end.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from flexmotion.configs.problems import Wording
from flexmotion.streamer.gateway.message_base import MessageBase
from flexmotion.streamer.motion.restriction_intents import (
    MOST_NM,
    Contact,
    Foot,
    Limb,
    Restriction,
    Tension,
    TorqueCap,
)
from flexmotion.text.restriction_phrases import LEAST_NM

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
    joint: Annotated[str, StringConstraints(pattern=rf"^{NAMED_JOINT}$"), Wording("the name of a joint")]
    limit_nm: Annotated[float, Field(ge=LEAST_NM, le=MOST_NM)]


class TensionMessage(MessageBase):
    """Let an arm, both, or the head follow as stiffly as that, whatever the human's muscles do.

    Never stiffer than the robot file lets it be, and never softer than its `least_stiffness`.

    Attributes:
        limb: left arm, right arm, both arms or head.
        tension: 1: as stiff as it gets; 0: as soft.
    """

    type: Literal["tension"] = "tension"
    limb: Limb
    tension: Annotated[float, Field(ge=0.0, le=1.0)]


def restriction_of(message: ContactMessage | TorqueMessage | TensionMessage) -> Restriction:
    """The intent of a message."""
    match message:
        case ContactMessage():
            return Contact(message.foot)
        case TorqueMessage():
            return TorqueCap(message.joint, message.limit_nm)
        case TensionMessage():
            return Tension(message.limb, message.tension)
