"""Targets of parts of the body, and restrictions, over each way in which a program sends one."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

import pytest

from flexmotion.streamer.cli import execute
from flexmotion.streamer.gateway.async_client import AsyncClient
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.motion.intents import Intent
from flexmotion.streamer.motion.part_intents import FootPlace, Hand, HeadPlace, JointAngle, Look, Point, Relax
from flexmotion.streamer.motion.restriction_intents import Contact, Tension, TorqueCap

from .conftest import Answering, Begin

Call = Callable[[Any], Any]

TARGETS: list[tuple[Call, list[str], Intent]] = [
    (
        lambda client: client.hand("right", 0.15, -0.1, 0.2, in_s=1.0),
        ["--hand", "right", ".15", "-.1", ".2", "--in", "1"],
        Hand("right", (0.15, -0.1, 0.2), in_s=1.0),
    ),
    (
        lambda client: client.foot("left", 0.06, 0.1, math.radians(-10.0), in_s=1.5, tolerance_m=0.02),
        ["--foot", "left", ".06", ".1", "--heading", "-10", "--in", "1.5", "--tolerance", ".02"],
        FootPlace("left", (0.06, 0.1), math.radians(-10.0), in_s=1.5, tolerance=0.02),
    ),
    (
        lambda client: client.foot("right", 0.0, -0.1),
        ["--foot", "right", "0", "-.1"],
        FootPlace("right", (0.0, -0.1)),
    ),
    (
        lambda client: client.head(0.02, 0.0, 0.38, in_s=1.5, tolerance_m=0.02),
        ["--head", ".02", "0", ".38", "--in", "1.5", "--tolerance", ".02"],
        HeadPlace((0.02, 0.0, 0.38), in_s=1.5, tolerance=0.02),
    ),
    (
        lambda client: client.head(None, None, 0.35),
        ["--head", "nan", "nan", ".35"],
        HeadPlace((None, None, 0.35)),
    ),
    (
        lambda client: client.point("left", 1.0, 0.5, 0.0, in_s=0.8),
        ["--point", "left", "1", ".5", "0", "--in", ".8"],
        Point("left", (1.0, 0.5, 0.0), in_s=0.8),
    ),
    (
        lambda client: client.look(1.0, 0.5, 0.2),
        ["--look", "1", ".5", ".2"],
        Look((1.0, 0.5, 0.2)),
    ),
    (
        lambda client: client.joint("l_el", math.radians(30.0)),
        ["--joint", "l_el", "30"],
        JointAngle("l_el", math.radians(30.0)),
    ),
    (lambda client: client.contact("left"), ["--contact", "left"], Contact("left")),
    (lambda client: client.torque("left knee", 1.5), ["--torque", "left knee", "1.5"], TorqueCap("left knee", 1.5)),
    (lambda client: client.tension("left arm", 0.3), ["--tension", "left arm", "0.3"], Tension("left arm", 0.3)),
    (lambda client: client.relax("torque left knee"), ["--relax", "torque left knee"], Relax("torque left knee")),
    (lambda client: client.relax("tension both arms"), ["--relax", "tension both arms"], Relax("tension both arms")),
    (lambda client: client.relax(), ["--relax", "all"], Relax("all")),
]


@pytest.mark.parametrize(("call", "options", "intent"), TARGETS, ids=lambda one: type(one).__name__)
def test_both_clients_and_the_command_line_ask_for_the_same(
    begin: Begin, answering: Callable[..., Answering], call: Call, options: list[str], intent: Intent
) -> None:
    """The methods of the clients for parts and restrictions were called by no test."""
    gateway = begin()
    planner = answering(gateway.requests)
    with Client(port=gateway.port) as client:
        assert call(client).state == "accepted"

    async def ask() -> str:
        async with AsyncClient(port=gateway.port) as client:
            return str((await call(client)).state)

    assert asyncio.run(ask()) == "accepted"
    assert execute(["send", *options, "--take", "--port", str(gateway.port)]) == 0
    assert [target.intent for target in planner.seen] == [intent] * 3


def test_a_foot_and_a_cap_hold_until_they_are_let_go_or_for_the_time_that_is_asked(
    begin: Begin, answering: Callable[..., Answering]
) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    with Client(port=gateway.port) as client:
        client.contact("both")
        client.torque("knee", 2.0, ttl_s=4.0)
    assert execute(["send", "--contact", "right", "--for", "3", "--take", "--port", str(gateway.port)]) == 0
    assert [target.holds_s for target in planner.seen] == pytest.approx([math.inf, 4.0, 3.0], rel=0.01)
