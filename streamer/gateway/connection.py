"""`Messages`: what both clients of a run send, and how they reach it."""

from __future__ import annotations

import itertools
import json
import uuid
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from socket import gaierror
from typing import Any
from urllib.parse import quote

from pydantic import BaseModel, ConfigDict
from websockets.exceptions import InvalidStatus

from flexmotion.configs.errors import GatewayError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import TOKEN_VARIABLE, find_token
from flexmotion.streamer.gateway.messages import FOLLOWED, GET_UP_S, Answer, Ended, MessageError, decode, encode
from flexmotion.streamer.gateway.stop_path import SOURCE_HEADER, STOPS
from flexmotion.streamer.motion.part_intents import RELAXES

_DEFAULT = Gateway()
PATIENCE_S = 10.0
"""Longest wait for an answer [s]; a run answers within its `take_up_s`."""
_ENDS = 256
"""Ends of targets that a client keeps for who asks for them later."""
_LOOK_UP_S = 2.0
"""Longest wait for the port for stops [s]: somebody wants the robot to stop."""


def patience_of(content: Mapping[str, Any]) -> float:
    """Longest wait for the answer to a message [s]: a robot that gets up is answered for when it stands."""
    return GET_UP_S + PATIENCE_S if content.get("get_up") else PATIENCE_S


class StopAnswer(BaseModel):
    """Answer of the stop process.

    Attributes:
        asked: "stop" or "estop".
        state: accepted, or refused for `reason`.
        arrived_tick: newest tick of the loop when the request arrived; -1: none yet.
        tick: before which the loop took it.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    asked: str | None
    state: str
    arrived_tick: int | None = None
    tick: int | None = None
    reason: str | None = None


class Messages:
    """What both clients send.

    Args:
        host, port: of the run.
        stop_port: its port for stops; None: the run is asked for it with every connection. A stop before the first one
            goes to the usual port where the run has the usual port for targets, and asks a run on another port.
        source: name of this program; the run's settings give it a priority.
        token: of the run; None: the environment variable FLEXMOTION_TOKEN, if it is set.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = _DEFAULT.port,
        *,
        stop_port: int | None = None,
        source: str = "client",
        token: str | None = None,
    ) -> None:
        self.host, self.port, self.stop_port, self.source = host, port, stop_port, source
        self._told_stop_port: int | None = None
        self.token = find_token() if token is None else token
        self._ids, self._session = itertools.count(1), uuid.uuid4().hex[:8]
        self._ended = Ends()  # of this connection

    @property
    def url(self) -> str:
        """Of its WebSocket."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"ws://{host}:{self.port}/targets?ends"

    @property
    def options(self) -> dict[str, Any]:
        """Of the connection, for `websockets`."""
        return {
            "additional_headers": self.headers,
            "open_timeout": PATIENCE_S,
            "compression": None,
            "proxy": None,
        }

    @property
    def headers(self) -> dict[str, str]:
        """Headers of HTTP: the token, and the name of this program."""
        token = {} if self.token is None else {"Authorization": f"Bearer {self.token}"}
        return {SOURCE_HEADER: quote(self.source), **token}

    def message(self, content: Mapping[str, Any]) -> tuple[str, str]:
        """The id and the text of a message. Raises `MessageError` where it is not valid."""
        if not isinstance(content, Mapping):
            raise MessageError(f"message: {content!r}, expected a mapping such as {{'type': 'text', 'text': 'wave'}}")
        known = {key: value for key, value in content.items() if value is not None}
        number = next(self._ids)
        identity = str(known.setdefault("id", f"{self._session}-{number}"))
        known = {"source": self.source, "sequence": number, **known}
        return identity, encode(decode(json.dumps(known).encode()))

    def failed(self, error: Exception, port: int | None = None) -> GatewayError:
        """What to raise for an error of the connection to a port; None: to that for targets."""
        where = f"{self.host}:{self.port if port is None else port}"
        if isinstance(error, InvalidStatus):
            return GatewayError(f"{where}: the run refuses the connection: {self._refusal(error)}")
        if isinstance(error, ConnectionRefusedError):
            return GatewayError(f"{where}: no run listens; start one with: flexmotion dry-run --web")
        if isinstance(error, gaierror):
            return GatewayError(f"{where}: no machine of this name is known: {error.strerror}")
        return GatewayError(f"{where}: {type(error).__name__}: {error}")

    def fetch(self, method: str, port: int, path: str, patience_s: float = PATIENCE_S) -> dict[str, Any]:
        """Ask over HTTP, with the token.

        Raises:
            GatewayError: no run listens, it refuses the request, or it does not answer in time.
        """
        status, content = self._fetched(method, port, path, patience_s)
        if status in (401, 403):
            reason = self._token_refused if status == 401 else content.get("reason")
            raise GatewayError(f"{self.host}:{port}: refused: {reason}")
        return content

    def press(self, what: str) -> StopAnswer:
        """Ask the stop process for "stop" or "estop"."""
        return StopAnswer.model_validate(self.fetch("POST", self.find_stop_port(), f"/{what}"))

    def learn_stop_port(self) -> None:
        """Find the port for stops while the gateway answers: a stop must not wait for a busy or dead one."""
        if self.stop_port is None:
            self._told_stop_port = None
            with suppress(GatewayError):  # told at the first stop, which asks again
                self._told_stop_port = self._asked_stop_port()

    def find_stop_port(self) -> int:
        """The port for stops: as given, as the run has told, the usual one beside the usual port, else as it tells now.

        Raises:
            GatewayError: the run does not tell it.
        """
        known = self.stop_port or self._told_stop_port
        if known is None and self.port == _DEFAULT.port:
            return _DEFAULT.stop_port
        return self._asked_stop_port() if known is None else known

    def _asked_stop_port(self) -> int:
        """The port for stops, as the run tells now. Raises `GatewayError` where it does not."""
        give = "its port for stops is not known, give it: --stop-port, or Client(stop_port=...)"
        try:
            content = self.fetch("GET", self.port, STOPS, patience_s=_LOOK_UP_S)
        except GatewayError as error:
            raise GatewayError(f"{error}; {give}") from error
        if not isinstance(content.get("stop_port"), int):
            raise GatewayError(f"{self.host}:{self.port}: {give}")
        return int(content["stop_port"])

    needs_token = f"it needs its token: set {TOKEN_VARIABLE}, or give --token-file or Client(token=...)"

    @property
    def _token_refused(self) -> str:
        return self.needs_token if self.token is None else "the token is not that of this run"

    def _refusal(self, error: InvalidStatus) -> str:
        """Why the run has not opened a WebSocket: its refusal says no more than a number, that of HTTP says why."""
        body = error.response.body
        if body and b"POST /estop" in body:
            return f"{self.port} is its port for stops, expected that for targets (--web-port)"
        if error.response.status_code != 403:
            return body.decode(errors="replace") if body else str(error)
        try:
            status, content = self._fetched("GET", self.port, "/status")
        except GatewayError:
            return str(error)
        return self._token_refused if status == 401 else str(content.get("reason", error))

    def _fetched(self, method: str, port: int, path: str, patience_s: float = PATIENCE_S) -> tuple[int, dict[str, Any]]:
        connection = HTTPConnection(self.host, port, timeout=patience_s)
        try:
            connection.request(method, path, headers=self.headers)
            response = connection.getresponse()
            return response.status, dict(json.loads(response.read()))
        except (OSError, HTTPException, ValueError) as error:
            raise self.failed(error, port) from error
        finally:
            connection.close()


class Ends:
    """The ends of the newest targets of one connection, by number."""

    def __init__(self) -> None:
        self._told: OrderedDict[int, Ended | None] = OrderedDict()

    def take(self, answer: Answer) -> None:
        """Expect the end of a target that was answered; the oldest beyond `_ENDS` is forgotten."""
        if answer.target is not None:
            self._told.setdefault(answer.target, None)
            while len(self._told) > _ENDS:
                self._told.popitem(last=False)

    def add(self, ended: Ended) -> None:
        """Keep the end of a target."""
        if ended.target in self._told:
            self._told[ended.target] = ended

    def of(self, target: int) -> Ended | None:
        """The end of a target; None: not told yet.

        Raises:
            GatewayError: it was not asked for on this connection, to which alone its end is told, or long ago.
        """
        if target not in self._told:
            raise GatewayError(f"target {target} is none of the newest {_ENDS} of this connection: its end is not told")
        return self._told[target]


def awaited(answer: Answer) -> int:
    """Number of the target whose end is waited for.

    Raises:
        GatewayError: the target is not followed, or it lets something go, which has no end.
    """
    if answer.target is None or answer.state not in (*FOLLOWED, "moved"):
        raise GatewayError(f"{answer.asked}: {answer.state}: {answer.reason or 'it is no target'}: it has no end")
    if answer.part is not None and answer.part.startswith(RELAXES):
        raise GatewayError(f"{answer.asked}: {answer.part}: its answer is its end")
    return answer.target


def answer_in(frame: str | bytes) -> Answer | Ended | None:
    """The answer, or the end of a target, in a frame; None where it holds something else, such as the status.

    Raises:
        ValueError: it is no JSON object, or no answer.
    """
    content = json.loads(frame)
    if not isinstance(content, dict):
        raise ValueError(f"{frame[:80]!r}: expected a JSON object")
    if content.get("type") == "ended":
        return Ended.model_validate(content)
    return Answer.model_validate(content) if content.get("type") == "answer" else None
