"""`HardwareAudit`: what the state of servos, IMU and supply requires: a warning, an orderly end, or no start at all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.masks import some
from flexmotion.streamer.control.obedience import Obedience
from flexmotion.streamer.control.plausibility import KINDS, Plausibility
from flexmotion.streamer.control.punctuality import Punctuality

Float = NDArray[np.float64]

IMU_BACK_S = 1.0
"""An IMU that has measured for so long is back [s]; one that comes and goes is told once."""
SUPPLY_ERROR = 0x01
"""Error bit of Dynamixel and Feetech servos: the supply is outside the servo's own limits; torque stays on."""

_BUS_BACK = "mend cable or power; if it stays silent, start the run again: ports and servos are set up as a run begins"


def silence_of(robot: Robot, stale: NDArray[np.int64]) -> str | None:
    """How long the whole bus has been silent; None while any joint answers.

    Args:
        stale: reads since each joint last answered, (n,).
    """
    reads = int(stale.min())
    return None if reads <= robot.safety.max_stale_reads else f"no joint has answered for {reads} reads"


class HardwareAudit:
    """Checks one measurement against the robot file's safety limits.

    Args:
        punctuality: lateness of the loop; a message about silence mentions it.
        plausibility: which sensors give readings that cannot be.
        obedience: which servos do not do what their goals ask.
        warn: called once with each kind of warning; with a silent IMU each time that it falls silent.
        note: called when the IMU measures again.
    """

    def __init__(
        self,
        robot: Robot,
        punctuality: Punctuality,
        plausibility: Plausibility,
        obedience: Obedience,
        warn: Callable[[str], None],
        note: Callable[[str], None],
    ) -> None:
        self.robot, self.punctuality = robot, punctuality
        self.plausibility, self.obedience = plausibility, obedience
        self._warn_of, self._note = warn, note
        self._blind, self._sees = False, 0  # without an IMU, and for how many ticks it has measured again
        self._warned: set[str] = set()
        self._low_reads, self._supply_reads = np.zeros(robot.n, np.int64), np.zeros(robot.n, np.int64)
        self._catalogue = np.array([servo.temperature_limit for servo in robot.servos])
        self._shutdown_at = self._catalogue.copy()
        self._least_supply = np.full(robot.n, robot.safety.voltage_min or 0.0)

    def take_limits(self, temperature: Float, voltage: Float) -> None:
        """Take the servos' own limits, where they are narrower than those of the catalogue and the robot file.

        Args:
            temperature: at which each servo switches itself off, (n,) [°C].
            voltage: below which each reports an error, (n,) [V].
        """
        np.minimum(self._catalogue, temperature, out=self._shutdown_at)
        np.maximum(self.robot.safety.voltage_min or 0.0, voltage, out=self._least_supply)

    def lost_bus(self, measured: RobotState) -> str | None:
        """Why the bus counts as lost; None while any joint answers."""
        if not some(measured.stale):
            return None
        silence = silence_of(self.robot, measured.stale)
        return None if silence is None else f"bus lost: {silence}{self.punctuality.remark}"

    def watch(self, measured: RobotState) -> None:
        """Count the readings that must last to be a problem; for ticks that do not call `problem`, once in each."""
        low = measured.voltage < self._least_supply
        if some(low) or some(self._low_reads):
            self._low_reads[:] = np.where(low, self._low_reads + 1, 0)
        if some(measured.hardware_error) or some(self._supply_reads):
            supply = (measured.hardware_error & SUPPLY_ERROR) != 0
            self._supply_reads[:] = np.where(supply, self._supply_reads + 1, 0)

    def problem(self, measured: RobotState) -> str | None:
        """Why the run must come to an orderly end; None while servos, IMU and supply are well. Call it once a tick."""
        self.watch(measured)
        limits = self.robot.safety
        wrong = self._wrong_sensor()
        if wrong is not None:
            return wrong
        if some(measured.stale) and measured.stale.max() > limits.max_stale_reads:
            return self._of_servo(f"does not answer{self.punctuality.remark}", int(np.argmax(measured.stale)))
        error = self._hardware_error(measured)
        if error is not None:
            return error
        imu = self.robot.config.imu
        if imu is not None and imu.required and measured.imu_stale > limits.max_stale_reads:
            if self._imu_lies:
                return "IMU measures what cannot be"
            return f"IMU has not answered for {measured.imu_stale} reads{self.punctuality.remark}"
        return self._overheating(measured) or self._low_supply(measured)

    def blocked(self) -> str | None:
        """Which servo does not follow its goals; None while all do."""
        joint = self.obedience.worst
        if joint is None:
            return None
        return self._of_servo(
            f"does not follow its goals: {self.obedience.describe(joint)}{self.punctuality.remark}", joint
        )

    def refusal(self, measured: RobotState, unread: NDArray[np.int64], has_imu: bool) -> str | None:
        """Why torque must not be switched on; None where a start is safe.

        Args:
            unread: reads since each joint was last believed, (n,).
            has_imu: whether the IMU answers.
        """
        robot, position = self.robot, measured.position
        silent = np.flatnonzero(unread > robot.safety.max_stale_reads)
        # A joint sags into its stops by up to this margin. Further out it was forced or its zero is wrong, and no goal
        # can be pinned there.
        margin = robot.safety.standing_margin
        outside = np.flatnonzero((position < robot.lower - margin) | (position > robot.upper + margin))
        imu = robot.config.imu
        silence = silence_of(robot, measured.stale)
        if silence is not None:
            return f"the bus is silent, {silence}: {_BUS_BACK}"
        if len(silent):
            joint = int(silent[0])
            return self._of_servo("does not answer" if np.isfinite(position[joint]) else "returns no position", joint)
        if len(outside):
            joint = int(outside[0])
            return self._of_servo(
                f"stands at {position[joint]:.2f} rad, more than {margin:g} rad outside "
                f"[{robot.lower[joint]:.2f}, {robot.upper[joint]:.2f}]: move it by hand",
                joint,
            )
        if imu is not None and imu.required and not has_imu:
            return "the robot file requires an IMU and none answers"
        return self.problem(measured) or self.lying_imu()

    def lying_imu(self) -> str | None:
        """Why a robot must not stand up with the IMU that it has, also with one that it does not require.

        A sensor that lies is worse than none: a robot without an IMU is known to run open loop, and one that is
        believed again at any time tilts the robot.
        """
        if not self._imu_lies:
            return None
        return "the IMU measures what cannot be: replace it, or run open loop without `imu` in the robot file"

    @property
    def _imu_lies(self) -> bool:
        return bool(self.plausibility.imu_suspicion.level[0] > self.robot.safety.max_stale_reads)

    def watch_imu(self, has_imu: bool) -> None:
        """Tell when there is no IMU, or none that can be believed, and when there is one again. Call it once a tick."""
        if not has_imu:
            self._sees = 0
            if not self._blind:
                self._blind = True
                what = "the IMU measures what cannot be" if self._imu_lies else "no IMU"
                self._warn_of(f"{what}: the robot runs open loop, falls are not detected")
        elif self._blind:
            self._sees += 1
            if self._sees >= IMU_BACK_S * self.robot.rate_hz:
                self._blind = False
                self._note("the IMU measures again: balance and the detection of falls use it")

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
        """Why the supply ends the run: a servo measured it low for more reads in a row than it may be silent."""
        if not some(self._low_reads):
            return None
        worst = int(np.argmax(self._low_reads))
        if self._low_reads[worst] > self.robot.safety.max_stale_reads:
            return f"supply at {measured.voltage[worst]:.1f} V, below {self._least_supply[worst]:.1f} V"
        return None

    def _hardware_error(self, measured: RobotState) -> str | None:
        """Which servo reports an error. A supply outside its limits may last as long as a silence."""
        errors = measured.hardware_error
        if not some(errors):
            return None
        counted = self._supply_reads > self.robot.safety.max_stale_reads
        serious = np.flatnonzero(((errors & ~SUPPLY_ERROR) != 0) | counted)
        if not len(serious):
            return None
        worst = int(serious[0])
        return self._of_servo(f"reports hardware error 0x{int(errors[worst]):02x}", worst)

    def _wrong_sensor(self) -> str | None:
        """Which servo goes on measuring what cannot be."""
        for kind, suspicion in zip(KINDS, self.plausibility.suspicions, strict=True):
            if not suspicion.raised:
                continue
            worst = int(np.argmax(suspicion.level))
            if suspicion.level[worst] > self.robot.safety.max_stale_reads:
                return self._of_servo(f"measures a {kind} that cannot be{self.punctuality.remark}", worst)
        return None

    def _of_servo(self, what: str, joint: int) -> str:
        return f"servo of {self.robot.joint_names[joint]} (id {self.robot.joints[joint].id}) {what}"
