"""A robot's calibration: zeros of its servos and mounting of its IMU, in a file beside the robot file.

The calibration takes precedence over the robot file.
"""

from __future__ import annotations

from pathlib import Path

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot_file import Imu, JointConfig, Quaternion
from flexmotion.configs.schema import Strict, load, store
from flexmotion.configs.servo import Servo

FILE = "calibration.yaml"


class CalibratedJoint(Strict):
    """One joint: servo angle = direction * joint angle + zero [rad], valid for this servo and id."""

    zero: float
    servo: str
    id: int


class CalibratedImu(Strict):
    """The IMU's frame in the body that carries it, w x y z, valid for this driver."""

    quaternion: Quaternion
    driver: str


class Calibration(Strict):
    """Measured values, and the date of the last change (ISO 8601)."""

    date: str
    joints: dict[str, CalibratedJoint]
    imu: CalibratedImu | None = None


def read_calibration(folder: Path) -> Calibration | None:
    """The calibration beside a robot file; None if there is none. Raises `ConfigError` if it is malformed."""
    file = folder / FILE
    return load(Calibration, file) if file.is_file() else None


def write_calibration(folder: Path, calibration: Calibration) -> Path:
    """Write it beside the robot file, completely or not at all. Raises `ConfigError` if the file cannot be written."""
    return store(calibration, folder / FILE)


def check_zero(joint: JointConfig, servo: Servo, zero: float) -> None:
    """Raise `ConfigError` if a servo cannot reach its joint's limits with this zero [rad]."""
    ends = sorted((angle - zero) * joint.direction for angle in servo.range)
    if joint.limits[0] < ends[0] - 1e-9 or joint.limits[1] > ends[1] + 1e-9:
        raise ConfigError(
            f"joint {joint.name!r}: limits {list(joint.limits)} exceed the range of {servo.name}, "
            f"[{ends[0]:.3f}, {ends[1]:.3f}] rad, with its zero at {zero:+.3f} rad"
        )


def calibrated(joints: list[JointConfig], folder: Path) -> tuple[JointConfig, ...]:
    """Joints of a robot file with their calibrated zeros.

    Raises `ConfigError` if the calibration names an unknown joint, or was made with another servo or id.
    """
    calibration = read_calibration(folder)
    if calibration is None:
        return tuple(joints)
    known = {joint.name: joint for joint in joints}
    for name, measured in calibration.joints.items():
        if name not in known:
            raise ConfigError(f"{folder / FILE}: field joints: unknown joint {name!r}, calibrate again")
        joint = known[name]
        if (measured.servo, measured.id) != (joint.servo, joint.id):
            raise ConfigError(
                f"{folder / FILE}: joint {name!r} was calibrated with {measured.servo} (id {measured.id}), "
                f"the robot file has {joint.servo} (id {joint.id}): calibrate again"
            )
        known[name] = joint.model_copy(update={"zero": measured.zero})
    return tuple(known.values())


def calibrated_imu(imu: Imu | None, folder: Path) -> Imu | None:
    """A robot file's IMU with its calibrated mounting. Raises `ConfigError` if another one was calibrated."""
    calibration = read_calibration(folder)
    if calibration is None or calibration.imu is None:
        return imu
    if imu is None or imu.driver != calibration.imu.driver:
        found = "none" if imu is None else repr(imu.driver)
        raise ConfigError(
            f"{folder / FILE}: field imu: was calibrated with driver {calibration.imu.driver!r}, the robot file has "
            f"{found}: calibrate again, or remove the field"
        )
    return imu.model_copy(update={"quaternion": calibration.imu.quaternion})
