"""`listen`: gives a session its gateway and its stop process."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.gateway.hub import Transport
from flexmotion.streamer.gateway.messages import KINDS
from flexmotion.streamer.gateway.presses import StopInput
from flexmotion.streamer.gateway.service import GatewayService, check_installed
from flexmotion.streamer.gateway.stops import StopService
from flexmotion.streamer.gateway.transports.extras import need
from flexmotion.streamer.gateway.transports.gamepad import GamepadStops, GamepadTargets, check_gamepad
from flexmotion.streamer.gateway.transports.pads import Find
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, domain_from_environment
from flexmotion.streamer.gateway.transports.ros2_stops import Ros2Stops
from flexmotion.streamer.gateway.transports.ros2_targets import Ros2Targets
from flexmotion.streamer.gateway.transports.zenoh_link import zenoh_links
from flexmotion.streamer.gateway.transports.zenoh_stops import ZenohStops
from flexmotion.streamer.gateway.transports.zenoh_targets import ZenohTargets
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.page.feed import Feed
from flexmotion.streamer.run.session import Session


@dataclass(frozen=True)
class Listening:
    """How a run listens for targets.

    Attributes:
        address: to listen on; by default only this machine reaches it.
        port, stop_port: of the gateway and of the stop process; None: those of the stream settings.
        token: that requests must carry; needed where other machines reach the address.
        network: whether the ports are opened; without them only `lines` are read.
        takes_targets: whether the robot can be steered; else the run shows itself, and can be stopped.
        lines: file descriptors to read messages from and to write answers to, a JSON object a line; None: none.
        name: of the robot in keys and topics; None: that of the stream settings, else that of the robot file.
        zenoh: whether messages are taken over zenoh.
        zenoh_router: endpoint of a zenoh router to connect to, such as "tcp/127.0.0.1:7447"; None: none.
        ros2: whether the robot takes part in ROS 2, over the zenoh router on this machine.
        gamepad: whether the gamepads of this machine steer, or a function that finds others.
    """

    address: str = "127.0.0.1"
    port: int | None = None
    stop_port: int | None = None
    token: str | None = None
    network: bool = True
    takes_targets: bool = True
    lines: tuple[int, int] | None = None
    name: str | None = None
    zenoh: bool = False
    zenoh_router: str | None = None
    ros2: bool = False
    gamepad: bool | Find = False


def listen(session: Session, listening: Listening) -> None:
    """Add the services to a session that has not begun.

    Raises:
        ConfigError: a port is taken, an address needs a token, a library is missing, or the clock is lockstep.
    """
    if session.clock != "real" and listening.takes_targets:
        raise ConfigError("clock: lockstep passes as fast as it computes; targets of other programs need clock real")
    settings, telemetry = session.settings.gateway, session.telemetry
    transports, inputs = _ways(session, listening)
    stops: tuple[StopService, ...] = ()
    port = settings.port if listening.port is None else listening.port
    stop_port = settings.stop_port if listening.stop_port is None else listening.stop_port
    page: Admission | None = None
    if listening.network:
        check_installed()
        if port == stop_port:
            raise ConfigError(f"port: {port} is that of the stop process, expected another")
        page = Admission(listening.address, listening.token, page_port=port)
    if page is not None or inputs:
        stops = (StopService(settings, telemetry, page, port=stop_port, realtime=session.realtime, inputs=inputs),)
    gateway = GatewayService(
        session.robot,
        session.driver.name,
        settings,
        telemetry,
        session.targets,
        session.heard_channel,
        Admission(listening.address, listening.token) if listening.network else None,
        port=port,
        stop_port=stop_port if listening.network else None,
        lines=listening.lines,
        takes_targets=listening.takes_targets,
        transports=transports,
        feed=partial(_feed, session) if listening.network else None,
        pace=session.source.pace if isinstance(session.source, ModelSource) else None,
        stops=stops[0].health if stops else None,
        clips=session.source.clips if isinstance(session.source, ModelSource) else (),
        kinds=session.source.sampler.requests.kinds if isinstance(session.source, ModelSource) else (),
        person=session.source.channel if isinstance(session.source, MirrorSource) else None,
    )
    session.services += (*stops, gateway)


def _ways(session: Session, listening: Listening) -> tuple[tuple[Transport, ...], tuple[StopInput, ...]]:
    """The ways for messages and for stops beside HTTP and lines."""
    settings = session.settings.gateway
    name = robot_name(listening.name or settings.name or session.robot.name)
    transports: list[Transport] = []
    inputs: list[StopInput] = []
    if listening.zenoh or listening.zenoh_router is not None:
        targets, stops = zenoh_links(name, listening.address, listening.token, settings, listening.zenoh_router)
        transports.append(ZenohTargets(targets))
        inputs.append(ZenohStops(stops))
    if listening.ros2:
        need("zenoh", "--ros2", "ros2")
        need("rosbags", "--ros2", "ros2")
        _check_types(settings.ros2_types)
        link = Ros2Link(name, settings.ros2_port, domain_from_environment())
        scale = session.human_scale
        transports.append(Ros2Targets(link, session.robot, scale, settings.ros2_rate_hz, settings.ros2_types))
        inputs.append(Ros2Stops(link))
    if listening.gamepad:
        check_gamepad(settings.gamepad)
        find = listening.gamepad if callable(listening.gamepad) else None
        transports.append(GamepadTargets(settings.gamepad, find))
        inputs.append(GamepadStops(settings.gamepad, find))
    return tuple(transports), tuple(inputs)


def _check_types(types: tuple[str, ...]) -> None:
    unknown = [one for one in types if one not in KINDS]
    if unknown:
        raise ConfigError(f"gateway.ros2_types: {', '.join(unknown)}: expected any of {', '.join(KINDS)}")


def robot_name(name: str) -> str:
    """A name as keys of zenoh and topics of ROS 2 can have it: small letters, digits and `_`, a letter first."""
    known = re.sub(r"[^a-z0-9_]", "_", name.lower())
    return known if known[:1].isalpha() else f"robot_{known}"


def _feed(session: Session, source_of: Callable[[int], str | None]) -> Feed:
    items = [heard for heard in session.heard if heard.item is not None]
    known = (session.robot, session.telemetry, session.humans, session.heard_channel, items, source_of)
    return Feed(*known, simulated=session.driver.name == "sim")
