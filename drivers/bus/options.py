"""What may be set about any driver of a servo bus."""

from __future__ import annotations

from pydantic import model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict


class BusOptions(Strict):
    """Options of every driver of a servo bus.

    Attributes:
        port: device of the robot's only bus.
        ports: device of each bus, by the robot file's names, where there are several.
        imu: whether an IMU with a port of its own is read; who only looks at servos does without.
        imu_port: that port; wins over the robot file's.
        configure: settings that servos keep without power are written where they differ from the robot file; without
            it a difference is an error.
    """

    port: str | None = None
    ports: dict[str, str] = {}
    imu: bool = True
    imu_port: str | None = None
    configure: bool = True

    @model_validator(mode="after")
    def _one_way(self) -> BusOptions:
        if (self.port is None) == (not self.ports):
            raise ValueError("expected either port (--port, of the only bus) or ports (by name of the bus)")
        return self

    def port_of(self, bus: str, robot: Robot) -> str:
        """Device of a bus. Raises `ConfigError` where none is given."""
        buses = list(robot.config.buses)
        if self.port is not None and len(buses) == 1:
            return self.port
        if bus not in self.ports:
            raise ConfigError(f"option ports: no device for bus {bus!r}, expected one for each of: {', '.join(buses)}")
        return self.ports[bus]
