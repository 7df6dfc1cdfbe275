"""Velocities as another node of ROS 2 sends them: CDR of Jazzy's own definitions."""

from __future__ import annotations

from functools import cache
from typing import Any

from flexmotion.streamer.gateway.transports.ros2_messages import TWIST, TWIST_STAMPED

Vector = tuple[float, float, float]


@cache
def _jazzy() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _encoded(kind: str, content: Any) -> bytes:
    return bytes(_jazzy().serialize_cdr(content, kind))


def _twist(linear: Vector, angular: Vector) -> Any:
    types = _jazzy().types
    vectors = (types["geometry_msgs/msg/Vector3"](*values) for values in (linear, angular))
    return types[TWIST](*vectors)


def twist(linear: Vector, angular: Vector) -> bytes:
    """A `Twist` [m/s, rad/s]."""
    return _encoded(TWIST, _twist(linear, angular))


def twist_stamped(stamp_ns: int, linear: Vector, angular: Vector) -> bytes:
    """A `TwistStamped`; `stamp_ns`: time since 1970 [ns]."""
    types = _jazzy().types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    return _encoded(TWIST_STAMPED, types[TWIST_STAMPED](header=header, twist=_twist(linear, angular)))
