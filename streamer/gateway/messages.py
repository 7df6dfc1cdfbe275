"""The messages between a program and a run: what may be asked, the answer that each message gets, and how it ended.

JSON objects, one a message. `docs/messages.schema.json` is their JSON Schema (`python -m
flexmotion.streamer.gateway.schema`). Every message gets one `Answer`. SI units, radians; a field that is not known is
refused, and so is a version other than `VERSION`. `Ended` follows where a connection asks for it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError, field_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.get_up import LONGEST_S
from flexmotion.configs.problems import one_line
from flexmotion.streamer.gateway.joint_messages import LimpMessage, RebootMessage, StiffMessage
from flexmotion.streamer.gateway.message_base import VERSION, MessageBase
from flexmotion.streamer.gateway.part_messages import (
    FootMessage,
    HandMessage,
    HeadMessage,
    JointMessage,
    LookMessage,
    PointMessage,
    RelaxMessage,
    part_intent_of,
)
from flexmotion.streamer.gateway.restriction_messages import (
    ContactMessage,
    TensionMessage,
    TorqueMessage,
    restriction_of,
)
from flexmotion.streamer.motion.intents import (
    CLOSEST_M,
    FARTHEST_M,
    FASTEST,
    LONGEST_TEXT,
    LOOSEST_M,
    SLOWEST_TURN,
    WIDEST_RAD,
    Clip,
    Heading,
    Intent,
    Stop,
    Text,
    Velocity,
    Waypoint,
)

_Forward = Annotated[float, Field(ge=-FASTEST[0], le=FASTEST[0], description="forward [m/s]")]
_Left = Annotated[float, Field(ge=-FASTEST[1], le=FASTEST[1], description="left [m/s]")]
_Turning = Annotated[float, Field(ge=-FASTEST[2], le=FASTEST[2], description="turning left [rad/s]")]
_Place = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, description="[m]")]
_Heading = Annotated[float, Field(ge=-WIDEST_RAD, le=WIDEST_RAD, description="[rad]")]


def _fits(kind: Callable[[str], Intent], words: str) -> str:
    try:
        kind(words)
    except ConfigError as error:
        raise ValueError(str(error)) from None
    if len(words.encode()) > LONGEST_TEXT:
        raise ValueError(f"{len(words.encode())} bytes in UTF-8, expected at most {LONGEST_TEXT}")
    return words


class TextMessage(MessageBase):
    """Do what the words say: "wave with the right hand"."""

    type: Literal["text"] = "text"
    text: Annotated[str, StringConstraints(min_length=1, max_length=LONGEST_TEXT)]

    @field_validator("text")
    @classmethod
    def _is_text(cls, text: str) -> str:
        return _fits(Text, text)


class VelocityMessage(MessageBase):
    """Walk at a velocity in the robot's heading frame, as a human of the robot's model would; zero is a stand.

    Attributes:
        velocity: forward, left [m/s], turning left [rad/s].
    """

    type: Literal["velocity"] = "velocity"
    velocity: tuple[_Forward, _Left, _Turning]


class HeadingMessage(MessageBase):
    """Turn on the spot to a heading in the robot's odometry, the shorter way, then stand.

    Attributes:
        heading_rad: counterclockwise from where the robot looked when it had stood up [rad].
        turning_rad_s: greatest turning speed [rad/s]; None: the robot's own.
    """

    type: Literal["heading"] = "heading"
    heading_rad: _Heading
    turning_rad_s: Annotated[float, Field(ge=SLOWEST_TURN, le=FASTEST[2])] | None = None


class WaypointMessage(MessageBase):
    """Walk to a place in the robot's odometry, then stand.

    Attributes:
        position_m: x ahead and y left of where the robot was when it had stood up [m].
        heading_rad: heading at the end [rad]; None: as it arrives.
        tolerance_m: the robot has arrived when it stands within this distance [m].
    """

    type: Literal["waypoint"] = "waypoint"
    position_m: tuple[_Place, _Place]
    heading_rad: _Heading | None = None
    tolerance_m: Annotated[float, Field(ge=CLOSEST_M, le=LOOSEST_M)] = 0.1


class ClipMessage(MessageBase):
    """Follow a clip of the run's library, by name."""

    type: Literal["clip"] = "clip"
    clip: Annotated[str, StringConstraints(min_length=1, max_length=LONGEST_TEXT)]

    @field_validator("clip")
    @classmethod
    def _is_name(cls, clip: str) -> str:
        return _fits(Clip, clip)


class HoldMessage(MessageBase):
    """Come to a balanced stand; the next target goes on from there."""

    type: Literal["hold"] = "hold"


class StopMessage(MessageBase):
    """Come to a balanced stand and refuse targets until `clear`; without torque, refuse `arm` until then."""

    type: Literal["stop"] = "stop"


class EmergencyStopMessage(MessageBase):
    """Stop at once as the robot file says, then park; the fault is latched, without torque too. No safety function."""

    type: Literal["estop"] = "estop"


class ArmMessage(MessageBase):
    """Switch the torque on and stand up.

    Refused where a fault is latched, a stop is in force, the robot lies, or its hardware is unfit.
    """

    type: Literal["arm"] = "arm"


class DisarmMessage(MessageBase):
    """Come to a stand, park, switch the torque off; the run goes on, and can be armed again."""

    type: Literal["disarm"] = "disarm"


class ClearMessage(MessageBase):
    """Release a STOP once the robot stands: it stands until a new target. Without torque: to OFF, until `arm`.

    Attributes:
        get_up: a robot that lies on its front or its back gets up, from OFF too; the answer comes when it stands, or
            has given up. Never by itself: without this it lies until somebody puts it up.
    """

    type: Literal["clear"] = "clear"
    get_up: bool = False


class KillMessage(MessageBase):
    """Switch the torque off at once: the robot falls."""

    type: Literal["kill"] = "kill"
    confirm: Literal["the robot will fall"]


class TakeMessage(MessageBase):
    """Take the operator's lease over from another source; shown to all."""

    type: Literal["take"] = "take"


class ReleaseMessage(MessageBase):
    """Give the operator's lease back."""

    type: Literal["release"] = "release"


GET_UP_S = LONGEST_S + 20.0
"""Time after which a `clear` with `get_up` is answered at the latest [s]: the steps, the way to the first, a margin."""

Message = (
    TextMessage
    | VelocityMessage
    | HeadingMessage
    | WaypointMessage
    | HandMessage
    | FootMessage
    | HeadMessage
    | PointMessage
    | LookMessage
    | JointMessage
    | RelaxMessage
    | ContactMessage
    | TorqueMessage
    | TensionMessage
    | ClipMessage
    | HoldMessage
    | StopMessage
    | EmergencyStopMessage
    | ArmMessage
    | DisarmMessage
    | ClearMessage
    | KillMessage
    | LimpMessage
    | StiffMessage
    | RebootMessage
    | TakeMessage
    | ReleaseMessage
)
KINDS: dict[str, type[MessageBase]] = {
    get_args(kind.model_fields["type"].annotation)[0]: kind for kind in get_args(Message)
}
"""The classes of messages by their `type`."""

MESSAGE: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])

AnswerState = Literal["accepted", "slowed", "moved", "partly", "superseded", "expired", "refused"]

FOLLOWED: tuple[AnswerState, ...] = ("accepted", "slowed", "partly")
"""States of the answers to targets for the whole body that the robot follows."""

TargetEnd = Literal["done", "time limit", "expired", "superseded", "stopped"]


class Answer(BaseModel):
    """What became of one message; every message gets exactly one.

    Attributes:
        id, source, sequence: of the message, as far as they could be read.
        asked: its type.
        state: accepted: the robot does it from `tick` on. slowed: to what the robot can follow. moved: to the
            nearest place in reach. partly: without what `dropped` names. superseded: a newer target came before a plan
            followed it. expired: its time was over before. refused: it is not done, for `reason`.
        target: number of the target in the log.
        part: of the body, that a target is for; None: the whole body, or no target.
        tick: of the loop, from which on it acts.
        heard_as: kinds of motion that the words were taken for, in the order in which they are done.
        manner: in which they are done, in the same order; None: in the normal one.
        certainty: share of that kind in what the listener heard, in [0, 1].
        slowed: speeds that the human is slowed to, so that the robot keeps up; of a part, when it is there.
        moved: place, direction or angle that a part is moved to.
        dropped: parts that are not done.
        notes: what was taken for words that say no number, and what else there is to know of how it is done.
        reason: why it is not done, or not as asked.
        took_lease_from: operator from whom this message took the lease over.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    type: Literal["answer"] = "answer"
    version: Literal[1] = VERSION
    id: str | None = None
    source: str | None = None
    sequence: int | None = None
    asked: str | None = None
    state: AnswerState
    target: int | None = None
    part: str | None = None
    tick: int | None = None
    heard_as: str | None = None
    manner: str | None = None
    certainty: float | None = None
    slowed: str | None = None
    moved: str | None = None
    dropped: tuple[str, ...] | None = None
    notes: tuple[str, ...] | None = None
    reason: str | None = None
    took_lease_from: str | None = None


class Ended(BaseModel):
    """The end of a target that was followed; told once, to the connection that it came by.

    Attributes:
        id, source: of its message; target: its number, as in its answer.
        end: done: its amount was measured, the robot has arrived, or the part is there. time limit: that took too
            long. expired: its time to live is over. superseded: the robot follows another target, stands for words that
            it does not understand, or the part was let go before it was there. stopped: by a stop, a fault, torque
            off, or a foot that is kept down.
        done: what the robot did, by its own odometry, how far the part is from its place, or why the target was given
            up, in words; behind it what was left out since its answer.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    type: Literal["ended"] = "ended"
    version: Literal[1] = VERSION
    id: str | None = None
    source: str | None = None
    target: int
    end: TargetEnd
    done: str | None = None


class MessageError(ConfigError):
    """A message that cannot be read.

    Attributes:
        answer: that its sender gets.
    """

    def __init__(self, reason: str, content: Any = None) -> None:
        super().__init__(reason)
        known = content if isinstance(content, dict) else {}
        self.answer = Answer(
            id=_word(known.get("id")),
            source=_word(known.get("source")),
            asked=_word(known.get("type")),
            state="refused",
            reason=reason,
        )


def decode(data: bytes | str) -> Message:
    """A message from JSON.

    Raises:
        MessageError: it is no JSON, or no message of this version; names the field and what is valid.
    """
    try:
        return MESSAGE.validate_json(data)
    except ValidationError as error:
        raise MessageError(_one_line(error), _content(data)) from None


def encode(message: BaseModel) -> str:
    """A message or an answer as JSON, without the fields that are not set."""
    return message.model_dump_json(exclude_none=True)


def intent_of(message: Message) -> Intent | None:
    """The intent of a target; None where the message is no target."""
    match message:
        case TextMessage(text=text):
            return Text(text)
        case VelocityMessage(velocity=velocity):
            # A released stick: the stop of a plan is balanced by the robot's measure, a model's stand by the human's.
            return Velocity(*velocity) if any(velocity) else Stop()
        case ClipMessage(clip=clip):
            return Clip(clip)
        case HeadingMessage(heading_rad=heading, turning_rad_s=turning):
            return Heading(heading, turning)
        case WaypointMessage(position_m=(x, y), heading_rad=heading, tolerance_m=tolerance):
            return Waypoint(x, y, heading, tolerance)
        case HoldMessage():
            return Stop()
        case HandMessage() | FootMessage() | HeadMessage() | PointMessage() | LookMessage() | JointMessage():
            return part_intent_of(message)
        case RelaxMessage():
            return part_intent_of(message)
        case ContactMessage() | TorqueMessage() | TensionMessage():
            return restriction_of(message)
    return None


def _content(data: bytes | str) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def _word(value: Any) -> str | None:
    return value if isinstance(value, str) and 0 < len(value) <= 64 and value.isprintable() else None


def _one_line(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    if first["type"].startswith("union_tag"):
        return f"type: expected one of: {', '.join(KINDS)}"
    kind = str(first["loc"][0]) if first["loc"] else ""
    field, message = one_line(error, KINDS.get(kind), skip=1)
    text = " ".join(message.split())
    text = "".join(character if character.isprintable() else "?" for character in text)
    return ": ".join(filter(None, (f"{kind}.{field}" if field else kind, text)))[:300]
