"""A gateway and a stop process, in this process, whose planner and loop are the test's."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.hub import Transport
from flexmotion.streamer.gateway.presses import StopInput
from flexmotion.streamer.gateway.service import GatewayService
from flexmotion.streamer.gateway.stops import StopService

from ..conftest import Answering, Run


@dataclass
class Served:
    """What a transport's test looks at.

    Attributes:
        gateway, stops: the services; None where the test has none.
        loop: the planner and the loop.
    """

    gateway: GatewayService
    stops: StopService
    loop: Answering
    ends: list[Callable[[bool], None]]

    def end(self) -> None:
        while self.ends:
            self.ends.pop()(True)


Serve = Callable[..., Served]


@pytest.fixture
def serve(run: Run, op3: Robot, answering: Callable[..., Answering]) -> Iterator[Serve]:
    """Function (transports, stop inputs, fields of the settings) -> both services, which answer."""
    begun: list[Served] = []

    def start(transports: tuple[Transport, ...], inputs: tuple[StopInput, ...] = (), **fields: Any) -> Served:
        settings = Gateway.model_validate(fields)
        gateway = GatewayService(
            op3, "sim", settings, run.telemetry, run.targets, run.heard, None, transports=transports
        )
        stops = StopService(settings, run.telemetry, None, inputs=inputs)
        loop = answering(gateway.requests, stops.requests)
        begun.append(Served(gateway, stops, loop, [stops.follow(), gateway.follow()]))
        return begun[-1]

    yield start
    for one in begun:
        one.end()


def open_session(connect: list[str], mode: str = "client", listen: list[str] | None = None) -> Any:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("listen/endpoints", json.dumps(listen or []))
    config.insert_json5("connect/endpoints", json.dumps(connect))
    config.insert_json5("connect/timeout_ms", "-1")
    config.insert_json5("connect/retry", '{"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 2}')
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


ROUTER = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"router"')
config.insert_json5("listen/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
print("routes", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def start_router() -> Iterator[Callable[[str], subprocess.Popen[str]]]:
    """Function (endpoint) -> a router, in a process."""
    begun: list[subprocess.Popen[str]] = []

    def start(endpoint: str) -> subprocess.Popen[str]:
        router = subprocess.Popen(
            [sys.executable, "-c", ROUTER, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        begun.append(router)
        assert router.stdout is not None and router.stdout.readline() == "routes\n"
        return router

    yield start
    for router in begun:
        router.kill()
        router.communicate()
