"""`Ros2Stops`: STOP and emergency stop from ROS 2 (`std_msgs/Empty`), in the stop process with a session of its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from flexmotion.streamer.gateway.presses import Presses
from flexmotion.streamer.gateway.transports.ros2_messages import EMPTY, STRING, Ros2Messages
from flexmotion.streamer.gateway.transports.ros2_node import Ros2Link, Ros2Node
from flexmotion.streamer.gateway.transports.zenoh_session import keep_open
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.requests import Request

if TYPE_CHECKING:
    import zenoh


class Ros2Stops:
    """A `flexmotion.streamer.gateway.presses.StopInput`."""

    name = "ros2"

    def __init__(self, link: Ros2Link) -> None:
        self.link = link
        self._messages = Ros2Messages()  # before the process is forked: the library takes a second to load

    def begin(self, presses: Presses, way: Way) -> Callable[[], None]:
        """See `StopInput.begin`."""

        def serve(session: zenoh.Session) -> list[Any]:
            node = Ros2Node(self.link, session, "flexmotion_stops", self._messages, way)
            send = node.publish("answers", STRING)

            def reply(content: dict[str, Any]) -> None:
                send(self._messages.string(json.dumps({**content, "source": self.name})))

            def press(asked: Request, _data: bytes) -> None:
                presses.press(asked, self.name, reply)

            node.subscribe("stop", EMPTY, partial(press, Request.STOP))
            node.subscribe("estop", EMPTY, partial(press, Request.ESTOP))
            return node.declared

        return keep_open(self.link.config, serve, way, "ros2-stops", f"the zenoh router at {self.link.router}")
