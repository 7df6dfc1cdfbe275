"""`AsyncClient`: `flexmotion.streamer.gateway.client.Client` for asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
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
    clear_content,
    heading_content,
    kill_content,
    part_content,
    patience_of,
    text_content,
    velocity_content,
    waypoint_content,
)
from flexmotion.streamer.gateway.messages import Answer, Ended
from flexmotion.streamer.motion.part_values import Side
from flexmotion.streamer.motion.restriction_intents import Foot, Limb


class AsyncClient(Messages):
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

    async def text(self, text: str, *, ttl_s: float | None = None) -> Answer:
        """Do what the words say."""
        return await self.ask(text_content(text, ttl_s))

    async def velocity(self, forward: float, left: float, turning: float, *, ttl_s: float | None = None) -> Answer:
        """Walk at a velocity; see `Client.velocity`."""
        return await self.ask(velocity_content(forward, left, turning, ttl_s))

    async def heading(self, heading: float, *, turning: float | None = None, ttl_s: float | None = None) -> Answer:
        """Turn to a heading; see `Client.heading`."""
        return await self.ask(heading_content(heading, turning, ttl_s))

    async def waypoint(
        self,
        x: float,
        y: float,
        heading: float | None = None,
        *,
        tolerance_m: float | None = None,
        ttl_s: float | None = None,
    ) -> Answer:
        """Walk to a place; see `Client.waypoint`."""
        return await self.ask(waypoint_content(x, y, heading, tolerance_m, ttl_s))

    async def hand(
        self,
        side: Side,
        x: float,
        y: float,
        z: float,
        *,
        in_s: float | None = None,
        tolerance_m: float | None = None,
        ttl_s: float | None = None,
    ) -> Answer:
        """See `Client.hand`."""
        return await self.ask(
            part_content("hand", in_s, ttl_s, side=side, position_m=[x, y, z], tolerance_m=tolerance_m)
        )

    async def foot(
        self,
        side: Side,
        x: float,
        y: float,
        heading: float | None = None,
        *,
        in_s: float | None = None,
        tolerance_m: float | None = None,
        ttl_s: float | None = None,
    ) -> Answer:
        """See `Client.foot`."""
        return await self.ask(
            part_content(
                "foot", in_s, ttl_s, side=side, position_m=[x, y], heading_rad=heading, tolerance_m=tolerance_m
            )
        )

    async def point(
        self, side: Side, x: float, y: float, z: float, *, in_s: float | None = None, ttl_s: float | None = None
    ) -> Answer:
        """See `Client.point`."""
        return await self.ask(part_content("point", in_s, ttl_s, side=side, direction=[x, y, z]))

    async def look(
        self, x: float, y: float, z: float, *, in_s: float | None = None, ttl_s: float | None = None
    ) -> Answer:
        """See `Client.look`."""
        return await self.ask(part_content("look", in_s, ttl_s, direction=[x, y, z]))

    async def joint(self, joint: str, angle: float, *, in_s: float | None = None, ttl_s: float | None = None) -> Answer:
        """See `Client.joint`."""
        return await self.ask(part_content("joint", in_s, ttl_s, joint=joint, angle_rad=angle))

    async def contact(self, foot: Foot, *, ttl_s: float | None = None) -> Answer:
        """See `Client.contact`."""
        return await self.ask({"type": "contact", "foot": foot, "ttl_s": ttl_s})

    async def torque(self, joint: str, limit: float, *, ttl_s: float | None = None) -> Answer:
        """See `Client.torque`."""
        return await self.ask({"type": "torque", "joint": joint, "limit_nm": limit, "ttl_s": ttl_s})

    async def tension(self, limb: Limb, tension: float, *, ttl_s: float | None = None) -> Answer:
        """See `Client.tension`."""
        return await self.ask({"type": "tension", "limb": limb, "tension": tension, "ttl_s": ttl_s})

    async def relax(self, part: str = "all") -> Answer:
        """See `Client.relax`."""
        return await self.ask({"type": "relax", "part": part})

    async def clip(self, name: str, *, ttl_s: float | None = None) -> Answer:
        """Follow a clip that the run was started with, by its name."""
        return await self.ask({"type": "clip", "clip": name, "ttl_s": ttl_s})

    async def hold(self) -> Answer:
        """Come to a stand; the next target goes on from there."""
        return await self.ask({"type": "hold"})

    async def arm(self) -> Answer:
        """Switch the torque on: the robot stands up."""
        return await self.ask({"type": "arm"})

    async def disarm(self) -> Answer:
        """Come to a stand, park, switch the torque off; the run goes on."""
        return await self.ask({"type": "disarm"})

    async def limp(self, *joints: str) -> Answer:
        """Switch the torque of joints of arms and head off; the robot stands until they are stiff again."""
        return await self.ask({"type": "limp", "joints": joints})

    async def stiff(self, *joints: str) -> Answer:
        """Switch the torque of limp joints on again, where they are."""
        return await self.ask({"type": "stiff", "joints": joints})

    async def reboot(self, *joints: str) -> Answer:
        """Restart the servos of joints, such as those in shutdown, while all torque is off; waits for them."""
        return await self.ask({"type": "reboot", "joints": joints})

    async def clear(self, *, get_up: bool = False) -> Answer:
        """Release a STOP, or a fault; see `Client.clear`."""
        return await self.ask(clear_content(get_up))

    async def take(self) -> Answer:
        """Take the operator's lease over."""
        return await self.ask({"type": "take"})

    async def release(self) -> Answer:
        """Give the operator's lease back."""
        return await self.ask({"type": "release"})

    async def kill(self, *, confirm: str) -> Answer:
        """Switch the torque off at once: the robot falls; `confirm` is "the robot will fall"."""
        return await self.ask(kill_content(confirm))

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
        """Wait for the end of a target for the whole body; see `Client.wait`."""
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
