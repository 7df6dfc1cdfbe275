"""Finds inertial sensors that are not on a servo bus: built-in ones, and plug-ins in group `flexmotion.imus`."""

from __future__ import annotations

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import parse
from flexmotion.drivers.imu.interface import StandaloneImu
from flexmotion.drivers.plugins import PlugIns

GROUP = "flexmotion.imus"

BUILT_IN = {"witmotion": "flexmotion.drivers.imu.witmotion.sensor:WitMotion"}

_IMUS: PlugIns[StandaloneImu] = PlugIns(GROUP, "IMU", StandaloneImu, BUILT_IN)  # type: ignore[type-abstract]


def available() -> dict[str, type[StandaloneImu]]:
    """Every sensor that can be imported, by name; a warning is logged for each of the others."""
    return _IMUS.available()


def names() -> tuple[str, ...]:
    """Names of all registered sensors, whether or not they can be imported."""
    return _IMUS.names()


def create(robot: Robot, port: str | None = None) -> StandaloneImu:
    """Create the sensor that a robot file names, not yet open; `port` takes precedence over the file's.

    Raises `ConfigError` if there is no such sensor, it cannot be imported, or an option is wrong.
    """
    config = robot.config.imu
    if config is None or config.driver is None:
        raise ConfigError(f"{robot.file}: field imu.driver: none, expected one of: {', '.join(names())}")
    try:
        imu = _IMUS.get(config.driver)
    except ConfigError as error:
        raise ConfigError(
            f"{robot.file}: field imu.driver: {error}; or opencr, on a dynamixel bus with imu.bus and imu.id"
        ) from error
    options = config.options if port is None else config.options | {"port": port}
    return imu(config, options=parse(imu.Options, options, f"{robot.file}: field imu.options"))
