"""The motion of a joint in a log, for `flexmotion.drivers.identification`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers import registry
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.identification.record import RobotRecord, new_angles
from flexmotion.drivers.sim.options import BUS_S, SimOptions
from flexmotion.streamer.control.ladder import POWERED
from flexmotion.streamer.log.reader import Log

WINDOW_S, MOST_WINDOWS = 10.0, 6
"""A log is cut into windows of this length, and those in which the joint moves most are used [s]."""


def motion_record(log: Log, robot: Robot, joint: int) -> RobotRecord:
    """What a log says of a joint: ticks in which its torque is on, and in which no ground force acts on its limb.

    Args:
        robot: as in the log's header.
        joint: index.

    Raises:
        ConfigError: the log is of another robot, or has no such ticks.
    """
    if log.header.joints != robot.joint_names:
        raise ConfigError(f"{log.path}: is of a robot with other joints than {robot.file}")
    rows = log.rows
    name = robot.joint_names[joint]
    powered = np.isin(rows["state"], [int(state) for state in POWERED]) & np.isfinite(rows["q_cmd"][:, joint])
    if not powered.any():
        raise ConfigError(f"{log.path}: the torque of {name!r} is never on")
    used = powered & rows["hung"] if _is_of_a_leg(robot, name) else powered
    if not used.any():
        raise ConfigError(
            f"{log.path}: {name!r} carries the robot, and the ground's forces are not measured: identify it on a stand "
            "(`flexmotion servo identify --port`), or from a log with the feet in the air"
        )
    lockstep = log.header.clock == "lockstep"
    time = rows["tick"] / log.header.rate_hz if lockstep else (rows["stamp_ns"] - rows["stamp_ns"][0]) * 1e-9
    bus_s, turns = _bus(log, robot)
    known = (rows["imu_stale"] == 0)[:, None]
    record = RobotRecord(
        time=np.asarray(time, np.float64),
        # Goals are sent at the end of a tick's work; in lockstep no time passes in a tick.
        goal_time=np.asarray(time if lockstep else time + rows["work_s"], np.float64),
        goal=rows["q_cmd"],
        position=rows["q"],
        effort=rows["effort"],
        voltage=rows["voltage"],
        fresh=new_angles(rows["q"], rows["stale"] == 0, turns),
        accel=np.where(known, rows["accel"], np.nan),
        gyro=np.where(known, rows["gyro"], np.nan),
        bus_s=bus_s,
        motion=f"log {log.path.name}",
    )
    return record.part(_liveliest(record, joint, used, robot.rate_hz))


def _is_of_a_leg(robot: Robot, name: str) -> bool:
    legs = robot.mapping.left_leg, robot.mapping.right_leg
    return any(name in dict(leg).values() for leg in legs)


def _liveliest(record: RobotRecord, joint: int, used: NDArray[np.bool_], rate_hz: float) -> NDArray[np.int64]:
    """Ticks of the windows in which the joint moves most, in order."""
    size = round(WINDOW_S * rate_hz)
    windows = [np.arange(first, min(first + size, len(record))) for first in range(0, len(record), size)]
    windows = [window[used[window]] for window in windows]

    def moved(window: NDArray[np.int64]) -> float:
        return float(np.nansum(np.abs(np.diff(record.goal[window, joint]))))

    chosen = sorted((w for w in windows if len(w)), key=moved, reverse=True)[:MOST_WINDOWS]
    return np.sort(np.concatenate(chosen))


def _bus(log: Log, robot: Robot) -> tuple[float, int]:
    """`RobotRecord.bus_s` and `Driver.turns`. Raises `ConfigError` if they are not known for the log's driver."""
    name = log.header.driver
    if name == "sim":
        options = SimOptions.model_validate(log.header.driver_options)
        given = options.command_delay_s
        assumed = float(np.mean([servo.delay for servo in robot.catalogue_servos]))
        return (BUS_S if given is None else given - assumed) + options.read_delay_s, 1
    kind = registry.available().get(name)
    if kind is None or not issubclass(kind, BusDriver):
        raise ConfigError(
            f"{log.path}: is of driver {name!r}, whose bus time is not known, expected a servo bus or sim"
        )
    budgets = [kind.Bus.budget(robot, bus) for bus in robot.config.buses]
    turns = max(kind.Bus.turns(robot, bus) for bus in robot.config.buses)
    return max(budget.write_s - budget.asked_s for budget in budgets), turns
