"""Numbers of a robot file that contradict the robot: `check_numbers` refuses them, `doubtful_numbers` warns."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.get_up import MINIMUM_JERK_PEAK
from flexmotion.configs.robot_file import LONGEST_MOVE_S

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot


def check_numbers(robot: Robot) -> None:
    """Refuse what no robot can mean. Raises `ConfigError`, which names file, field, value and what is valid."""
    imu, safety = robot.config.imu, robot.safety
    if imu is not None and imu.bus is not None and imu.bus not in robot.config.buses:
        raise ConfigError(
            f"{robot.file}: field imu.bus: unknown bus {imu.bus!r}, expected one of: {', '.join(robot.config.buses)}"
        )
    fastest = float(robot.no_load_speed.max())
    if safety.soft_start_speed > fastest:
        raise ConfigError(
            f"{robot.file}: field safety.soft_start_speed: {safety.soft_start_speed:g} rad/s, expected at most "
            f"{fastest:.3g}: no servo of this robot turns faster"
        )
    way = MINIMUM_JERK_PEAK * float(np.abs(robot.stand_pose - robot.rest_pose).max())
    if way > LONGEST_MOVE_S * safety.soft_start_speed:
        raise ConfigError(
            f"{robot.file}: field safety.soft_start_speed: {safety.soft_start_speed:g} rad/s, expected at least "
            f"{math.ceil(1e3 * way / LONGEST_MOVE_S) / 1e3:g}: the way from the rest pose to the stand pose takes "
            f"{way / safety.soft_start_speed:.3g} s, and may take {LONGEST_MOVE_S:g}"
        )
    highest = min(servo.max_voltage for servo in robot.servos)
    if safety.voltage_min is not None and safety.voltage_min > highest:
        raise ConfigError(
            f"{robot.file}: field safety.voltage_min: {safety.voltage_min:g} V, expected less than {highest:g}: a "
            "servo of this robot may not have more, so it would park at once"
        )


def doubtful_numbers(robot: Robot) -> tuple[str, ...]:
    """Messages about numbers that a robot can be run with, but hardly as meant."""
    found, pace, least = list[str](), robot.gait.pace, robot.safety.voltage_min
    nominal = float(robot.nominal_voltage.min())
    if least is not None and least >= nominal:
        found.append(
            f"{robot.file}: field safety.voltage_min: {least:g} V, expected less than {nominal:g}, the nominal voltage "
            "of its servos: below voltage_min the robot parks"
        )
    if pace is not None and pace.reached is not None and pace.reached > pace.ahead:
        found.append(
            f"{robot.file}: field gait.pace.reached: {pace.reached:g} m/s, expected at most {pace.ahead:g} (ahead): "
            "the robot is never asked for more, so ahead is taken"
        )
    return tuple(found)
