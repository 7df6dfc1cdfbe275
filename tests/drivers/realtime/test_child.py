"""Children end with their parent, whichever way that ends."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection

import psutil
import pytest

from flexmotion.drivers.realtime import child

pytestmark = pytest.mark.wall_clock


def _sleep() -> None:
    time.sleep(60.0)


def _parent(say: Connection) -> None:
    """A process that starts a child and is then killed."""
    started = child.start("sleeper", _sleep)
    say.send(started.pid)
    time.sleep(60.0)


def test_a_child_whose_parent_is_killed_ends() -> None:
    hear, say = Pipe(duplex=False)
    parent = get_context("fork").Process(target=_parent, args=(say,))
    parent.start()
    orphan = psutil.Process(hear.recv())
    end = time.monotonic() + 2.0
    while orphan.name() != "fm-sleeper" and time.monotonic() < end:
        time.sleep(0.005)  # it has not named itself yet
    assert orphan.name() == "fm-sleeper"
    assert parent.pid is not None
    os.kill(parent.pid, signal.SIGKILL)
    parent.join()
    orphan.wait(timeout=2.0)


def test_a_terminals_ctrl_c_does_not_reach_a_child_and_end_does() -> None:
    started = child.start("sleeper", _sleep)
    assert started.pid is not None
    while psutil.Process(started.pid).name() != "fm-sleeper":
        time.sleep(0.005)  # it does not ignore Ctrl-C yet
    os.kill(started.pid, signal.SIGINT)
    time.sleep(0.05)
    assert started.is_alive()
    child.end(started, patience_s=0.0)
    assert started.exitcode == -signal.SIGKILL
