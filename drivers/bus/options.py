"""Options of the drivers of servo buses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict


class BusOptions(Strict):
    """Options of every driver of a servo bus.

    Attributes:
        port: device of the robot's only bus.
        ports: device of each bus, by its name in the robot file, if there are several.
        imu: whether an IMU with a port of its own is read; tools for servos switch it off.
        imu_port: port of that IMU; takes precedence over the robot file's.
    """

    port: str | None = None
    ports: dict[str, str] = {}
    imu: bool = True
    imu_port: str | None = None

    @model_validator(mode="after")
    def _one_way(self) -> BusOptions:
        if (self.port is None) == (not self.ports):
            raise ValueError("expected either port (--port, for the only bus) or ports (--port BUS=DEVICE,BUS=DEVICE)")
        return self

    def port_of(self, bus: str, robot: Robot) -> str:
        """Device of a bus. Raises `ConfigError` if none is given."""
        buses = list(robot.config.buses)
        if self.port is not None and len(buses) == 1:
            return self.port
        if bus not in self.ports:
            wanted = ",".join(f"{name}=DEVICE" for name in buses)
            raise ConfigError(f"no port for bus {bus!r}, expected one for each bus: --port {wanted}")
        return self.ports[bus]


def ports_in(text: str) -> dict[str, Any]:
    """Fields `port` or `ports` of `BusOptions` from one text: `DEVICE`, or `BUS=DEVICE,BUS=DEVICE` for several buses.

    Raises:
        ConfigError: a bus or its device is missing in the text.
    """
    if "=" not in text or Path(text).exists():
        return {"port": text}
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(bus and device for bus, _, device in pairs):
        raise ConfigError(f"--port {text}: expected DEVICE, or BUS=DEVICE,BUS=DEVICE for a robot with several buses")
    return {"ports": {bus: device for bus, _, device in pairs}}
