"""`Client`, `AsyncClient`: another program's side of a run that was started with `--web`.

```python
import flexmotion as fm

with fm.Client() as robot:
    print(robot.text("wave with the right hand"))
    robot.velocity(0.3, 0.0, 0.0, ttl_s=4.0)
    print(robot.status()["state"])
```
"""

from __future__ import annotations

import asyncio
import itertools
import json
import uuid
from collections.abc import Mapping
from contextlib import AsyncExitStack, ExitStack
from http.client import HTTPConnection, HTTPException
from types import TracebackType
from typing import Any, Self

from pydantic import BaseModel, ConfigDict
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import connect

from flexmotion.configs.errors import GatewayError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import find_token
from flexmotion.streamer.gateway.messages import Answer, KillMessage, MessageError, decode, encode

_DEFAULT = Gateway()
PATIENCE_S = 10.0
"""Longest wait for an answer [s]; a run answers within its `take_up_s`."""


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


class _Messages:
    """What both clients send.

    Args:
        host, port, stop_port: of the run.
        source: name of this program; the run's settings give it a priority.
        token: of the run; None: the environment variable FLEXMOTION_TOKEN, if it is set.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = _DEFAULT.port,
        *,
        stop_port: int = _DEFAULT.stop_port,
        source: str = "client",
        token: str | None = None,
    ) -> None:
        self.host, self.port, self.stop_port, self.source = host, port, stop_port, source
        self.token = find_token() if token is None else token
        self._ids, self._session = itertools.count(1), uuid.uuid4().hex[:8]

    @property
    def _url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"ws://{host}:{self.port}/targets"

    @property
    def _options(self) -> dict[str, Any]:
        return {
            "additional_headers": self._headers,
            "open_timeout": PATIENCE_S,
            "compression": None,
            "proxy": None,
        }

    @property
    def _headers(self) -> dict[str, str]:
        return {} if self.token is None else {"Authorization": f"Bearer {self.token}"}

    def _message(self, content: Mapping[str, Any]) -> tuple[str, str]:
        """The id and the text of a message. Raises `MessageError` where it is not valid."""
        known = {key: value for key, value in content.items() if value is not None}
        number = next(self._ids)
        identity = str(known.setdefault("id", f"{self._session}-{number}"))
        known = {"source": self.source, "sequence": number, **known}
        return identity, encode(decode(json.dumps(known).encode()))

    def _failed(self, error: Exception) -> GatewayError:
        where = f"{self.host}:{self.port}"
        if isinstance(error, InvalidStatus):
            reason = error.response.body.decode(errors="replace") if error.response.body else str(error)
            return GatewayError(f"{where}: the run refuses the connection: {reason}")
        if isinstance(error, ConnectionRefusedError):
            return GatewayError(f"{where}: no run listens; start one with: flexmotion dry-run --web")
        return GatewayError(f"{where}: {type(error).__name__}: {error}")


def _text(text: str, ttl_s: float | None) -> dict[str, Any]:
    return {"type": "text", "text": text, "ttl_s": ttl_s}


def _velocity(forward: float, left: float, turning: float, ttl_s: float | None) -> dict[str, Any]:
    return {"type": "velocity", "velocity": [forward, left, turning], "ttl_s": ttl_s}


_KILL = {"type": "kill", "confirm": KillMessage.model_fields["confirm"].annotation.__args__[0]}  # type: ignore[union-attr]


class Client(_Messages):
    """A connection to a run, for a program that waits for each answer; see `AsyncClient` for one that does not.

    Raises:
        GatewayError: no run listens, it refuses the connection, or it does not answer in time.
        MessageError: a message is not valid.
    """

    _socket: Any = None
    _open: ExitStack

    def __enter__(self) -> Self:
        self._connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; what the robot follows stays as it is until its time is over."""
        if self._socket is not None:
            self._socket = None
            self._open.close()

    def text(self, text: str, *, ttl_s: float | None = None) -> Answer:
        """Do what the words say."""
        return self.ask(_text(text, ttl_s))

    def velocity(self, forward: float, left: float, turning: float, *, ttl_s: float | None = None) -> Answer:
        """Walk at a velocity: forward, left [m/s], turning left [rad/s]; for half a second without `ttl_s`."""
        return self.ask(_velocity(forward, left, turning, ttl_s))

    def hold(self) -> Answer:
        """Come to a stand; the next target goes on from there."""
        return self.ask({"type": "hold"})

    def clear(self) -> Answer:
        """Release a STOP."""
        return self.ask({"type": "clear"})

    def take(self) -> Answer:
        """Take the operator's lease over."""
        return self.ask({"type": "take"})

    def release(self) -> Answer:
        """Give the operator's lease back."""
        return self.ask({"type": "release"})

    def kill(self) -> Answer:
        """Switch the torque off at once: the robot falls."""
        return self.ask(_KILL)

    def stop(self) -> StopAnswer:
        """Come to a stand and stay, by the stop process; needs no token."""
        return self._press("stop")

    def estop(self) -> StopAnswer:
        """Freeze, then park, by the stop process."""
        return self._press("estop")

    def status(self) -> dict[str, Any]:
        """The run now: `flexmotion.streamer.gateway.status.Status` as JSON."""
        return self._http("GET", self.port, "/status")

    def ask(self, message: Mapping[str, Any]) -> Answer:
        """Send any message of `flexmotion.streamer.gateway.messages` and wait for its answer."""
        identity, text = self._message(message)
        self._connect()
        try:
            self._socket.send(text)
            while True:
                answer = _answer(self._socket.recv(PATIENCE_S))
                if answer is not None and answer.id == identity:
                    return answer
        except (OSError, WebSocketException) as error:
            self.close()
            raise self._failed(error) from error

    def _connect(self) -> None:
        if self._socket is not None:
            return
        self._open = ExitStack()
        try:
            self._socket = self._open.enter_context(connect(self._url, **self._options))
        except (OSError, WebSocketException) as error:
            raise self._failed(error) from error

    def _press(self, what: str) -> StopAnswer:
        return StopAnswer.model_validate(self._http("POST", self.stop_port, f"/{what}"))

    def _http(self, method: str, port: int, path: str) -> dict[str, Any]:
        connection = HTTPConnection(self.host, port, timeout=PATIENCE_S)
        try:
            connection.request(method, path, headers=self._headers)
            response = connection.getresponse()
            content = json.loads(response.read())
        except (OSError, HTTPException, ValueError) as error:
            failed = self._failed(error)
            raise GatewayError(str(failed).replace(f":{self.port}:", f":{port}:")) from error
        finally:
            connection.close()
        if response.status in (401, 403):
            raise GatewayError(f"{self.host}:{port}: refused: {content.get('reason')}")
        return dict(content)


class AsyncClient(_Messages):
    """`Client` for asyncio; any number of messages may wait for their answers at a time.

    Raises:
        GatewayError: as `Client`.
        MessageError: a message is not valid.
    """

    _socket: ClientConnection | None = None

    async def __aenter__(self) -> Self:
        self._waiting: dict[str, asyncio.Future[Answer]] = {}
        self._open = AsyncExitStack()
        try:
            self._socket = await self._open.enter_async_context(connect_async(self._url, **self._options))
        except (OSError, WebSocketException) as error:
            raise self._failed(error) from error
        self._reading = asyncio.create_task(self._read())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._open.aclose()
        await self._reading

    async def text(self, text: str, *, ttl_s: float | None = None) -> Answer:
        """Do what the words say."""
        return await self.ask(_text(text, ttl_s))

    async def velocity(self, forward: float, left: float, turning: float, *, ttl_s: float | None = None) -> Answer:
        """Walk at a velocity; see `Client.velocity`."""
        return await self.ask(_velocity(forward, left, turning, ttl_s))

    async def hold(self) -> Answer:
        """Come to a stand; the next target goes on from there."""
        return await self.ask({"type": "hold"})

    async def ask(self, message: Mapping[str, Any]) -> Answer:
        """Send any message and wait for its answer."""
        assert self._socket is not None, "async with AsyncClient() as robot: robot.ask(...)"
        identity, text = self._message(message)
        answered: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        self._waiting[identity] = answered
        try:
            await self._socket.send(text)
            return await asyncio.wait_for(answered, PATIENCE_S)
        except (OSError, WebSocketException) as error:  # TimeoutError is an OSError
            raise self._failed(error) from error
        finally:
            self._waiting.pop(identity, None)

    async def closed(self) -> None:
        """Come back when the run has closed the connection."""
        await asyncio.shield(self._reading)

    async def _read(self) -> None:
        assert self._socket is not None
        try:
            async for frame in self._socket:
                answer = _answer(frame)
                waiting = None if answer is None or answer.id is None else self._waiting.get(answer.id)
                if waiting is not None and not waiting.done():
                    assert answer is not None
                    waiting.set_result(answer)
        except WebSocketException:
            pass  # those that wait are told below
        for waiting in self._waiting.values():
            if not waiting.done():
                waiting.set_exception(ConnectionResetError("the run closed the connection"))


def _answer(frame: str | bytes) -> Answer | None:
    """The answer in a frame; None where it holds something else, such as the status."""
    content = json.loads(frame)
    return Answer.model_validate(content) if content.get("type") == "answer" else None


__all__ = ["AsyncClient", "Client", "MessageError", "StopAnswer"]
