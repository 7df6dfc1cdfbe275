"""Finds inertial sensors that are no part of a servo bus: built in, or plug-ins in group `flexmotion.imus`."""

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
    """Every sensor that imports, by name; the others are logged as warnings."""
    return _IMUS.available()


def names() -> tuple[str, ...]:
    """Names of all registered sensors, whether or not they import."""
    return _IMUS.names()


def create(robot: Robot, port: str | None = None) -> StandaloneImu:
    """The sensor that a robot file names, not yet open; `port` wins over the file's.

    Raises `ConfigError` where there is no such sensor, it does not import, or an option of it is wrong.
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
