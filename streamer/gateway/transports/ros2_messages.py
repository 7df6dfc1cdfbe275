"""Messages of ROS 2: the definitions that are needed (`common_interfaces` of Jazzy), and their CDR (`rosbags`).

The definitions are kept here, since nothing is fetched while a robot runs; comments and defaults are left out.
"""

from __future__ import annotations

from typing import Any

STRING, EMPTY = "std_msgs/msg/String", "std_msgs/msg/Empty"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
_TIME, _HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
_VECTOR, _QUATERNION = "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion"

DEFINITIONS = {
    _TIME: "int32 sec\nuint32 nanosec",
    _HEADER: "builtin_interfaces/Time stamp\nstring frame_id",
    _VECTOR: "float64 x\nfloat64 y\nfloat64 z",
    _QUATERNION: "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    STRING: "string data",
    EMPTY: "",
    TWIST: "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    TWIST_STAMPED: "std_msgs/Header header\ngeometry_msgs/Twist twist",
    JOINT_STATE: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
    IMU: (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
    ),
}


class Ros2Messages:
    """Encodes and decodes messages."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._store = get_typestore(Stores.EMPTY)
        known: dict[str, Any] = {}
        for name, text in DEFINITIONS.items():
            known |= get_types_from_msg(text, name)
        self._store.register(known)

    def hash(self, kind: str) -> str:
        """The type's hash, as keys of topics have it (REP 2016)."""
        return self._store.hash_rihs01(kind)

    def decode(self, kind: str, data: bytes) -> Any:
        """A message from CDR.

        Raises:
            ValueError: it is none of this type.
        """
        try:
            return self._store.deserialize_cdr(data, kind)
        except Exception as error:  # the library's code for a type checks nothing
            raise ValueError(f"no {kind}: {type(error).__name__}: {error}") from None

    def string(self, text: str) -> bytes:
        """A `String` as CDR."""
        return self._encode(STRING, data=text)

    def joint_state(self, stamp_ns: int, names: list[str], position: Any, velocity: Any, effort: Any) -> bytes:
        """A `JointState` as CDR; arrays (n,) of float64 [rad, rad/s, N·m], or (0,) where unknown."""
        return self._encode(
            JOINT_STATE,
            header=self._header(stamp_ns, ""),
            name=names,
            position=position,
            velocity=velocity,
            effort=effort,
        )

    def imu(self, stamp_ns: int, frame: str, orientation: Any, gyro: Any, accel: Any) -> bytes:
        """An `Imu` as CDR.

        Args:
            stamp_ns: time since 1970 [ns].
            frame: that gyro and accel are in.
            orientation: quaternion w x y z (4,); None: unknown.
            gyro, accel: angular velocity [rad/s] and specific force [m/s²], (3,).
        """
        import numpy as np

        types, unknown = self._store.types, np.zeros(9)
        w, x, y, z = (1.0, 0.0, 0.0, 0.0) if orientation is None else map(float, orientation)
        # A first element of -1 says that the orientation is unknown, zeros that the covariance is.
        covariance = np.where(np.arange(9) == 0, -1.0, 0.0) if orientation is None else unknown
        return self._encode(
            IMU,
            header=self._header(stamp_ns, frame),
            orientation=types[_QUATERNION](x=x, y=y, z=z, w=w),
            orientation_covariance=covariance,
            angular_velocity=self._vector(gyro),
            angular_velocity_covariance=unknown,
            linear_acceleration=self._vector(accel),
            linear_acceleration_covariance=unknown,
        )

    def empty(self) -> bytes:
        """An `Empty` as CDR."""
        return self._encode(EMPTY)

    def _encode(self, kind: str, **fields: Any) -> bytes:
        return bytes(self._store.serialize_cdr(self._store.types[kind](**fields), kind))

    def _header(self, stamp_ns: int, frame: str) -> Any:
        types = self._store.types
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        return types[_HEADER](stamp=types[_TIME](sec=seconds, nanosec=nanoseconds), frame_id=frame)

    def _vector(self, values: Any) -> Any:
        x, y, z = map(float, values)
        return self._store.types[_VECTOR](x=x, y=y, z=z)
