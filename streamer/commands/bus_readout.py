"""Reading a robot's servos for a command; nothing is written to them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer

from flexmotion.configs.errors import ConfigError, DriverError

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.bench import Bench

PortOption = Annotated[str, typer.Option("--port", "-p", help="Port of the servo bus.")]
PORTS_HELP = "Port of the servo bus; of several: BUS=PORT,BUS=PORT."
PortsOption = Annotated[str, typer.Option("--port", "-p", metavar="PORT", help=PORTS_HELP)]

_TRIES, _STILL_READS, _STILL_RAD, _PAUSE_S = 5, 6, 0.01, 0.02
"""Reads within which a joint answers; reads of a joint at rest, how far they may be apart [rad], their pause [s]."""


def open_bench(
    robot: Robot, port: str, *, imu: bool = False, imu_port: str | None = None, power: bool = False
) -> Bench:
    """The robot's servos on a port, for a `with` statement; torque stays as it is, before and after.

    Args:
        port: as `flexmotion.drivers.bus.options.ports_in` takes it.
        imu: read the IMU too, on a port of its own if `imu_port` says so.
        power: let the robot's board switch the power of the servos on.

    Raises:
        DriverError: the port fails.
    """
    from flexmotion.drivers.bench import Bench
    from flexmotion.drivers.bus.options import BusOptions, ports_in

    return Bench(robot, BusOptions(imu=imu, imu_port=imu_port, **ports_in(port)), imu=imu, power=power)


def refuse_shipped(robot: Robot) -> None:
    """What is measured is of one robot: the shipped file is that of all of its kind. Raises `ConfigError`."""
    from flexmotion.configs.robot import is_shipped

    if is_shipped(robot):
        raise ConfigError(
            f"--robot {robot.name}: a shipped robot, whose folder is the program's; copy {robot.folder} to one of "
            "your own and give that folder"
        )


def angle_at_rest(bench: Bench, index: int) -> float | None:
    """A joint's angle [rad]; None: it moves. Raises `DriverError` if its servo does not answer."""
    seen: list[float] = []
    for _ in range(_TRIES * _STILL_READS):
        angle = bench.angle(index)
        if angle is not None:
            seen.append(angle)
        if len(seen) == _STILL_READS:
            return seen[-1] if max(seen) - min(seen) < _STILL_RAD else None
        time.sleep(_PAUSE_S)
    joint = bench.robot.joints[index]
    raise DriverError(f"servo of {joint.name} (id {joint.id}): does not answer")
