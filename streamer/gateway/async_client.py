"""`AsyncClient`: `flexmotion.streamer.gateway.client.Client` for asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Mapping
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Any, Self

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.gateway.connection import (
    Ends,
    Messages,
    StopAnswer,
    answer_in,
    awaited,
    patience_of,
)
from flexmotion.streamer.gateway.message_methods import MessageMethods
from flexmotion.streamer.gateway.messages import Answer, Ended


class AsyncClient(Messages, MessageMethods[Coroutine[Any, Any, Answer]]):
    """`Client` for asyncio; any number of messages may wait for their answers at a time.

    Raises:
        GatewayError: as `Client`.
        MessageError: a message is not valid.
    """

    _socket: ClientConnection | None = None

    async def __aenter__(self) -> Self:
        self._waiting: dict[str, asyncio.Future[Answer]] = {}
        self._ended, self._news, self._gone = Ends(), asyncio.Condition(), False
        self._failed: GatewayError | None = None
        self._open = AsyncExitStack()
        try:
            self._socket = await self._open.enter_async_context(connect(self.url, **self.options))
        except (OSError, WebSocketException) as error:
            raise await asyncio.to_thread(self.failed, error) from error
        try:
            await asyncio.to_thread(self.learn_stop_port)
        except asyncio.CancelledError:
            await self._open.aclose()
            raise
        self._reading = asyncio.create_task(self._read())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._open.aclose()
        await self._reading

    async def stop(self) -> StopAnswer:
        """Come to a stand and stay, by the stop process; see `Client.stop`."""
        return await asyncio.to_thread(self.press, "stop")

    async def estop(self) -> StopAnswer:
        """Stop as the robot file says, then park, by the stop process."""
        return await asyncio.to_thread(self.press, "estop")

    async def status(self) -> dict[str, Any]:
        """The run now; see `Client.status`."""
        return await asyncio.to_thread(self.fetch, "GET", self.port, "/status")

    async def ask(self, message: Mapping[str, Any]) -> Answer:
        """Send any message and wait for its answer."""
        assert self._socket is not None, "async with AsyncClient() as robot: robot.ask(...)"
        if self._failed is not None:
            raise self._failed
        identity, text = self.message(message)
        answered: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        self._waiting[identity] = answered
        try:
            await self._socket.send(text)
            return await asyncio.wait_for(answered, patience_of(message))
        except (OSError, WebSocketException) as error:  # TimeoutError is an OSError
            raise self.failed(error) from error
        finally:
            self._waiting.pop(identity, None)

    async def wait(self, answer: Answer, *, patience_s: float | None = None) -> Ended:
        """Wait for the end of a target; see `Client.wait`."""
        target = awaited(answer)
        try:
            async with asyncio.timeout(patience_s), self._news:
                while (ended := self._ended.of(target)) is None:
                    if self._gone:
                        raise self._failed or self.failed(ConnectionResetError("the run closed the connection"))
                    await self._news.wait()
        except TimeoutError:
            raise GatewayError(f"target {target} has not ended within {patience_s:g} s") from None
        return ended

    async def closed(self) -> None:
        """Come back when the run has closed the connection."""
        await asyncio.shield(self._reading)

    async def _read(self) -> None:
        assert self._socket is not None
        try:
            async for frame in self._socket:
                try:
                    answer = answer_in(frame)
                except ValueError as error:
                    self._failed = GatewayError(f"{self.host}:{self.port}: the run sent what is no answer: {error}")
                    await self._socket.close()
                    break
                if isinstance(answer, Ended):
                    async with self._news:
                        self._ended.add(answer)
                        self._news.notify_all()
                    continue
                waiting = None if answer is None or answer.id is None else self._waiting.get(answer.id)
                if waiting is not None and not waiting.done():
                    assert answer is not None
                    self._ended.take(answer)
                    waiting.set_result(answer)
        except WebSocketException:
            pass  # those that wait are told below
        async with self._news:
            self._gone = True
            self._news.notify_all()
        for waiting in self._waiting.values():
            if not waiting.done():
                waiting.set_exception(self._failed or ConnectionResetError("the run closed the connection"))
                # Told where it is asked for; one that nobody asks for any more is no error of the program.
                waiting.exception()
