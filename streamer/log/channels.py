"""`Channels`: the topics of a log with their schemas, for a file and for a live view (foxglove-sdk)."""

from __future__ import annotations

import json
from typing import Any

from foxglove import Channel, Context, Schema

from flexmotion.streamer.log.cdr import Column, schema_text
from flexmotion.streamer.log.messages import (
    EVENT,
    EVENT_SCHEMA,
    HEARD,
    HEARD_SCHEMA,
    PERSON,
    PERSON_SCHEMA,
    PLAN,
    PLAN_COLUMNS,
    PLAN_SCHEMA,
    TARGET,
    TARGET_SCHEMA,
    TICK,
    TICK_SCHEMA,
    person_columns,
    tick_columns,
)


class Channels:
    """A `flexmotion.streamer.log.following.Sink`; times are nanoseconds since the epoch.

    Args:
        context: that a file or a server is open on; channels close with it.
        joints: the robot's, in the order of all columns.
    """

    def __init__(self, context: Context, joints: tuple[str, ...]) -> None:
        self._context = context  # channels close with it
        about = {"joints": ",".join(joints)}
        self._tick = _cdr_channel(context, TICK, TICK_SCHEMA, tick_columns(len(joints)), about)
        self._plan = _cdr_channel(context, PLAN, PLAN_SCHEMA, PLAN_COLUMNS, about)
        self._person = _cdr_channel(context, PERSON, PERSON_SCHEMA, person_columns(), {})
        self._target = Channel(TARGET, schema=TARGET_SCHEMA, context=context)
        self._heard = Channel(HEARD, schema=HEARD_SCHEMA, context=context)
        self._event = Channel(EVENT, schema=EVENT_SCHEMA, context=context)

    @property
    def watched(self) -> bool:
        """Whether a file or a viewer takes the ticks."""
        return self._tick.has_sinks()

    def tick(self, message: bytes, time_ns: int) -> None:
        """The row of a tick, as CDR."""
        self._tick.log(message, log_time=time_ns)

    def plan(self, message: bytes, time_ns: int) -> None:
        """A plan, as CDR."""
        self._plan.log(message, log_time=time_ns)

    def person(self, message: bytes, time_ns: int) -> None:
        """A pose of the person who is mirrored, as CDR."""
        self._person.log(message, log_time=time_ns)

    def target(self, content: dict[str, Any], time_ns: int) -> None:
        """A target."""
        self._target.log(json.dumps(content).encode(), log_time=time_ns)

    def heard(self, content: dict[str, Any], time_ns: int) -> None:
        """An answer."""
        self._heard.log(json.dumps(content).encode(), log_time=time_ns)

    def event(self, content: dict[str, Any], time_ns: int) -> None:
        """An event."""
        self._event.log(json.dumps(content).encode(), log_time=time_ns)


def _cdr_channel(context: Context, topic: str, name: str, columns: list[Column], about: dict[str, str]) -> Channel:
    schema = Schema(name=name, encoding="ros2msg", data=schema_text(columns).encode())
    return Channel(topic, schema=schema, message_encoding="cdr", context=context, metadata=about)
