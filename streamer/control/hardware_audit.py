"""`HardwareAudit`: what the state of servos, IMU and supply requires: a warning, an orderly end, or no start at all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.streamer.control.punctuality import Punctuality


class HardwareAudit:
    """Checks one measurement against the robot file's safety limits.

    Args:
        punctuality: lateness of the loop; a message about silence mentions it.
        warn: called once with each kind of warning.
    """

    def __init__(self, robot: Robot, punctuality: Punctuality, warn: Callable[[str], None]) -> None:
        self.robot, self.punctuality = robot, punctuality
        self._warn_of = warn
        self._warned: set[str] = set()
        self._low_reads = 0
        self._shutdown_at = np.array([servo.temperature_limit for servo in robot.servos])

    def lost_bus(self, measured: RobotState) -> str | None:
        """Why the bus counts as lost; None while any joint answers."""
        if measured.stale.min() <= self.robot.safety.max_stale_reads:
            return None
        reads = f"{int(measured.stale.min())} reads{self.punctuality.remark}"
        return f"bus lost: no joint has answered for {reads}"

    def problem(self, measured: RobotState) -> str | None:
        """Why the run must come to an orderly end; None while servos, IMU and supply are well. Call it once a tick."""
        limits = self.robot.safety
        if measured.stale.max() > limits.max_stale_reads:
            return self._of_servo(f"does not answer{self.punctuality.remark}", int(np.argmax(measured.stale)))
        if measured.hardware_error.any():
            worst = int(np.flatnonzero(measured.hardware_error)[0])
            return self._of_servo(f"reports hardware error 0x{int(measured.hardware_error[worst]):02x}", worst)
        imu = self.robot.config.imu
        if imu is not None and imu.required and measured.imu_stale > limits.max_stale_reads:
            return f"IMU has not answered for {measured.imu_stale} reads{self.punctuality.remark}"
        return self._overheating(measured) or self._low_supply(measured)

    def refusal(self, measured: RobotState, unread: NDArray[np.int64], has_imu: bool) -> str | None:
        """Why torque must not be switched on; None where a start is safe.

        Args:
            unread: reads since each joint last returned a number, (n,).
            has_imu: whether the IMU answers.
        """
        robot, position = self.robot, measured.position
        silent = np.flatnonzero(unread)
        # A joint sags into its stops by up to this margin. Further out it was forced or its zero is wrong, and no goal
        # can be pinned there.
        margin = robot.safety.standing_margin
        outside = np.flatnonzero((position < robot.lower - margin) | (position > robot.upper + margin))
        imu = robot.config.imu
        if len(silent):
            return self._of_servo("returns no position", int(silent[0]))
        if len(outside):
            joint = int(outside[0])
            return self._of_servo(
                f"stands at {position[joint]:.2f} rad, more than {margin:g} rad outside "
                f"[{robot.lower[joint]:.2f}, {robot.upper[joint]:.2f}]: move it by hand",
                joint,
            )
        if imu is not None and imu.required and not has_imu:
            return "the robot file requires an IMU and none answers"
        return self.problem(measured)

    def warn(self, kind: str, message: str) -> None:
        """Warn, unless a warning of this kind was given before."""
        if kind not in self._warned:
            self._warned.add(kind)
            self._warn_of(message)

    def _overheating(self, measured: RobotState) -> str | None:
        """Why the hottest servo ends the run; within twice the margin of its shutdown it is only warned of."""
        margin = self.robot.safety.thermal_margin
        heat = measured.temperature - self._shutdown_at
        if not np.fmax.reduce(heat) > -2 * margin:
            return None
        hottest = int(np.nanargmax(heat))
        now, shutdown = measured.temperature[hottest], self._shutdown_at[hottest]
        message = self._of_servo(f"is at {now:.0f} °C and shuts down at {shutdown:.0f} °C", hottest)
        if heat[hottest] > -margin:
            return message
        self.warn(f"heat {hottest}", message)
        return None

    def _low_supply(self, measured: RobotState) -> str | None:
        """Why the supply ends the run: it was low for more reads in a row than a servo may be silent."""
        limits = self.robot.safety
        supply = np.fmin.reduce(measured.voltage)
        low = limits.voltage_min is not None and supply < limits.voltage_min
        self._low_reads = self._low_reads + 1 if low else 0
        if self._low_reads > limits.max_stale_reads:
            return f"supply at {supply:.1f} V, below {limits.voltage_min:.1f} V"
        return None

    def _of_servo(self, what: str, joint: int) -> str:
        return f"servo of {self.robot.joint_names[joint]} (id {self.robot.joints[joint].id}) {what}"
