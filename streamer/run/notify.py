"""`Notifier`: tells the service manager (systemd) that the run is ready, what it does, and that its loop goes on.

The protocol is one datagram of `NAME=VALUE` lines to the socket in `NOTIFY_SOCKET` (sd_notify(3)). Without that
variable nothing is sent.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import MutableMapping

_FED_SHARE = 0.25
"""Share of the watchdog's time after which it is fed again, if the loop has gone on."""
_LONGEST_STATUS = 200


class Notifier:
    """One run's connection to the service manager.

    The watchdog is fed by the loop's progress: a supervisor that runs on beside a loop that stands does not feed it.

    Args:
        environment: of the process; `NOTIFY_SOCKET` is taken out of it, since no child process may notify.
    """

    def __init__(self, environment: MutableMapping[str, str] = os.environ) -> None:
        self._address = environment.pop("NOTIFY_SOCKET", "")
        pid, microseconds = environment.pop("WATCHDOG_PID", ""), environment.pop("WATCHDOG_USEC", "")
        ours = pid in ("", str(os.getpid())) and microseconds.isdecimal()
        self._feed_s = int(microseconds) * 1e-6 * _FED_SHARE if ours and int(microseconds) else None
        self._fed_s = -float("inf")
        self._seen: int | None = None
        self._ready = self._stopping = False
        self._status = ""

    def progress(self, count: int, status: str) -> None:
        """The loop has got so far: feed the watchdog if that is further than before.

        Args:
            count: of what the loop has done, ascending while it goes on.
            status: what the run does now, for `systemctl status`.
        """
        if not self._address:
            return
        lines = []
        if count and not self._ready:
            self._ready = True
            lines.append("READY=1")
        if status != self._status:
            self._status = status
            lines.append(f"STATUS={status[:_LONGEST_STATUS]}")
        now = time.perf_counter()
        if self._feed_s is not None and count != self._seen and now - self._fed_s >= self._feed_s:
            self._seen, self._fed_s = count, now
            lines.append("WATCHDOG=1")
        self._send(lines)

    def stopping(self) -> None:
        """The run comes to its end."""
        if not self._stopping:
            self._stopping = True
            self._send(["STOPPING=1"])

    def _send(self, lines: list[str]) -> None:
        if not lines or not self._address:
            return
        # A leading @ means the abstract name space.
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
                sender.setblocking(False)
                sender.sendto("\n".join(lines).encode(), address)
        except OSError:
            return  # nobody listens any more, or too slowly: the run does not depend on it
