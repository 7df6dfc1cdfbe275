"""A gateway and a stop process, in this process, whose planner and loop are the test's."""

from __future__ import annotations

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
