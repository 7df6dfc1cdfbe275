"""`Recorder`: the service that writes a run to a log file; if it fails, the run goes on."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import psutil

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.realtime.ring import shared_array
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.log.following import Following, Published
from flexmotion.streamer.log.log_file import LogFile
from flexmotion.streamer.log.parts import Rotation, later_parts
from flexmotion.streamer.log.writer import LogWriter
from flexmotion.streamer.run.requests import Request, RequestChannel

NICENESS = 10
"""Niceness of the recorder's process, which shares two cores with the run."""
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
        published: by the run.

    Attributes:
        requests: its channel to the loop, for notes.

    Raises:
        ConfigError: the file cannot be written, or another run writes to it.
    """

    name = "recorder"

    def __init__(self, path: Path, attachments: Mapping[str, bytes], published: Published) -> None:
        self.path, self.attachments, self.published = path, attachments, published
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
        recording = _Recording(self, self._file, self._status)

        def step(last: bool) -> None:
            recording.step()
            if last:
                if own_process and self._orphaned():
                    recording.follow_to_the_end()
                recording.close()
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
        missing = self._status.missing(self.published.telemetry.ticks.count)
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


class _Recording:
    """A log that is being written."""

    def __init__(self, recorder: Recorder, file: LogFile, status: RecordingStatus) -> None:
        self.header, self.file, self.status = recorder.published.header, file, status
        self._attachments, self._requests = recorder.attachments, recorder.requests
        self._rotation = Rotation(recorder.path, self.header.settings.log)
        self._flushed = self._begun = 0  # ticks that were written before the last flush, and before this part
        self._stopped = False
        self._writer = LogWriter(file, self.header, recorder.attachments)
        self._following = Following(recorder.published, self._writer)

    def step(self) -> None:
        """Write what is new since the last step."""
        self._following.step()
        # Once a second of the run, so that the file is at most that far behind.
        if self._following.passed - self._flushed >= self.header.rate_hz:
            self._flush()

    def follow_to_the_end(self) -> None:
        """Record until the loop has ended: without a supervisor it still brings the robot to a stand."""
        moving = True
        while moving:
            time.sleep(_LINGER_S)
            self.step()
            moving = self._following.moving

    def close(self) -> None:
        """Finish the file."""
        following = self._following
        if following.state not in (State.OFF, State.FAULT):
            state = following.state.name
            note = f"the log ends in {state}: the loop died there, was cut short, or is no longer recorded"
            following.event(following.tick, time.perf_counter_ns(), "note", note)
        self._flush(last=True)
        self._writer.close()
        self._check(last=True)
        self._update_status(closed=True)

    def _flush(self, *, last: bool = False) -> None:
        self._flushed = self._following.passed
        self._writer.flush()
        self._check(last=last)
        self._update_status(closed=False)
        age_s = (self._following.passed - self._begun) / self.header.rate_hz
        if not last and self.file.error is None and self._rotation.due(self.file.tell(), age_s):
            self._rotate()

    def _rotate(self) -> None:
        """Go on in a new part."""
        try:
            file = LogFile(self._rotation.next)
        except ConfigError as error:
            cause = error.__cause__
            self.file.error = cause if isinstance(cause, OSError) else OSError(errno.EIO, str(error))
            return
        self._writer.close()
        self.file, self._begun = file, self._following.passed
        self._writer = self._following.sink = LogWriter(file, self.header, self._attachments)
        for path in self._rotation.advance():
            with contextlib.suppress(OSError):  # somebody else has removed it
                path.unlink()
            self._requests.send(Request.NOTE, f"log: {path.name} is removed: the parts of a log take more than keep_mb")

    def _check(self, *, last: bool) -> None:
        """Say once that writing has failed: to the run, or on stderr where it is over."""
        if self.file.error is None or self._stopped:
            return
        self._stopped = True
        place, reason = f"recording stopped at tick {self._following.tick}", self.file.error.strerror
        message = f"{self.file.path}: {place}: {reason}; the run goes on without a log"
        if last:
            log.warning("%s", message)
        else:
            self._requests.send(Request.NOTE, message)

    def _update_status(self, *, closed: bool) -> None:
        error = 0 if self.file.error is None else self.file.error.errno or errno.EIO
        following = self._following
        self.status.set(error=error, written=following.passed, lost=following.lost, closed=closed)
