"""Child processes end with their parent, however the parent ends."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection

import psutil
import pytest

from flexmotion.drivers.realtime import child

from ...waiting import HANGING_S, wait_until

pytestmark = pytest.mark.wall_clock


def _sleep() -> None:
    time.sleep(10 * HANGING_S)


def _parent(result: Connection) -> None:
    """Start a child, report its process id, and wait to be killed."""
    started = child.start("sleeper", _sleep)
    result.send(started.pid)
    time.sleep(10 * HANGING_S)


def test_a_child_whose_parent_is_killed_ends() -> None:
    result, result_writer = Pipe(duplex=False)
    parent = get_context("fork").Process(target=_parent, args=(result_writer,))
    parent.start()
    orphan = psutil.Process(result.recv())
    wait_until(lambda: orphan.name() == "fm-sleeper", "the child has set its name, and its signals before that")
    assert parent.pid is not None
    os.kill(parent.pid, signal.SIGKILL)
    parent.join()
    orphan.wait(timeout=HANGING_S)


def test_ctrl_c_in_a_terminal_does_not_end_a_child_and_end_does() -> None:
    started = child.start("sleeper", _sleep)
    assert started.pid is not None
    process = psutil.Process(started.pid)
    wait_until(lambda: process.name() == "fm-sleeper", "the child has set its name, and its signals before that")
    assert os.getpgid(started.pid) == started.pid != os.getpgid(0)
    os.kill(started.pid, signal.SIGINT)
    time.sleep(0.05)
    assert started.is_alive()
    child.end(started, patience_s=0.0)
    assert started.exitcode == -signal.SIGKILL
