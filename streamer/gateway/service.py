"""`GatewayService`: the process of the gateway. If it dies, its targets expire and the robot comes to a stand."""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import threading
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.control.hardware_audit import silence_of
from flexmotion.streamer.control.start_check import gets_up_from
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.gateway.admission import Admission, is_loopback
from flexmotion.streamer.gateway.health import Health
from flexmotion.streamer.gateway.hub import Hub, Transport
from flexmotion.streamer.gateway.ports import bound, check_free
from flexmotion.streamer.gateway.ways import Way, began, ended
from flexmotion.streamer.motion.heard import HeardChannel
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.motion.targets import TargetMailbox
from flexmotion.streamer.run.planner_process import Heartbeat
from flexmotion.streamer.run.requests import RequestChannel

_BUSY_S, _IDLE_S = 0.002, 0.02
"""Time between two looks of the desk at the answers, while a message waits for one and else [s]."""
_CLOSE_S, _PING_S = 1.0, 120.0
"""Time for the server to end; a connection that does not answer a ping for this long is dead [s]."""
_NICENESS = 5
"""The gateway uses the time that the run leaves, before log and view."""

log = logging.getLogger(__name__)

if TYPE_CHECKING:
    from flexmotion.sampling.pace import Pace
    from flexmotion.streamer.page.feed import Feed


class GatewayService:
    """A `flexmotion.streamer.run.supervisor.Service` with channels of its own to planner and loop.

    It is made before the first target is sent.

    Args:
        robot: of the run.
        driver: its name.
        admission: who may speak to it over the network; None: it does not listen there.
        port: to listen on; None: that of the settings.
        stop_port: of the stop process, for the status.
        lines, takes_targets: see `flexmotion.streamer.gateway.listening.Listening`.
        transports: other ways for messages, such as zenoh.
        feed: makes the feed of its page, given who sent a target; None: it has no page.
        pace: of a human that the robot keeps up with; None: not known.
        stops: health of the stop process, for the status; None: the run has none.
        clips: names of those that targets may name; kinds: of motion that words may ask for.
        person: poses of the person whom the run mirrors; None: it mirrors nobody.

    Attributes:
        name: of its process.
        requests: its channel to the loop.
        ways: whether messages can come over the transports.
        health: of the ways to the run.
        url: of its page.

    Raises:
        ConfigError: the port is taken.
    """

    name = "gateway"

    def __init__(
        self,
        robot: Robot,
        driver: str,
        settings: Gateway,
        telemetry: Telemetry,
        targets: TargetMailbox,
        heard: HeardChannel,
        admission: Admission | None,
        *,
        port: int | None = None,
        stop_port: int | None = None,
        lines: tuple[int, int] | None = None,
        takes_targets: bool = True,
        transports: tuple[Transport, ...] = (),
        feed: Callable[[Callable[[int], str | None]], Feed] | None = None,
        pace: Pace | None = None,
        stops: Health | None = None,
        clips: tuple[str, ...] = (),
        kinds: tuple[str, ...] = (),
        person: PersonChannel | None = None,
    ) -> None:
        self.robot, self.driver, self.takes_targets = robot, driver, takes_targets
        self.feed, self.pace, self.clips, self.kinds, self.person = feed, pace, clips, kinds, person
        self.settings, self.telemetry, self.heard, self.admission = settings, telemetry, heard, admission
        self.port, self.stop_port = settings.port if port is None else port, stop_port
        self.lines, self.transports = lines, transports
        if admission is not None:
            check_free(admission.address, self.port, "--web-port")
        self.targets = targets.sender()
        self.requests, self._listens = RequestChannel(), Heartbeat()
        names = [*(one.name for one in transports), *(["standard input"] if lines is not None else [])]
        self.ways = tuple(Way(f"targets over {name}", self.requests) for name in names)
        self.health = Health(self.ways) if stops is None else Health((*self.ways, *stops.ways), stops.alive)

    @property
    def listens(self) -> bool:
        """Whether its port is open: it is not before the run has begun."""
        return self._listens.beats > 0

    @property
    def url(self) -> str | None:
        """Address of its page on this machine; None where it does not listen on the network."""
        if self.admission is None:
            return None
        address = "localhost" if self.admission.everywhere else self.admission.address
        return f"http://{f'[{address}]' if ':' in address else address}:{self.port}"

    @property
    def far_url(self) -> str | None:
        """Address of its page on other machines, with words to fill in; None where they cannot reach it."""
        if self.admission is None or self.url is None or is_loopback(self.admission.address):
            return None
        url = self.url.replace("localhost", "ADDRESS-OF-THIS-MACHINE") if self.admission.everywhere else self.url
        return f"{url}/#token=TOKEN"

    def follow(self) -> Callable[[bool], None]:
        """See `Service.follow`: the server has a thread of its own."""
        if multiprocessing.parent_process() is not None:  # in lockstep the gateway is in the run's process
            os.nice(_NICENESS)
        server = _Server(self)

        def step(last: bool) -> None:
            if last:
                server.close()
            elif server.error is not None:
                raise server.error

        return step


class _Server:
    """The thread of the server.

    Attributes:
        error: that ended it; None while it runs.
    """

    def __init__(self, service: GatewayService) -> None:
        self.service = service
        self.error: BaseException | None = None
        self._server: Any = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="gateway", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the server, its connections with it."""
        if self._server is not None:
            self._server.should_exit = self._server.force_exit = True
        if self._loop is not None and self._loop.is_running():
            self._loop.call_soon_threadsafe(self._closed.set)
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except BaseException as error:  # for the main thread, which ends the process with it
            self.error = error

    async def _serve(self) -> None:
        # FastAPI takes half a second to load; only this process needs it.
        from flexmotion.streamer.gateway.desk import Desk
        from flexmotion.streamer.gateway.lines import Lines
        from flexmotion.streamer.gateway.metrics import metrics_text
        from flexmotion.streamer.gateway.mirror_state import MirrorState
        from flexmotion.streamer.gateway.pages import Pages
        from flexmotion.streamer.gateway.server import Connections, build_app
        from flexmotion.streamer.gateway.status import Status, status_of
        from flexmotion.streamer.page.body import page_robot

        service, self._loop = self.service, asyncio.get_running_loop()
        woken = asyncio.Event()
        everyone: list[Connections] = []

        def on_lease(before: str | None, now: str | None) -> None:
            log.info("operator: %s (before: %s)", now or "nobody", before or "nobody")
            for connections in everyone:
                connections.tell(f'{{"type":"lease","operator":{_quoted(now)},"before":{_quoted(before)}}}')

        desk = Desk(
            service.settings,
            service.telemetry,
            service.targets,
            service.heard,
            service.requests,
            on_lease=on_lease,
            takes_targets=service.takes_targets,
            mirror=None if service.person is None else MirrorState(service.person),
        )

        def status() -> Status:
            robot = service.robot
            return status_of(
                desk,
                robot.name,
                service.driver,
                robot.rate_hz,
                service.stop_port,
                service.health,
                robot.joint_names,
                partial(gets_up_from, robot),
                lambda row: silence_of(robot, row.stale),
            )

        pump: asyncio.Task[Any] = asyncio.create_task(_pump(desk, woken))
        serving: asyncio.Task[Any]
        if service.lines is not None:
            Lines(*service.lines, desk, woken.set, service.ways[-1])
        hub = Hub(desk, status, woken.set)
        transports = [
            asyncio.create_task(began(partial(one.begin, hub, way), way))
            for one, way in zip(service.transports, service.ways, strict=False)
        ]
        pages = drawing = None
        if service.admission is None:
            serving = asyncio.create_task(self._closed.wait())
        else:
            if service.feed is not None:
                pages = Pages(
                    partial(service.feed, desk.sources.get),
                    partial(page_robot, service.robot, service.driver, service.pace, service.clips, service.kinds),
                )
                drawing = asyncio.create_task(pages.run())
            robot = service.robot
            metrics = partial(metrics_text, desk, robot.name, service.driver, robot.joint_names, service.health)
            app, connections = build_app(desk, service.admission, status, woken.set, pages, metrics)
            everyone.append(connections)
            serving = asyncio.create_task(self._listen(app, service.admission))
        done, _ = await asyncio.wait([serving, pump], return_when=asyncio.FIRST_COMPLETED)
        await ended(transports)
        for task in (serving, pump, drawing):
            if task is not None and task not in done:
                task.cancel()
        for task in done:
            task.result()

    async def _listen(self, app: Any, admission: Admission) -> None:
        import uvicorn

        settings = self.service.settings
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            lifespan="off",
            ws_max_size=16 * settings.most_bytes,
            ws_max_queue=8,
            # In a flood the answer to a ping waits behind the messages before it.
            ws_ping_timeout=_PING_S,
            ws_per_message_deflate=False,
            limit_concurrency=4 * settings.most_connections,
            server_header=False,
        )
        self._server = uvicorn.Server(config)
        with bound(admission.address, self.service.port) as listening:
            self.service._listens.beat()
            await self._server.serve(sockets=[listening])


async def _pump(desk: Any, woken: asyncio.Event) -> None:
    while True:
        desk.pump()
        try:
            await asyncio.wait_for(woken.wait(), _BUSY_S if desk.busy else _IDLE_S)
        except TimeoutError:
            continue
        woken.clear()
        # One pass for all that has arrived: a burst does not look at the answers once a message.
        await asyncio.sleep(_BUSY_S)


def _quoted(name: str | None) -> str:
    return "null" if name is None else f'"{name}"'


def check_installed() -> None:
    """Check that the server's libraries are there. Raises `ConfigError`."""
    from importlib.util import find_spec

    missing = [name for name in ("fastapi", "prometheus_client", "uvicorn", "websockets") if find_spec(name) is None]
    if missing:
        packages = " ".join(missing).replace("_", "-")
        raise ConfigError(f"--web needs {', '.join(missing)}: pip install {packages}")
