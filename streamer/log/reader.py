"""`read_log`: reads a log file."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray
from zstandard import ZstdError

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.log.cdr import ENCAPSULATION, decode, parse_schema, row_dtype
from flexmotion.streamer.log.header import SCHEMA, LogHeader, is_header, require_version, robot_files
from flexmotion.streamer.log.messages import EVENT, HEARD, PERSON, PLAN, TARGET, TICK
from flexmotion.streamer.log.parts import later_parts, part_number
from flexmotion.streamer.log.source import unpack
from flexmotion.streamer.motion.heard import Heard, merged
from flexmotion.streamer.motion.person_channel import PersonRow
from flexmotion.streamer.motion.sources import Source


@dataclass
class Topic:
    """One topic of a log: name and encoding of its schema, count and bytes of its messages."""

    schema: str
    encoding: str
    messages: int = 0
    size_bytes: int = 0


@dataclass(frozen=True)
class Log:
    """Content of a log.

    Attributes:
        rows: rows of `flexmotion.streamer.control.tick_row.TickRow`, one a tick; missing columns are NaN or 0.
        events: events in order.
        plans: fields of `flexmotion.streamer.log.messages.PLAN_COLUMNS` by name.
        targets: targets as sent.
        heard: the answers, each in its newest version; none in logs of older versions.
        persons: rows of `flexmotion.streamer.motion.person_channel.PersonRow`; none where nobody was mirrored.
        files: attachments by name.
        whole: whether all of its data is there; if not, it ends where writing ended.
        parts: its files, in order.
        missing: numbers of parts that were removed between them.
    """

    path: Path
    header: LogHeader
    rows: NDArray[Any]
    events: list[Event]
    plans: list[dict[str, Any]]
    targets: list[dict[str, Any]]
    heard: list[Heard]
    persons: NDArray[Any]
    files: dict[str, bytes]
    topics: dict[str, Topic]
    whole: bool
    parts: tuple[Path, ...]
    missing: tuple[int, ...] = ()

    def record(self) -> RunTrace:
        """The record of the run."""
        record = RunTrace(self.header.rate_hz, self.header.joints, kept_s=len(self.rows) / self.header.rate_hz + 1.0)
        record.append(self.rows)
        record.events.extend(self.events)
        return record

    def source(self) -> Source:
        """The source that the run followed. Raises `ConfigError` if it is not in the log."""
        return unpack(self.header.source_parts, self.files, self.path)

    def changed_files(self, robot: Robot) -> list[str]:
        """Names of the robot's files that have changed since the log was written."""
        return [name for name, content in robot_files(robot).items() if self.files.get(name) != content]

    @property
    def gaps(self) -> int:
        """Ticks missing between the first and the last: skipped by a late loop, or lost by the recorder."""
        return int(self.rows["tick"][-1] - self.rows["tick"][0]) + 1 - len(self.rows) if len(self.rows) else 0


def read_log(path: str | Path) -> Log:
    """Read a log; one that was cut off is read as far as it goes.

    Args:
        path: of the log, which is read with all its later parts; or of a later part, which is read alone.

    Raises:
        ConfigError: the file is missing, no log of FlexMotion, of another version, or damaged.
    """
    path = Path(path)
    content = _Content(path)
    whole, parts = _read(path, content), [path]
    for later in later_parts(path):
        if not later.stat().st_size:
            continue  # the recorder was killed as it began this part
        part = _Content(later)
        closed = _read(later, part)
        if content.goes_on_in(part):
            parts.append(later)
            whole = closed
    numbers = range(1, part_number(parts[-1])) if len(parts) > 1 else range(0)
    missing = set(numbers) - {part_number(part) for part in parts}
    return replace(content.log(whole), parts=tuple(parts), missing=tuple(sorted(missing)))


def _read(path: Path, content: _Content) -> bool:
    """Read a file; returns whether all of its data is there. Raises as `read_log` does."""
    try:
        with open(path, "rb") as file:
            for record in _records(StreamReader(file, validate_crcs=True)):
                content.take(record)
                if isinstance(record, DataEnd):
                    return True  # what follows is an index of it, which may be cut off or damaged
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (McapError, ZstdError, ValueError, KeyError, struct.error) as error:
        raise ConfigError(f"{path}: damaged, or not a log of FlexMotion (an .mcap file, as --log writes it)") from error
    return False


def _records(reader: StreamReader) -> Iterator[McapRecord]:
    """All records, up to where the file was cut off."""
    try:
        yield from reader.records
    except EndOfFile:
        return


@dataclass
class _Content:
    """Content that has been read so far."""

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    """The schema of each topic."""
    header: LogHeader | None = None
    files: dict[str, bytes] = field(default_factory=dict)
    ticks: list[bytes] = field(default_factory=list)
    plans: list[bytes] = field(default_factory=list)
    targets: list[dict[str, Any]] = field(default_factory=list)
    heard: list[Heard] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    persons: list[bytes] = field(default_factory=list)

    def take(self, record: McapRecord) -> None:
        if isinstance(record, Message):
            self._take_message(record)
        elif isinstance(record, Metadata) and is_header(record.name):
            require_version(record.name, record.metadata, self.path)
            self.header = LogHeader.from_metadata(record.metadata, self.path)
        elif isinstance(record, Attachment):
            self.files[record.name] = record.data
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
            schema = self.schemas[record.schema_id]
            self.topics.setdefault(record.topic, Topic(schema.name, record.message_encoding))
            self.texts.setdefault(record.topic, schema.data.decode())

    def _take_message(self, message: Message) -> None:
        name, data = self.channels[message.channel_id].topic, message.data
        topic = self.topics[name]
        topic.messages += 1
        topic.size_bytes += len(data)
        if name == TICK:
            self.ticks.append(data)
        elif name == PLAN:
            self.plans.append(data)
        elif name == PERSON:
            self.persons.append(data)
        elif name == TARGET:
            self.targets.append(json.loads(data))
        elif name == HEARD:
            answer = json.loads(data)
            known = {name: answer[name] for name in Heard.model_fields if name in answer}
            self.heard.append(Heard.model_validate(known))
        elif name == EVENT:
            event = json.loads(data)
            self.events.append(Event(event["tick"], event["kind"], event["message"]))

    def goes_on_in(self, part: _Content) -> bool:
        """Add what a later part holds, if it is one of the same run; returns whether it is."""
        if self.header is None or part.header is None or part.header.start_ns != self.header.start_ns:
            return False
        for name in ("ticks", "plans", "targets", "heard", "events", "persons"):
            getattr(self, name).extend(getattr(part, name))
        self.texts = part.texts | self.texts
        for name, topic in part.topics.items():
            own = self.topics.setdefault(name, Topic(topic.schema, topic.encoding))
            own.messages += topic.messages
            own.size_bytes += topic.size_bytes
        return True

    def log(self, whole: bool) -> Log:
        if self.header is None:
            raise ConfigError(f"{self.path}: no log of FlexMotion, it has no metadata record {SCHEMA!r}")
        plan_columns = parse_schema(self.texts[PLAN]) if self.plans else []
        return Log(
            path=self.path,
            header=self.header,
            rows=self._rows(TICK, self.ticks, TickRow.dtype(joints=len(self.header.joints))),
            events=self.events,
            plans=[decode(plan_columns, message) for message in self.plans],
            targets=self.targets,
            heard=merged(self.heard),
            persons=self._rows(PERSON, self.persons, PersonRow.dtype()),
            files=self.files,
            topics=self.topics,
            whole=whole,
            parts=(self.path,),
        )

    def _rows(self, topic: str, messages: list[bytes], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Messages as rows of this version, column by column: an older log may lack some."""
        rows = blank(dtype, len(messages))
        if not messages:
            return rows
        fields = row_dtype(parse_schema(self.texts[topic])).descr
        logged = np.dtype([("encapsulation", "V", len(ENCAPSULATION)), *fields])
        wrong = {len(message) for message in messages} - {logged.itemsize}
        if wrong:
            raise ConfigError(f"{self.path}: {topic}: {wrong.pop()} bytes, its schema says {logged.itemsize}")
        old = np.frombuffer(b"".join(messages), logged)
        for name in set(dtype.names or ()) & set(logged.names or ()):
            shape = (len(rows), *dtype[name].shape)
            if old[name].size != int(np.prod(shape)):
                raise ConfigError(f"{self.path}: {topic}: {name} has {old[name][0].size} numbers, expected {shape[1:]}")
            rows[name] = old[name].reshape(shape)
        return rows
