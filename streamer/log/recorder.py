"""`Recorder`: the service that writes a run to a log file; if it fails, the run goes on."""

from __future__ import annotations

import contextlib
import errno
import logging
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import psutil

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.realtime.ring import shared_array
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.log.cdr import ENCAPSULATION
from flexmotion.streamer.log.header import LogHeader
from flexmotion.streamer.log.log_file import LogFile
from flexmotion.streamer.log.messages import plan_message
from flexmotion.streamer.log.parts import Rotation, later_parts
from flexmotion.streamer.log.writer import LogWriter
from flexmotion.streamer.motion.heard import Heard, HeardChannel, heard_since
from flexmotion.streamer.motion.intents import to_content
from flexmotion.streamer.motion.targets import TargetMailbox, arrived
from flexmotion.streamer.run.requests import Request, RequestChannel

NICENESS = 10
"""Niceness of the recorder's process, which shares two cores with the run."""
_MOST_ROWS = 250
"""Ticks written at a time; the ring holds many more."""
_LINGER_S = 0.5
"""A loop that has not ticked for this long has ended [s]."""

log = logging.getLogger(__name__)


class Recorder:
    """A `Service` that writes ticks, plans, targets, answers and events of a run to an MCAP file.

    It only reads shared memory, so it does not affect loop and planner. After the end or the death of the loop it still
    writes what is left in the rings.

    Args:
        path: path of the file; an existing file is overwritten, and its later parts are removed.
        attachments: files to store in the log, by name.
        heard: the answers to what is asked in the run; None: they are not written.
        items: the answers to the script or the prompt, known before.

    Attributes:
        requests: its channel to the loop, for notes.

    Raises:
        ConfigError: the file cannot be written, or another run writes to it.
    """

    name = "recorder"

    def __init__(
        self,
        path: Path,
        header: LogHeader,
        attachments: Mapping[str, bytes],
        telemetry: Telemetry,
        plans: PlanBuffer,
        targets: TargetMailbox,
        heard: HeardChannel | None = None,
        items: Sequence[Heard] = (),
    ) -> None:
        self.path, self.header, self.attachments = path, header, attachments
        self.telemetry, self.plans, self.targets = telemetry, plans, targets
        self.heard, self.items = heard or HeardChannel(), tuple(items)
        self.requests = RequestChannel()
        self._file = LogFile(path)
        # The first part stays locked while the run goes on in a later one.
        self._lock = self._file.held()
        for part in later_parts(path):
            part.unlink()
        self._status = RecordingStatus()
        self._parent = os.getpid()

    def follow(self) -> Callable[[bool], None]:
        """See `Service.follow`."""
        own_process = os.getpid() != self._parent
        if own_process:
            os.nice(NICENESS)
        following = _Following(self, self._file, self._status)

        def step(last: bool) -> None:
            following.step()
            if last:
                if own_process and self._orphaned():
                    following.follow_to_the_end()
                following.close()
                if not own_process:
                    self.end()

        return step

    def _orphaned(self) -> bool:
        # While a program with several threads dies, its children still see it as their parent, but as a zombie.
        if os.getppid() != self._parent:
            return True
        with contextlib.suppress(psutil.NoSuchProcess):
            return psutil.Process(self._parent).status() in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
        return True

    def end(self) -> None:
        """The run is over: the log is no longer locked."""
        self._file.close()
        self._lock.close()

    def result(self) -> str:
        """Path of the log, and what is missing from it if anything is; after the run."""
        self.end()
        missing = self._status.missing(self.telemetry.ticks.count)
        return f"{self.path} ({missing})" if missing else str(self.path)


class RecordingStatus:
    """State of the recording in shared memory, for the process that started it."""

    def __init__(self) -> None:
        self._cells = shared_array(4, int)

    def set(self, *, error: int, written: int, lost: int, closed: bool) -> None:
        """Set the state.

        Args:
            error: `errno` that ended the recording; 0: none.
            written: ticks in the file.
            lost: ticks that were overwritten before they were read.
            closed: whether the file has its index.
        """
        self._cells[:] = error, written, lost, closed

    def missing(self, ticks: int) -> str:
        """What is missing from the log of a run of `ticks` ticks; empty if nothing is."""
        error, written, lost, closed = (int(cell) for cell in self._cells)
        if error:
            return f"recording stopped: {os.strerror(error)}"
        if not closed or written + lost < ticks:
            return "the recorder ended before the run"
        return f"{lost} ticks lost" if lost else ""


class _Following:
    """A log that is being written.

    Attributes:
        moving: whether the last step found new ticks.
    """

    def __init__(self, recorder: Recorder, file: LogFile, status: RecordingStatus) -> None:
        self.header, self.file, self.status = recorder.header, file, status
        self.plans = recorder.plans
        self.moving = False
        self._ticks, self._events = recorder.telemetry.ticks.reader(), recorder.telemetry.events.reader()
        self._targets, self._heard = recorder.targets.reader(), recorder.heard.reader()
        self._items = list(recorder.items)
        self._plan = self._tick = self._written = self._lost = self._unflushed = 0
        self._state = State.OFF
        self._stopped = False
        self._attachments, self._requests = recorder.attachments, recorder.requests
        self._rotation, self._begun = Rotation(recorder.path, recorder.header.settings.log), 0
        self._writer = LogWriter(file, recorder.header, recorder.attachments)

    def step(self) -> None:
        """Write what is new since the last step."""
        self._record_plan()
        self._record_ticks()
        for target in arrived(self._targets):
            content = {"id": target.id, "stamp_ns": target.stamp_ns, **to_content(target.intent)}
            if math.isfinite(target.holds_s):
                content["holds_s"] = target.holds_s
            self._writer.target(content, self._time(self._tick, target.stamp_ns))
        self._items, heard = [], [*self._items, *heard_since(self._heard)]
        for answer in heard:
            stamp_ns = time.perf_counter_ns()
            content = {"stamp_ns": stamp_ns, **answer.model_dump(mode="json")}
            self._writer.heard(content, self._time(self._tick, stamp_ns))
        for row in self._events.read():
            message = row["message"].decode(errors="replace")
            self._record_event(int(row["tick"]), int(row["stamp_ns"]), row["kind"].decode(), message)
        # Once a second of the run, so that the file is at most that far behind.
        if self._unflushed >= self.header.rate_hz:
            self._flush()

    def follow_to_the_end(self) -> None:
        """Record until the loop has ended: without a supervisor it still brings the robot to a stand."""
        self.moving = True
        while self.moving:
            time.sleep(_LINGER_S)
            self.step()

    def close(self) -> None:
        """Finish the file."""
        if self._state not in (State.OFF, State.FAULT):
            note = f"the log ends in {self._state.name}: the loop died there, was cut short, or is no longer recorded"
            self._record_event(self._tick, time.perf_counter_ns(), "note", note)
        self._flush(last=True)
        self._writer.close()
        self._check(last=True)
        self._update_status(closed=True)

    def _record_ticks(self) -> None:
        first = self._ticks.lost
        self.moving = False
        while len(rows := self._ticks.read(_MOST_ROWS)):
            self.moving = True
            for row in rows:
                self._tick = int(row["tick"])
                message = ENCAPSULATION + row.tobytes()
                self._writer.tick(message, self._time(self._tick, int(row["stamp_ns"])))
            self._state = State(int(rows["state"][-1]))
            self._written += len(rows)
            self._unflushed += len(rows)
        if self._ticks.lost > first:
            self._lost = self._ticks.lost
            note = f"recorder: {self._lost - first} ticks were overwritten before they were read"
            self._record_event(self._tick, time.perf_counter_ns(), "note", note)

    def _record_plan(self) -> None:
        offer = self.plans.observe(self._plan)
        if offer is not None:
            self._plan = offer.ticket.id
            self._writer.plan(plan_message(offer), self._time(offer.ticket.asked_tick, time.perf_counter_ns()))

    def _record_event(self, tick: int, stamp_ns: int, kind: str, message: str) -> None:
        content: dict[str, Any] = {"tick": tick, "stamp_ns": stamp_ns, "kind": kind, "message": message}
        self._writer.event(content, self._time(tick, stamp_ns))

    def _time(self, tick: int, stamp_ns: int) -> int:
        """Log time [ns]: the wall clock; in lockstep the time of the tick at the robot's rate."""
        if self.header.clock == "lockstep":
            return self.header.start_ns + round(tick * 1e9 / self.header.rate_hz)
        return stamp_ns + self.header.wall_minus_perf_ns

    def _flush(self, *, last: bool = False) -> None:
        self._unflushed = 0
        self._writer.flush()
        self._check(last=last)
        self._update_status(closed=False)
        age_s = (self._written - self._begun) / self.header.rate_hz
        if not last and self.file.error is None and self._rotation.due(self.file.tell(), age_s):
            self._rotate()

    def _rotate(self) -> None:
        """Go on in a new part."""
        try:
            file = LogFile(self._rotation.next)
        except ConfigError as error:
            self.file.error = (
                error.__cause__ if isinstance(error.__cause__, OSError) else OSError(errno.EIO, str(error))
            )
            return
        self._writer.close()
        self.file, self._begun = file, self._written
        self._writer = LogWriter(file, self.header, self._attachments)
        for path in self._rotation.advance():
            with contextlib.suppress(OSError):  # a reader of this machine cannot hold a file, but may have removed it
                path.unlink()
            self._requests.send(Request.NOTE, f"log: {path.name} is removed: the parts of a log take more than keep_mb")

    def _check(self, *, last: bool) -> None:
        """Say once that writing has failed: to the run, or on stderr where it is over."""
        if self.file.error is None or self._stopped:
            return
        self._stopped = True
        reason = self.file.error.strerror
        message = f"{self.file.path}: recording stopped at tick {self._tick}: {reason}; the run goes on without a log"
        if last:
            log.warning("%s", message)
        else:
            self._requests.send(Request.NOTE, message)

    def _update_status(self, *, closed: bool) -> None:
        error = 0 if self.file.error is None else self.file.error.errno or errno.EIO
        self.status.set(error=error, written=self._written, lost=self._lost, closed=closed)
