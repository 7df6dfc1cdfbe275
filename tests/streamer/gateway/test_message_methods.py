"""Both clients have a method for every message: what each of them sends is a valid message."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from flexmotion.streamer.gateway.connection import PATIENCE_S, patience_of
from flexmotion.streamer.gateway.message_methods import MessageMethods
from flexmotion.streamer.gateway.messages import decode

Sent = Mapping[str, Any]


class Recorded(MessageMethods[Sent]):
    def ask(self, message: Sent) -> Sent:
        return message


CALLS: dict[str, Callable[[Recorded], Sent]] = {
    "text": lambda robot: robot.text("wave", ttl_s=3.0),
    "velocity": lambda robot: robot.velocity(0.1, 0.0, 0.2),
    "heading": lambda robot: robot.heading(1.5, turning=0.4),
    "waypoint": lambda robot: robot.waypoint(1.0, 0.5, 0.0, tolerance_m=0.1),
    "hand": lambda robot: robot.hand("right", 0.15, -0.1, 0.2, in_s=0.5),
    "foot": lambda robot: robot.foot("left", 0.06, 0.1, 0.1),
    "head": lambda robot: robot.head(None, 0.0, 0.38, in_s=1.0),
    "point": lambda robot: robot.point("left", 1.0, 0.5, 0.0),
    "look": lambda robot: robot.look(1.0, 0.5, 0.0, in_s=1.0),
    "joint": lambda robot: robot.joint("head_pan", 0.3),
    "contact": lambda robot: robot.contact("left"),
    "torque": lambda robot: robot.torque("knee", 1.5),
    "tension": lambda robot: robot.tension("head", 0.5),
    "relax": lambda robot: robot.relax(),
    "clip": lambda robot: robot.clip("walk"),
    "hold": lambda robot: robot.hold(),
    "arm": lambda robot: robot.arm(),
    "disarm": lambda robot: robot.disarm(),
    "limp": lambda robot: robot.limp("l_el", "r_el"),
    "stiff": lambda robot: robot.stiff("l_el"),
    "reboot": lambda robot: robot.reboot("l_el"),
    "clear": lambda robot: robot.clear(get_up=True),
    "take": lambda robot: robot.take(),
    "release": lambda robot: robot.release(),
    "kill": lambda robot: robot.kill(confirm="the robot will fall"),
}


def test_every_method_is_tried() -> None:
    assert set(CALLS) == {name for name in vars(MessageMethods) if not name.startswith("_")} - {"ask"}


@pytest.mark.parametrize("name", CALLS)
def test_what_a_method_sends_is_a_message_of_its_name(name: str) -> None:
    sent = {key: value for key, value in CALLS[name](Recorded()).items() if value is not None}
    message = decode(json.dumps({"id": "1", "source": "test", "sequence": 1, **sent}).encode())
    assert message.type == name
    known = message.model_dump(mode="json")
    assert {key: known[key] for key in sent} == json.loads(json.dumps(sent))


def test_a_robot_that_gets_up_is_waited_for() -> None:
    assert patience_of(Recorded().clear(get_up=True)) > 40.0
    assert patience_of(Recorded().clear()) == PATIENCE_S
