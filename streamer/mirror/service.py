"""`MirrorService`: the process that receives frames of a person over UDP and publishes their poses.

It is no part of the planner's loop: a flood, a slow frame or its death costs the run nothing but the person, who is
then silent.
"""

from __future__ import annotations

import ipaddress
import selectors
import socket
import threading
import time
from collections.abc import Callable

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.intake import Intake
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.run.requests import Request, RequestChannel

PORT = 39539
"""Port that senders of the Virtual Motion Capture protocol use where nothing else is set."""
_BUFFER_BYTES = 1 << 18
"""Of the socket: half a second of frames. What comes faster than it is read is lost there."""
_LARGEST = 65536
_WAIT_S = 0.1
_CLOSE_S = 1.0


def parse_address(text: str, field: str = "--mirror") -> tuple[str, int]:
    """Host and port of `HOST:PORT`, `HOST`, `:PORT` or `PORT`; the defaults are 127.0.0.1 and `PORT`.

    Raises:
        ConfigError: the host is no IP address, or the port is out of range.
    """
    host, colon, port = text.rpartition(":")
    if not colon:
        host, port = ("", text) if text.isdecimal() else (text, "")
    host = host.strip("[]") or "127.0.0.1"
    host = "127.0.0.1" if host == "localhost" else host
    try:
        ipaddress.ip_address(host)
        number = int(port or PORT)
    except ValueError as error:
        raise ConfigError(f"{field}: {text!r}, expected ADDRESS:PORT, such as 127.0.0.1:{PORT}") from error
    if not 1 <= number <= 65535:
        raise ConfigError(f"{field}: port {number}, expected 1 to 65535")
    return host, number


class MirrorService:
    """A `Service` that receives frames; see `docs/live.md`.

    Args:
        host, port: listened to.
        token: that senders of other machines show; needed where they reach the address.
        channel: for the poses.
        mapping: of the skeleton; see `Intake`.

    Attributes:
        requests: its channel to the loop, for notes.

    Raises:
        ConfigError: the port is taken, or the address needs a token.
    """

    name = "mirror"

    def __init__(
        self, host: str, port: int, token: str | None, channel: PersonChannel, mapping: str | None = None
    ) -> None:
        self.host, self.port, self.mapping = host, port, mapping
        self.admission, self.channel = Admission(host, token), channel
        self.requests = RequestChannel()
        # Bound here, so that a port that is taken is known before the robot moves.
        self._socket = _bound(host, port)

    def follow(self) -> Callable[[bool], None]:
        """See `Service.follow`: the socket has a thread of its own, which a pause between two calls does not delay."""
        receiver = _Receiver(self, self._socket)

        def step(last: bool) -> None:
            if last:
                receiver.close()
            elif receiver.error is not None:
                raise receiver.error

        return step

    def end(self) -> None:
        """The run is over: the port is free again."""
        self._socket.close()


class _Receiver:
    """The thread of the socket.

    Attributes:
        error: that ended it; None while it runs.
    """

    def __init__(self, service: MirrorService, receiving: socket.socket) -> None:
        def note(message: str) -> None:
            service.requests.send(Request.NOTE, message)

        self.intake = Intake(service.admission, service.channel, service.mapping, note)
        self.error: BaseException | None = None
        self._socket, self._ended = receiving, threading.Event()
        self._thread = threading.Thread(target=self._run, name="mirror", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        try:
            with selectors.DefaultSelector() as selector:
                selector.register(self._socket, selectors.EVENT_READ)
                while not self._ended.is_set():
                    if selector.select(_WAIT_S):
                        self._receive()
        except BaseException as error:  # for the main thread, which ends the process with it
            self.error = error

    def _receive(self) -> None:
        while not self._ended.is_set():
            try:
                datagram, address = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            self.intake.take(datagram, address[:2], time.perf_counter())


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    receiving = socket.socket(family, socket.SOCK_DGRAM)
    try:
        receiving.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        receiving.bind((host, port))
    except OSError as error:
        receiving.close()
        raise ConfigError(f"--mirror: {host}:{port} cannot be listened on: {error.strerror or error}") from error
    receiving.setblocking(False)
    return receiving
