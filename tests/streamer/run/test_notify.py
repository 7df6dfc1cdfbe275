"""Notifications to a service manager: a real datagram socket listens as systemd does."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexmotion.streamer.run import notify
from flexmotion.streamer.run.notify import Notifier

WATCHDOG_S = 4.0


class Manager:
    """What systemd receives.

    Attributes:
        environment: as a service gets it.
    """

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self._socket.setblocking(False)
        self.environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": str(int(WATCHDOG_S * 1e6)), "PATH": "/bin"}

    def received(self) -> list[str]:
        lines: list[str] = []
        while True:
            try:
                lines += self._socket.recv(4096).decode().splitlines()
            except BlockingIOError:
                return lines

    def close(self) -> None:
        self._socket.close()


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    address = str(tmp_path / "notify") if request.param == "path" else f"@flexmotion-test-{os.getpid()}"
    manager = Manager(address)
    yield manager
    manager.close()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(notify.time, "perf_counter", lambda: now[0])
    return now


def test_ready_is_told_once_the_loop_goes_on(manager: Manager, clock: list[float]) -> None:
    notifier = Notifier(manager.environment)
    notifier.progress(0, "starting")
    assert "READY=1" not in manager.received()
    notifier.progress(1, "OFF")
    assert {"READY=1", "STATUS=OFF"} <= set(manager.received())
    notifier.progress(2, "OFF")
    assert manager.received() == []


def test_the_watchdog_is_fed_by_progress_and_not_by_time(manager: Manager, clock: list[float]) -> None:
    """A supervisor that goes on beside a loop that stands still must not keep the service alive."""
    notifier = Notifier(manager.environment)
    fed = 0
    for count in range(1, 401):  # 8 s of a supervisor that looks every 20 ms
        notifier.progress(count, "STREAMING")
        clock[0] += 0.02
        fed += manager.received().count("WATCHDOG=1")
    assert 8.0 / WATCHDOG_S < fed <= 8.0 / (WATCHDOG_S / 4) + 1
    for _ in range(400):
        notifier.progress(400, "STREAMING")
        clock[0] += 0.02
    assert manager.received().count("WATCHDOG=1") <= 1  # of the last count
    notifier.progress(401, "STREAMING")
    assert "WATCHDOG=1" in manager.received()


def test_the_status_is_told_when_it_changes(manager: Manager, clock: list[float]) -> None:
    notifier = Notifier(manager.environment)
    for status in ("OFF", "OFF", "READY", "x" * 500):
        notifier.progress(1, status)
    told = [line for line in manager.received() if line.startswith("STATUS=")]
    assert told[:2] == ["STATUS=OFF", "STATUS=READY"] and len(told) == 3 and len(told[2]) < 300
    notifier.stopping()
    notifier.stopping()
    assert manager.received() == ["STOPPING=1"]


def test_children_do_not_notify(manager: Manager) -> None:
    Notifier(manager.environment)
    assert manager.environment == {"PATH": "/bin"}


def test_the_watchdog_of_another_process_is_not_fed(manager: Manager, clock: list[float]) -> None:
    notifier = Notifier({**manager.environment, "WATCHDOG_PID": "1"})
    notifier.progress(5, "OFF")
    assert "WATCHDOG=1" not in manager.received()


def test_without_a_service_manager_nothing_happens(tmp_path: Path) -> None:
    Notifier({}).progress(1, "OFF")
    gone = Notifier({"NOTIFY_SOCKET": str(tmp_path / "gone"), "WATCHDOG_USEC": "1000"})
    gone.progress(1, "OFF")
    gone.stopping()
