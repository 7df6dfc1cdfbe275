"""`Ros2Targets`: velocities, words and any message from ROS 2; answers, joint states and the IMU to it."""

from __future__ import annotations

import json
import logging
import queue
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import Robot
from flexmotion.streamer.gateway.hub import Hub
from flexmotion.streamer.gateway.messages import KINDS, Answer, MessageError, encode
from flexmotion.streamer.gateway.transports.ros2_messages import (
    IMU,
    JOINT_STATE,
    STRING,
    TWIST,
    TWIST_STAMPED,
    Ros2Messages,
)
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node
from flexmotion.streamer.gateway.transports.zenoh_session import keep_open
from flexmotion.streamer.gateway.ways import Way

if TYPE_CHECKING:
    import zenoh

SOURCE = "ros2"
FRAME = "torso"
"""Of the IMU: x forward, y left, z up."""
_NO_STAMP = (
    "header.stamp is 0, which means that it is not set, so nobody knows how old this velocity is: "
    "set the stamp, or publish a Twist on cmd_vel_unstamped"
)
_LONGEST_REASON = 200
_LOOK_S = 0.5
"""Time between two looks whether the run has ended [s]."""

log = logging.getLogger(__name__)


class Ros2Targets:
    """A `flexmotion.streamer.gateway.hub.Transport`.

    Args:
        link: where ROS 2 is.
        robot: of the run.
        ratio: length of the human's leg over the robot's: a velocity is the robot's in ROS 2, the human's in a message.
        rate_hz: joint states and IMU a second.
        types: of messages that are taken.
    """

    name = SOURCE

    def __init__(self, link: Ros2Link, robot: Robot, ratio: float, rate_hz: float, types: Collection[str]) -> None:
        self.link, self.robot, self.ratio, self.rate_hz, self.types = link, robot, ratio, rate_hz, frozenset(types)

    def begin(self, hub: Hub, way: Way) -> Callable[[], None]:
        """See `Transport.begin`."""
        desk = _Desk(self, hub, way)
        close = keep_open(self.link.config, desk.serve, way, SOURCE, f"the zenoh router at {self.link.router}")
        # Threads of their own: a reader that takes nothing holds up no target.
        way.keep(desk.answer, desk.ended, "ros2-answers")
        way.keep(desk.tell, desk.ended, "ros2-states")

        def end() -> None:
            desk.ended.set()
            close()

        return end


class _Desk:
    """The gateway's end of a session."""

    def __init__(self, transport: Ros2Targets, hub: Hub, way: Way) -> None:
        self.transport, self.hub, self.way = transport, hub, way
        self._outs: dict[str, Callable[[bytes], None]] = {}
        self.ended = threading.Event()
        self._answers: queue.Queue[Answer] = queue.Queue(hub.settings.most_unread)
        self._messages = Ros2Messages()

    def serve(self, session: zenoh.Session) -> list[Any]:
        node = Ros2Node(self.transport.link, session, "flexmotion", self._messages, self.way)
        self._outs = {
            "answers": node.publish("answers", STRING),
            "joint_states": node.publish("joint_states", JOINT_STATE),
            "imu": node.publish("imu", IMU),
        }
        for topic, kind, take in self.takers():
            node.subscribe(topic, kind, take)
        return node.declared

    def takers(self) -> list[tuple[str, str, Callable[[bytes], None]]]:
        """Of each topic its name, its type and what takes its messages, as CDR."""
        contents: tuple[tuple[str, str, Callable[[Any], Any]], ...] = (
            ("targets", STRING, lambda message: json.loads(message.data)),
            ("text", STRING, lambda message: {"type": "text", "text": message.data}),
            ("cmd_vel", TWIST_STAMPED, self._stamped),
            ("cmd_vel_unstamped", TWIST, self._velocity),
        )
        return [(topic, kind, self._taker(topic, kind, content)) for topic, kind, content in contents]

    def _taker(self, topic: str, kind: str, content: Callable[[Any], Any]) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            try:
                asked = content(self._messages.decode(kind, data))
                # One source: words and velocities of one network do not take the lease from each other.
                message = json.dumps({**asked, "source": SOURCE})
            except (ValueError, TypeError, RecursionError) as error:
                self._refuse("not valid", str(error)[:_LONGEST_REASON])
                return
            word = asked.get("type")
            if isinstance(word, str) and word in KINDS and word not in self.transport.types:
                self._refuse("not over ROS 2", _not_taken(word, self.transport.types), asked)
                return
            self.hub.receive(message.encode(), self._reply, (SOURCE, topic))

        return take

    def _refuse(self, why: str, reason: str, asked: dict[str, Any] | None = None) -> None:
        """Count and answer a message that does not get to the desk."""
        self.hub.reject(why)
        self._reply(MessageError(reason, {**(asked or {}), "source": SOURCE}).answer)

    def _velocity(self, twist: Any) -> dict[str, Any]:
        ratio = self.transport.ratio
        return {"type": "velocity", "velocity": [ratio * twist.linear.x, ratio * twist.linear.y, twist.angular.z]}

    def _stamped(self, message: Any) -> dict[str, Any]:
        stamp = message.header.stamp
        if not stamp.sec and not stamp.nanosec:
            raise ValueError(_NO_STAMP)
        return {**self._velocity(message.twist), "stamp_s": stamp.sec + 1e-9 * stamp.nanosec}

    def _reply(self, answer: Answer) -> None:
        try:
            self._answers.put_nowait(answer)
        except queue.Full:
            self.hub.reject("slow reader")

    def _send(self, topic: str, data: bytes) -> None:
        try:
            self._outs[topic](data)
        except Exception as error:  # of the library, such as a session that has just been closed
            self.hub.reject("not delivered")
            log.debug("%s: %s", topic, error)

    def answer(self) -> None:
        """Send the answers until the end."""
        while not self.ended.is_set():
            with suppress(queue.Empty):
                self._send("answers", self._messages.string(encode(self._answers.get(timeout=_LOOK_S))))

    def tell(self) -> None:
        """Publish the robot's state until the end."""
        names = list(self.transport.robot.joint_names)
        newest = -1
        while not self.ended.wait(1.0 / self.transport.rate_hz):
            row = self.hub.row()
            if not self._outs or row is None or int(row.tick) == newest:
                continue
            newest = int(row.tick)
            stamp_ns = time.time_ns() - time.perf_counter_ns() + int(row.stamp_ns)
            joints = self._messages.joint_state(stamp_ns, names, row.q, row.qd, _known(row.effort))
            self._send("joint_states", joints)
            if int(row.imu_stale) >= 0:
                self._send("imu", self._messages.imu(stamp_ns, FRAME, _orientation(row), row.gyro, row.accel))


def _not_taken(asked: str, types: Collection[str]) -> str:
    return (
        f"{asked}: not taken over ROS 2, where nobody proves who they are; taken are {', '.join(sorted(types))} "
        "(gateway.ros2_types in the stream settings); use the page, `flexmotion send` or zenoh with a token"
    )


def _known(values: Any) -> Any:
    """The values, or none where none is known, as `JointState` has it."""
    return values if np.isfinite(values).any() else np.zeros(0)


def _orientation(row: Any) -> Any:
    """Quaternion w x y z of the torso, its heading counted from where the robot stood up; None where unknown."""
    angles = np.array([row.odometry[2], row.tilt[1], row.tilt[0]], float)
    return Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True) if np.isfinite(angles).all() else None
