"""`LogWriter`: writes messages and their schemas to an MCAP file (foxglove-sdk)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.mcap import MCAPCompression, MCAPWriteOptions

from flexmotion.streamer.log.cdr import Column, schema_text
from flexmotion.streamer.log.header import SCHEMA, LogHeader
from flexmotion.streamer.log.log_file import LogFile
from flexmotion.streamer.log.messages import (
    EVENT,
    EVENT_SCHEMA,
    HEARD,
    HEARD_SCHEMA,
    PLAN,
    PLAN_COLUMNS,
    PLAN_SCHEMA,
    TARGET,
    TARGET_SCHEMA,
    TICK,
    TICK_SCHEMA,
    tick_columns,
)

_MEDIA_TYPES = {".npz": "application/x-npz", ".xml": "application/xml", ".yaml": "application/yaml"}


class LogWriter:
    """Topics of one log, each with its schema; times are nanoseconds since the epoch.

    Args:
        attachments: files to store in the log, by name.
    """

    def __init__(self, file: LogFile, header: LogHeader, attachments: Mapping[str, bytes]) -> None:
        self.file = file
        # A context of its own keeps apart several logs in one process; its channels close with it.
        context = self._context = Context()
        options = MCAPWriteOptions(
            compression=MCAPCompression.Zstd,
            compression_threads=0,  # none: the cores are for the run
            disable_seeking=True,
            profile="flexmotion",
        )
        self._mcap = foxglove.open_mcap(file, context=context, writer_options=options)  # type: ignore[arg-type]
        self._mcap.write_metadata(SCHEMA, header.metadata())
        for name, content in attachments.items():
            self._mcap.attach(
                log_time=header.start_ns,
                create_time=header.start_ns,
                name=name,
                media_type=_MEDIA_TYPES.get(name[name.rfind(".") :], "application/octet-stream"),
                data=content,
            )
        about = {"joints": ",".join(header.joints)}
        self._tick = _cdr_channel(context, TICK, TICK_SCHEMA, tick_columns(len(header.joints)), about)
        self._plan = _cdr_channel(context, PLAN, PLAN_SCHEMA, PLAN_COLUMNS, about)
        self._target = Channel(TARGET, schema=TARGET_SCHEMA, context=context)
        self._heard = Channel(HEARD, schema=HEARD_SCHEMA, context=context)
        self._event = Channel(EVENT, schema=EVENT_SCHEMA, context=context)
        self.flush()

    def tick(self, message: bytes, time_ns: int) -> None:
        """Write the row of a tick, as CDR."""
        self._tick.log(message, log_time=time_ns)

    def plan(self, message: bytes, time_ns: int) -> None:
        """Write a plan, as CDR."""
        self._plan.log(message, log_time=time_ns)

    def target(self, content: dict[str, Any], time_ns: int) -> None:
        """Write a target."""
        self._target.log(json.dumps(content).encode(), log_time=time_ns)

    def heard(self, content: dict[str, Any], time_ns: int) -> None:
        """Write an answer."""
        self._heard.log(json.dumps(content).encode(), log_time=time_ns)

    def event(self, content: dict[str, Any], time_ns: int) -> None:
        """Write an event."""
        self._event.log(json.dumps(content).encode(), log_time=time_ns)

    def flush(self) -> None:
        """Write everything to the file, where it stays readable if this process dies."""
        self._mcap.flush()
        self.file.mark()

    def close(self) -> None:
        """Write index and statistics, and close the file."""
        self._mcap.close()
        self.file.close()


def _cdr_channel(context: Context, topic: str, name: str, columns: list[Column], about: dict[str, str]) -> Channel:
    schema = Schema(name=name, encoding="ros2msg", data=schema_text(columns).encode())
    return Channel(topic, schema=schema, message_encoding="cdr", context=context, metadata=about)
