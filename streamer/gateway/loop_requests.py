"""Which messages are requests to the loop, what its events call them, and when they act."""

from __future__ import annotations

from flexmotion.streamer.control.ladder import POWERED, State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.gateway.asked import Asked
from flexmotion.streamer.gateway.joint_messages import JointsMessage, LimpMessage, RebootMessage, StiffMessage
from flexmotion.streamer.gateway.message_base import MessageBase
from flexmotion.streamer.gateway.messages import (
    ArmMessage,
    ClearMessage,
    DisarmMessage,
    EmergencyStopMessage,
    KillMessage,
    StopMessage,
)
from flexmotion.streamer.run.requests import Request

REQUESTS: dict[type, Request] = {
    StopMessage: Request.STOP,
    EmergencyStopMessage: Request.ESTOP,
    ArmMessage: Request.ARM,
    DisarmMessage: Request.DISARM,
    ClearMessage: Request.CLEAR,
    KillMessage: Request.KILL,
    LimpMessage: Request.LIMP,
    StiffMessage: Request.STIFF,
    RebootMessage: Request.REBOOT,
}


def request_of(message: MessageBase) -> Request:
    """The request that a message is."""
    return Request.GET_UP if gets_up(message) else REQUESTS[type(message)]


def gets_up(message: MessageBase) -> bool:
    """Whether a message asks the robot to get up."""
    return isinstance(message, ClearMessage) and message.get_up


def name_of(asked: Asked) -> str:
    """Of a request, as in the loop's events; with its joints."""
    message, name = asked.message, request_of(asked.message).name
    return f"{name} {','.join(message.joints)}" if isinstance(message, JointsMessage) else name


def leads(asked: Asked) -> bool:
    """Whether the targets of its connection wait until it is answered: whether they are followed depends on it."""
    waited = isinstance(asked.message, ArmMessage | ClearMessage | LimpMessage | StiffMessage)
    return waited and not gets_up(asked.message)  # that one takes seconds, and targets are refused meanwhile


def in_effect(asked: Asked, row: TickRow | None) -> bool:
    """Whether a request that the loop has taken acts, by the loop's newest row."""
    message = asked.message
    if not isinstance(message, ArmMessage | ClearMessage | JointsMessage):
        return True
    if row is None or int(row.tick) < asked.tick or isinstance(message, RebootMessage) or gets_up(message):
        return False  # the end of a restart is an event, and so is a robot that has got up, or has not
    if isinstance(message, JointsMessage):
        return True  # else it was refused by an event of that tick
    state = State(int(row.state))
    # Else it is refused by an event that is on its way, or by time.
    return state is not State.FAULT and (state in POWERED if isinstance(message, ArmMessage) else not row.must_stop)
