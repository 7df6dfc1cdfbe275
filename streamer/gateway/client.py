"""`Client`: another program's side of a run that was started with `--web`.

```python
import flexmotion as fm

with fm.Client() as robot:
    print(robot.text("wave with the right hand"))
    robot.velocity(0.3, 0.0, 0.0, ttl_s=4.0)
    print(robot.status()["state"])
```
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

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


class Client(Messages):
    """A connection to a run, for a program that waits for each answer; see `AsyncClient` for one that does not.

    Raises:
        GatewayError: no run listens, it refuses the connection, or it does not answer in time.
        MessageError: a message is not valid.
    """

    _socket: Any = None
    _open: ExitStack

    def __enter__(self) -> Self:
        self._connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; what the robot follows stays as it is until its time is over."""
        if self._socket is not None:
            self._socket = None
            self._open.close()

    def text(self, text: str, *, ttl_s: float | None = None) -> Answer:
        """Do what the words say."""
        return self.ask(text_content(text, ttl_s))

    def velocity(self, forward: float, left: float, turning: float, *, ttl_s: float | None = None) -> Answer:
        """Walk at a velocity: forward, left [m/s], turning left [rad/s]; for half a second without `ttl_s`."""
        return self.ask(velocity_content(forward, left, turning, ttl_s))

    def heading(self, heading: float, *, turning: float | None = None, ttl_s: float | None = None) -> Answer:
        """Turn to a heading in the robot's odometry [rad], at `turning` at most [rad/s], then stand."""
        return self.ask(heading_content(heading, turning, ttl_s))

    def waypoint(
        self,
        x: float,
        y: float,
        heading: float | None = None,
        *,
        tolerance_m: float | None = None,
        ttl_s: float | None = None,
    ) -> Answer:
        """Walk to a place in the robot's odometry [m], turn to a heading there [rad], then stand.

        The answer comes when it sets out; `status()["following"]["end"]` says when it has arrived.
        """
        return self.ask(waypoint_content(x, y, heading, tolerance_m, ttl_s))

    def hand(
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
        """Bring a hand to a place in the trunk's frame [m] in a time [s], and hold it there; see `HandMessage`."""
        return self.ask(part_content("hand", in_s, ttl_s, side=side, position_m=[x, y, z], tolerance_m=tolerance_m))

    def foot(
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
        """Step with a foot to a place seen from the other sole [m, rad], and stand there; see `FootMessage`."""
        return self.ask(
            part_content(
                "foot", in_s, ttl_s, side=side, position_m=[x, y], heading_rad=heading, tolerance_m=tolerance_m
            )
        )

    def point(
        self, side: Side, x: float, y: float, z: float, *, in_s: float | None = None, ttl_s: float | None = None
    ) -> Answer:
        """Point with an arm into a direction in the trunk's frame; see `PointMessage`."""
        return self.ask(part_content("point", in_s, ttl_s, side=side, direction=[x, y, z]))

    def look(self, x: float, y: float, z: float, *, in_s: float | None = None, ttl_s: float | None = None) -> Answer:
        """Look into a direction in the trunk's frame; see `LookMessage`."""
        return self.ask(part_content("look", in_s, ttl_s, direction=[x, y, z]))

    def joint(self, joint: str, angle: float, *, in_s: float | None = None, ttl_s: float | None = None) -> Answer:
        """Bring a joint of arms or head to an angle [rad]; see `JointMessage`."""
        return self.ask(part_content("joint", in_s, ttl_s, joint=joint, angle_rad=angle))

    def contact(self, foot: Foot, *, ttl_s: float | None = None) -> Answer:
        """Keep a foot on the ground where it is, or both, until it is let go; see `ContactMessage`."""
        return self.ask({"type": "contact", "foot": foot, "ttl_s": ttl_s})

    def torque(self, joint: str, limit: float, *, ttl_s: float | None = None) -> Answer:
        """Ask no more than a torque of a joint [N·m], such as `knee`, until it is let go; see `TorqueMessage`."""
        return self.ask({"type": "torque", "joint": joint, "limit_nm": limit, "ttl_s": ttl_s})

    def tension(self, limb: Limb, tension: float, *, ttl_s: float | None = None) -> Answer:
        """Let an arm, both, or the head follow as stiffly as that, 0 to 1, until let go; see `TensionMessage`."""
        return self.ask({"type": "tension", "limb": limb, "tension": tension, "ttl_s": ttl_s})

    def relax(self, part: str = "all") -> Answer:
        """Let a part go, such as `left hand`, `left foot`, `torque knee`, `tension head`, or all: `RelaxMessage`."""
        return self.ask({"type": "relax", "part": part})

    def clip(self, name: str, *, ttl_s: float | None = None) -> Answer:
        """Follow a clip that the run was started with, by its name."""
        return self.ask({"type": "clip", "clip": name, "ttl_s": ttl_s})

    def hold(self) -> Answer:
        """Come to a stand; the next target goes on from there."""
        return self.ask({"type": "hold"})

    def arm(self) -> Answer:
        """Switch the torque on: the robot stands up."""
        return self.ask({"type": "arm"})

    def disarm(self) -> Answer:
        """Come to a stand, park, switch the torque off; the run goes on."""
        return self.ask({"type": "disarm"})

    def limp(self, *joints: str) -> Answer:
        """Switch the torque of joints of arms and head off; the robot stands until they are stiff again."""
        return self.ask({"type": "limp", "joints": joints})

    def stiff(self, *joints: str) -> Answer:
        """Switch the torque of limp joints on again, where they are."""
        return self.ask({"type": "stiff", "joints": joints})

    def reboot(self, *joints: str) -> Answer:
        """Restart the servos of joints, such as those in shutdown, while all torque is off; waits for them."""
        return self.ask({"type": "reboot", "joints": joints})

    def clear(self, *, get_up: bool = False) -> Answer:
        """Release a STOP; after a fault lead to OFF, from where `arm` leads back.

        Args:
            get_up: a robot that lies gets up; the answer comes when it stands, or has given up.
        """
        return self.ask(clear_content(get_up))

    def take(self) -> Answer:
        """Take the operator's lease over."""
        return self.ask({"type": "take"})

    def release(self) -> Answer:
        """Give the operator's lease back."""
        return self.ask({"type": "release"})

    def kill(self, *, confirm: str) -> Answer:
        """Switch the torque off at once: the robot falls; `confirm` is "the robot will fall"."""
        return self.ask(kill_content(confirm))

    def stop(self) -> StopAnswer:
        """Come to a stand and stay, by the stop process; needs no token."""
        return self.press("stop")

    def estop(self) -> StopAnswer:
        """Stop as the robot file says, then park, by the stop process."""
        return self.press("estop")

    def status(self) -> dict[str, Any]:
        """The run now: `flexmotion.streamer.gateway.status.Status` as JSON."""
        return self.fetch("GET", self.port, "/status")

    def ask(self, message: Mapping[str, Any]) -> Answer:
        """Send any message of `flexmotion.streamer.gateway.messages` and wait for its answer."""
        identity, text = self.message(message)
        self._connect()
        try:
            self._socket.send(text)
            while True:
                answer = answer_in(self._socket.recv(patience_of(message)))
                if isinstance(answer, Ended):
                    self._ended.add(answer)
                elif answer is not None and answer.id == identity:
                    self._ended.take(answer)
                    return answer
        except (OSError, WebSocketException, ValueError) as error:
            self.close()
            raise self.failed(error) from error

    def wait(self, answer: Answer, *, patience_s: float | None = None) -> Ended:
        """Wait for the end of a target for the whole body: words, a velocity, a heading, a waypoint, a clip.

        Args:
            answer: to it, on this connection.
            patience_s: greatest time [s]; None: as long as it takes. Words without an amount end with the next target.

        Raises:
            GatewayError: the target is not followed, or is for a part of the body; its end did not come in time; the
                connection was closed.
        """
        target = awaited(answer)
        due_s = None if patience_s is None else time.monotonic() + patience_s
        try:
            while (ended := self._ended.of(target)) is None:
                left_s = None if due_s is None else max(due_s - time.monotonic(), 0.0)
                if self._socket is None:
                    raise ConnectionResetError("the connection on which it was asked for is closed")
                found = answer_in(self._socket.recv(left_s))
                if isinstance(found, Ended):
                    self._ended.add(found)
        except TimeoutError as error:
            if patience_s is None:  # of the connection itself
                raise self.failed(error) from error
            raise GatewayError(f"target {target} has not ended within {patience_s:g} s") from None
        except (OSError, WebSocketException, ValueError) as error:
            self.close()
            raise self.failed(error) from error
        return ended

    def _connect(self) -> None:
        if self._socket is not None:
            return
        self._ended = Ends()
        self._open = ExitStack()
        try:
            self._socket = self._open.enter_context(connect(self.url, **self.options))
        except (OSError, WebSocketException) as error:
            raise self.failed(error) from error
        self.learn_stop_port()
