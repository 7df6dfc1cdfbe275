"""ROS 2 over zenoh: keys, types and tokens as `rmw_zenoh` has them; topics in and out; stops."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import Gateway, load_stream
from flexmotion.drivers.registry import create
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.gateway.listening import Listening, listen
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.gateway.transports.ros2_messages import (
    DEFINITIONS,
    EMPTY,
    IMU,
    JOINT_STATE,
    STRING,
    TWIST,
    TWIST_STAMPED,
    Ros2Messages,
)
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node, domain_from_environment
from flexmotion.streamer.gateway.transports.ros2_stops import Ros2Stops
from flexmotion.streamer.gateway.transports.ros2_targets import Ros2Targets
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.motion.intents import Stop, Text, Velocity
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.streamer.run.session import Session

from ....waiting import wait_until
from ..conftest import Run
from .conftest import Serve, Served, open_session
from .ros2_peer import twist, twist_stamped

pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra 'ros2')")
pytest.importorskip("rosbags", reason="needs rosbags (extra 'ros2')")

RATIO = 4.0
StartRouter = Callable[[str], subprocess.Popen[str]]


class Peer:
    """Another node of ROS 2, with its own session."""

    def __init__(self, session: Any, link: Ros2Link) -> None:
        self.session, self.messages = session, Ros2Messages()
        self.node = Ros2Node(link, session, "peer", self.messages, Way("peer", RequestChannel()))
        self._senders: dict[str, Callable[[bytes], None]] = {}

    def tokens(self) -> list[str]:
        found = self.session.liveliness().get("@ros2_lv/**", timeout=1.0)
        return [str(reply.ok.key_expr) for reply in found if reply.ok is not None]

    def send(self, topic: str, kind: str, data: bytes) -> None:
        if topic not in self._senders:
            self._senders[topic] = self.node.publish(topic, kind)
        self._senders[topic](data)

    def heard(self, topic: str, kind: str) -> list[Any]:
        found: list[Any] = []
        self.node.subscribe(topic, kind, lambda data: found.append(self.messages.decode(kind, data)))
        return found


class Network:
    """A run, a router and a peer."""

    def __init__(
        self,
        serve: Serve,
        sessions: ExitStack,
        op3: Robot,
        start_router: StartRouter,
        types: tuple[str, ...] = Gateway().ros2_types,
    ) -> None:
        self.link = Ros2Link("op3", any_free(), 3)
        self.served: Served = serve((Ros2Targets(self.link, op3, RATIO, 100.0, types),), (Ros2Stops(self.link),))
        self.router = start_router(self.link.router)
        self.peer = Peer(sessions.enter_context(open_session([self.link.router])), self.link)
        self.wait()

    def wait(self) -> None:
        def known() -> bool:
            tokens = self.peer.tokens()
            last = ("/flexmotion/%op3%cmd_vel_unstamped/", "/flexmotion_stops/%op3%estop/")
            return all(any("/MS/" in token and one in token for token in tokens) for one in last)

        wait_until(known, "both nodes to be seen in ROS 2")


@pytest.fixture
def network(serve: Serve, op3: Robot, start_router: StartRouter) -> Iterator[Network]:
    with ExitStack() as sessions:
        yield Network(serve, sessions, op3, start_router)


def test_hashes_are_those_that_ros_2_jazzy_has() -> None:
    """A wrong hash makes a topic that no node of ROS 2 is matched with."""
    from rosbags.typesys import Stores, get_typestore

    jazzy, own = get_typestore(Stores.ROS2_JAZZY), Ros2Messages()
    assert {kind: own.hash(kind) for kind in DEFINITIONS} == {kind: jazzy.hash_rihs01(kind) for kind in DEFINITIONS}


def test_words_velocities_and_any_message_are_answered(network: Network) -> None:
    answers = network.peer.heard("answers", STRING)
    messages = network.peer.messages
    for topic, kind, data, asked in (
        ("text", STRING, messages.string("wave"), Text("wave")),
        ("cmd_vel_unstamped", TWIST, twist((0.1, -0.05, 0.0), (0.0, 0.0, 0.5)), Velocity(0.4, -0.2, 0.5)),
        ("targets", STRING, messages.string('{"type":"velocity","velocity":[0,0,0],"id":"7"}'), Stop()),
    ):
        before = len(network.served.loop.seen)
        network.peer.send(topic, kind, data)
        wait_until(lambda before=before: len(network.served.loop.seen) > before, f"{topic} to arrive")
        assert network.served.loop.seen[before].intent == asked
    wait_until(lambda: len(answers) == 3, "the answers")
    told = [json.loads(answer.data) for answer in answers]
    assert [(answer["source"], answer["state"]) for answer in told] == [("ros2", "accepted")] * 3
    assert told[-1]["id"] == "7"


def test_a_stale_stamp_is_refused_and_counted(network: Network) -> None:
    answers = network.peer.heard("answers", STRING)

    def send(stamp_ns: int) -> None:
        message = twist_stamped(stamp_ns, (0.1, 0.0, 0.0), (0.0, 0.0, 0.0))
        network.peer.send("cmd_vel", TWIST_STAMPED, message)

    for number, stamp_ns in enumerate((time.time_ns() - 2_000_000_000, 1, time.time_ns() + 60_000_000_000)):
        send(stamp_ns)
        wait_until(lambda number=number: len(answers) > number, "the refusal")
    assert [json.loads(answer.data)["state"] for answer in answers] == ["expired", "expired", "refused"]
    assert network.served.loop.seen == []
    send(time.time_ns() + 500_000_000)
    wait_until(lambda: network.served.loop.seen, "the velocity")


def test_a_stamp_that_is_not_set_is_refused_for_that_reason(network: Network) -> None:
    """It always expired, "sent 1792000000 s ago": ROS 2 has 0 for a stamp that nobody has set."""
    answers = network.peer.heard("answers", STRING)
    message = twist_stamped(0, (0.1, 0.0, 0.0), (0.0, 0.0, 0.0))
    network.peer.send("cmd_vel", TWIST_STAMPED, message)
    wait_until(lambda: answers, "the refusal")
    told = json.loads(answers[0].data)
    assert told["state"] == "refused" and "header.stamp is 0, which means that it is not set" in told["reason"]
    assert network.served.loop.seen == []


def test_who_cannot_prove_who_they_are_may_steer_and_stop_and_nothing_else(network: Network) -> None:
    """Any node of the network armed the robot, released a STOP, and cut the torque."""
    answers = network.peer.heard("answers", STRING)
    kill = {"type": "kill", "confirm": "the robot will fall"}
    refused = [{"type": "arm"}, {"type": "clear"}, kill, {"type": "take"}, {"type": "disarm", "id": "7"}]
    for number, content in enumerate(refused):
        network.peer.send("targets", STRING, network.peer.messages.string(json.dumps(content)))
        wait_until(lambda number=number: len(answers) > number, "the refusal")
    told = [json.loads(answer.data) for answer in answers]
    assert [(one["asked"], one["state"]) for one in told] == [(one["type"], "refused") for one in refused]
    assert (
        told[-1]["id"] == "7" and "disarm: not taken over ROS 2, where nobody proves who they are" in told[-1]["reason"]
    )
    assert network.served.loop.requested == []
    network.peer.send("targets", STRING, network.peer.messages.string('{"type":"stop"}'))
    wait_until(lambda: network.served.loop.requested == [Request.STOP], "STOP")


def test_the_settings_say_what_is_taken(serve: Serve, op3: Robot, start_router: StartRouter) -> None:
    with ExitStack() as sessions:
        network = Network(serve, sessions, op3, start_router, ("clear",))
        network.peer.send("targets", STRING, network.peer.messages.string('{"type":"clear"}'))
        wait_until(lambda: network.served.loop.requested == [Request.CLEAR], "CLEAR")
    session = open_session_for(op3)
    with pytest.raises(ConfigError, match=r"gateway\.ros2_types: dance: expected any of text, "):
        listen(session, Listening(network=False, ros2=True))


def open_session_for(op3: Robot) -> Session:
    settings = load_stream()
    gateway = settings.gateway.model_copy(update={"ros2_types": ("dance",)})
    changed = settings.model_copy(update={"gateway": gateway})
    return Session(op3, create("sim", op3, seed=0), ClipSource(default_clip()[225:330]), changed, clock="real")


def test_what_is_no_message_is_refused_and_the_next_one_read(network: Network) -> None:
    answers = network.peer.heard("answers", STRING)
    messages = network.peer.messages
    bad = [("cmd_vel", TWIST_STAMPED, data) for data in (b"", b"\x00\x01\x00\x00", b"\xff" * 50)]
    bad += [("text", STRING, messages.string("x" * 100)[:20]), ("text", STRING, messages.string(""))]
    bad += [("targets", STRING, messages.string(text)) for text in ("no JSON", "[]", "1", "[" * 10_000, "x" * 10_000)]
    bad.append(("cmd_vel_unstamped", TWIST, twist((float("nan"), 0.0, 0.0), (0.0, 0.0, 0.0))))
    for number, (topic, kind, data) in enumerate(bad):
        network.peer.send(topic, kind, data)
        wait_until(lambda number=number: len(answers) > number, "the refusal")
    assert {json.loads(answer.data)["state"] for answer in answers} == {"refused"}
    network.peer.send("text", STRING, messages.string("wave"))
    wait_until(lambda: network.served.loop.seen, "the words")


def test_two_hundred_targets_are_all_answered(network: Network) -> None:
    answers = network.peer.heard("answers", STRING)
    for number in range(200):
        content = {"type": "velocity", "velocity": [0.1 + number % 9 / 10, 0, 0], "id": str(number)}
        network.peer.send("targets", STRING, network.peer.messages.string(json.dumps(content)))
    ids = {str(number) for number in range(200)}
    wait_until(lambda: ids == {json.loads(answer.data)["id"] for answer in list(answers)}, "all answers")


def test_joint_states_and_imu_are_published(
    network: Network, run: Run, op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {"q": [0.1, 0.2, 0.3], "qd": [1, 2, 3], "gyro": [1, 2, 3], "accel": [0, 0, 9.81], "tilt": [0.1, -0.2]}
    values |= {"odometry": [5, 6, 0.3]}
    commit = run.telemetry.commit

    def filled() -> None:
        for name, value in values.items():
            getattr(run.telemetry.row, name)[...] = value
        commit()

    monkeypatch.setattr(run.telemetry, "commit", filled)
    states, imus = network.peer.heard("joint_states", JOINT_STATE), network.peer.heard("imu", IMU)
    wait_until(lambda: states and imus and states[-1].position[0] == 0.1, "the states")
    state, imu = states[-1], imus[-1]
    assert state.name == list(op3.joint_names) and list(state.velocity) == [1.0, 2.0, 3.0] and len(state.effort) == 0
    assert abs(state.header.stamp.sec - time.time()) < 60.0
    assert imu.header.frame_id == "torso" and imu.linear_acceleration.z == 9.81 and imu.angular_velocity.y == 2.0
    found = Rotation.from_quat([imu.orientation.x, imu.orientation.y, imu.orientation.z, imu.orientation.w])
    assert found.as_euler("ZYX") == pytest.approx([0.3, -0.2, 0.1])
    values["tilt"] = [np.nan, np.nan]
    wait_until(lambda: imus[-1].orientation_covariance[0] == -1.0, "an orientation that is not known")


def test_stops_reach_the_stop_process_with_the_gateway_dead(network: Network) -> None:
    answers = network.peer.heard("answers", STRING)
    network.served.ends.pop()(True)
    for topic, asked in (("stop", Request.STOP), ("estop", Request.ESTOP)):
        network.peer.send(topic, EMPTY, network.peer.messages.empty())
        wait_until(lambda asked=asked: asked in network.served.loop.requested, topic)
    wait_until(lambda: len(answers) == 2, "the answers")
    told = [json.loads(answer.data) for answer in answers]
    assert [(answer["asked"], answer["state"]) for answer in told] == [("stop", "accepted"), ("estop", "accepted")]


def test_a_router_that_is_killed_and_comes_back_is_used_again(network: Network, start_router: StartRouter) -> None:
    network.router.kill()
    network.router.communicate()
    wait_until(lambda: not any("flexmotion" in token for token in network.peer.tokens()), "the router's end")
    start_router(network.link.router)
    network.wait()
    network.peer.send("text", STRING, network.peer.messages.string("wave"))
    wait_until(lambda: network.served.loop.seen, "words after the router is back")


@given(st.sampled_from(sorted(DEFINITIONS)), st.binary(max_size=200))
@settings(max_examples=200)
def test_no_bytes_break_the_decoder(kind: str, data: bytes) -> None:
    try:
        MESSAGES.decode(kind, data)
    except ValueError as error:
        assert str(error).startswith(f"no {kind}")


MESSAGES = Ros2Messages()


def test_a_domain_is_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    assert domain_from_environment() == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert domain_from_environment() == 42
    monkeypatch.setenv("ROS_DOMAIN_ID", "lab")
    with pytest.raises(ConfigError, match="ROS_DOMAIN_ID: lab"):
        domain_from_environment()


def test_another_implementation_is_understood_both_ways(network: Network, monkeypatch: pytest.MonkeyPatch) -> None:
    """zenoh-ros2-sdk speaks to `rmw_zenoh` by its own code for keys, types and attachments."""
    monkeypatch.setenv("GIT_PYTHON_REFRESH", "quiet")
    sdk = pytest.importorskip("zenoh_ros2_sdk", reason="needs zenoh-ros2-sdk")
    options = {
        "msg_definition": DEFINITIONS[STRING],
        "type_hash": Ros2Messages().hash(STRING),
        "domain_id": 3,
        "router_port": network.link.port,
    }
    heard: list[str] = []
    subscriber = sdk.ROS2Subscriber("/op3/answers", STRING, lambda message: heard.append(message.data), **options)
    publisher = sdk.ROS2Publisher("/op3/text", STRING, **options)
    wait_until(lambda: publisher.publish(data="wave") or network.served.loop.seen, "the words", every_s=0.2)
    wait_until(lambda: heard, "the answer")
    assert network.served.loop.seen[0].intent == Text("wave") and json.loads(heard[0])["heard_as"] == "wave"
    found = dict(sdk.get_topic_names_and_types(domain_id=3, router_port=network.link.port))
    assert found["/op3/joint_states"] == [JOINT_STATE] and found["/op3/cmd_vel"] == [TWIST_STAMPED]
    publisher.close()
    subscriber.close()
