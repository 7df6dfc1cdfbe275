"""`MessageMethods`: a method for every message of a client, for both clients."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from flexmotion.streamer.motion.part_values import Side
from flexmotion.streamer.motion.restriction_intents import Foot, Limb

Told = TypeVar("Told", covariant=True)
"""What a method returns: the answer, or what is awaited for it."""


class MessageMethods(ABC, Generic[Told]):
    """A method for every message; each sends it by `ask`. Fields that are None are left out."""

    @abstractmethod
    def ask(self, message: Mapping[str, Any]) -> Told:
        """Send any message of `flexmotion.streamer.gateway.messages` and wait for its answer."""

    def text(self, text: str, *, ttl_s: float | None = None) -> Told:
        """Do what the words say."""
        return self.ask({"type": "text", "text": text, "ttl_s": ttl_s})

    def velocity(self, forward: float, left: float, turning: float, *, ttl_s: float | None = None) -> Told:
        """Walk at a velocity: forward, left [m/s], turning left [rad/s]; for half a second without `ttl_s`."""
        return self.ask({"type": "velocity", "velocity": [forward, left, turning], "ttl_s": ttl_s})

    def heading(self, heading: float, *, turning: float | None = None, ttl_s: float | None = None) -> Told:
        """Turn to a heading in the robot's odometry [rad], at `turning` at most [rad/s], then stand."""
        return self.ask({"type": "heading", "heading_rad": heading, "turning_rad_s": turning, "ttl_s": ttl_s})

    def waypoint(
        self,
        x: float,
        y: float,
        heading: float | None = None,
        *,
        tolerance_m: float | None = None,
        ttl_s: float | None = None,
    ) -> Told:
        """Walk to a place in the robot's odometry [m], turn to a heading there [rad], then stand.

        The answer comes when it sets out; `status()["following"]["end"]` says when it has arrived.
        """
        place = {"position_m": [x, y], "heading_rad": heading, "tolerance_m": tolerance_m}
        return self.ask({"type": "waypoint", **place, "ttl_s": ttl_s})

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
    ) -> Told:
        """Bring a hand to a place in the trunk's frame [m] in a time [s], and hold it there; see `HandMessage`."""
        return self.ask(_of_part("hand", in_s, ttl_s, side=side, position_m=[x, y, z], tolerance_m=tolerance_m))

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
    ) -> Told:
        """Step with a foot to a place seen from the other sole [m, rad], and stand there; see `FootMessage`."""
        return self.ask(
            _of_part("foot", in_s, ttl_s, side=side, position_m=[x, y], heading_rad=heading, tolerance_m=tolerance_m)
        )

    def head(
        self,
        x: float | None,
        y: float | None,
        z: float,
        *,
        in_s: float | None = None,
        tolerance_m: float | None = None,
        ttl_s: float | None = None,
    ) -> Told:
        """Bring the head to a place from the middle between both soles [m], by hips and trunk; see `HeadMessage`.

        None for x or y: wherever the height leads. Not where it looks: that is `look`.
        """
        return self.ask(_of_part("head", in_s, ttl_s, position_m=[x, y, z], tolerance_m=tolerance_m))

    def point(
        self, side: Side, x: float, y: float, z: float, *, in_s: float | None = None, ttl_s: float | None = None
    ) -> Told:
        """Point with an arm into a direction in the trunk's frame; see `PointMessage`."""
        return self.ask(_of_part("point", in_s, ttl_s, side=side, direction=[x, y, z]))

    def look(self, x: float, y: float, z: float, *, in_s: float | None = None, ttl_s: float | None = None) -> Told:
        """Look into a direction in the trunk's frame; see `LookMessage`."""
        return self.ask(_of_part("look", in_s, ttl_s, direction=[x, y, z]))

    def joint(self, joint: str, angle: float, *, in_s: float | None = None, ttl_s: float | None = None) -> Told:
        """Bring a joint of arms or head to an angle [rad]; see `JointMessage`."""
        return self.ask(_of_part("joint", in_s, ttl_s, joint=joint, angle_rad=angle))

    def contact(self, foot: Foot, *, ttl_s: float | None = None) -> Told:
        """Keep a foot on the ground where it is, or both, until it is let go; see `ContactMessage`."""
        return self.ask({"type": "contact", "foot": foot, "ttl_s": ttl_s})

    def torque(self, joint: str, limit: float, *, ttl_s: float | None = None) -> Told:
        """Ask no more than a torque of a joint [N·m], such as `knee`, until it is let go; see `TorqueMessage`."""
        return self.ask({"type": "torque", "joint": joint, "limit_nm": limit, "ttl_s": ttl_s})

    def tension(self, limb: Limb, tension: float, *, ttl_s: float | None = None) -> Told:
        """Let an arm, both, or the head follow as stiffly as that, 0 to 1, until let go; see `TensionMessage`."""
        return self.ask({"type": "tension", "limb": limb, "tension": tension, "ttl_s": ttl_s})

    def relax(self, part: str = "all") -> Told:
        """Let a part go, such as `left hand`, `left foot`, `torque knee`, `tension head`, or all: `RelaxMessage`."""
        return self.ask({"type": "relax", "part": part})

    def clip(self, name: str, *, ttl_s: float | None = None) -> Told:
        """Follow a clip that the run was started with, by its name."""
        return self.ask({"type": "clip", "clip": name, "ttl_s": ttl_s})

    def hold(self) -> Told:
        """Come to a stand; the next target goes on from there."""
        return self.ask({"type": "hold"})

    def arm(self) -> Told:
        """Switch the torque on: the robot stands up."""
        return self.ask({"type": "arm"})

    def disarm(self) -> Told:
        """Come to a stand, park, switch the torque off; the run goes on."""
        return self.ask({"type": "disarm"})

    def limp(self, *joints: str) -> Told:
        """Switch the torque of joints of arms and head off; the robot stands until they are stiff again."""
        return self.ask({"type": "limp", "joints": joints})

    def stiff(self, *joints: str) -> Told:
        """Switch the torque of limp joints on again, where they are."""
        return self.ask({"type": "stiff", "joints": joints})

    def reboot(self, *joints: str) -> Told:
        """Restart the servos of joints, such as those in shutdown, while all torque is off; waits for them."""
        return self.ask({"type": "reboot", "joints": joints})

    def clear(self, *, get_up: bool = False) -> Told:
        """Release a STOP; after a fault lead to OFF, from where `arm` leads back.

        Args:
            get_up: a robot that lies gets up; the answer comes when it stands, or has given up.
        """
        return self.ask({"type": "clear", "get_up": get_up or None})

    def take(self) -> Told:
        """Take the operator's lease over."""
        return self.ask({"type": "take"})

    def release(self) -> Told:
        """Give the operator's lease back."""
        return self.ask({"type": "release"})

    def kill(self, *, confirm: str) -> Told:
        """Switch the torque off at once: the robot falls; `confirm` is "the robot will fall"."""
        return self.ask({"type": "kill", "confirm": confirm})


def _of_part(kind: str, in_s: float | None, ttl_s: float | None, **fields: Any) -> dict[str, Any]:
    """Fields of a message about a part of the body; see `part_messages.py`."""
    return {"type": kind, **fields, "in_s": in_s, "ttl_s": ttl_s}
