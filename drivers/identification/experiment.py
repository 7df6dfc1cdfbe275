"""`Experiment`: moves one joint of a robot on a stand and records it; every other joint holds.

Torque is off before and after, however it ends. A joint that does not behave as planned ends it at once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.identification.excitation import Excitation, way_s
from flexmotion.drivers.identification.record import RobotRecord, new_angles
from flexmotion.drivers.interface import Driver, JointCommand, RobotState

Float = NDArray[np.float64]

_PINNED_S = 0.5
"""Time for which the joints hold before the motion [s]."""
_SPEED_SLACK, _RANGE_SLACK_RAD, _TORQUE_SHARE = 1.6, 0.12, 0.9
"""Bounds of the motion: speed over the planned one, distance outside the planned range, and the torque that goal and
angle imply over the usable torque."""
_PATIENCE = 6
"""Consecutive ticks outside the bounds that end the motion: one false reading does not."""
_MOVED_RAD = 0.2
"""How far a joint may be from the pose for which the motion was planned [rad]: a limp robot sags further."""
_LEAST_SHARE = 0.5
"""Share of the planned range that the joint must have moved."""


class Experiment:
    """One joint, one motion. The driver is open, and its torque is off.

    Args:
        driver: of the robot.
        bus_s: see `RobotRecord`.
        clock: time on which the driver stamps its measurements [s].
        sleep: lets seconds pass on that clock.
        stopped: whether the operator wants it to end, asked in every tick.
    """

    def __init__(
        self,
        driver: Driver,
        *,
        bus_s: float,
        clock: Callable[[], float] | None = None,
        sleep: Callable[[float], None] | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.driver, self.robot = driver, driver.robot
        self._bus_s = bus_s
        self._clock = time.perf_counter if clock is None else clock
        self._sleep = time.sleep if sleep is None else sleep
        self._stopped = stopped
        self._state, self._command = RobotState(self.robot.n), JointCommand(self.robot.n)
        self._rows: list[tuple[float, float, Float, Float, Float, Float, NDArray[np.bool_], Float, Float]] = []
        self._next = 0.0
        self._strange = self._heavy = 0

    def run(self, planned: Excitation) -> RobotRecord:
        """Torque on, to the centre, the motion, back, torque off.

        Raises:
            DriverError: a servo does not answer or reports an error, or the joint is blocked, too heavy or too fast;
                torque is off then.
            KeyboardInterrupt: the operator ended it; torque is off then.
        """
        self._rows, self._strange, self._heavy = [], 0, 0
        self._next = self._clock()
        try:
            begin, end = self._move(planned)
        except BaseException as error:
            off = self._switch_off()
            if isinstance(error, DriverError) or off is not None:
                what = "interrupted" if isinstance(error, KeyboardInterrupt) else str(error)
                raise DriverError(f"{what}; nothing was stored, {off or 'torque is off'}") from error
            raise
        off = self._switch_off()
        if off is not None:
            raise DriverError(off)
        return self._record(planned, begin, end)

    # ---------------------------------------------------------------- inside

    def _move(self, planned: Excitation) -> tuple[int, int]:
        """The motion; first row of the record, and the one after its last."""
        robot, joint = self.robot, planned.joint
        self._wait_for_angles()
        self._refuse_moved(planned)
        self.driver.set_torque(True)
        held = self._state.position.copy()
        self.driver.take_pins(held)
        np.copyto(self._command.position, held)
        first = float(held[joint])
        self._play(planned, np.full(round(_PINNED_S * robot.rate_hz), first))
        self._play(planned, _way(robot, first, planned.centre, planned.approach))
        begin = len(self._rows)
        self._play(planned, planned.goals)
        end = len(self._rows)
        self._refuse_unmoved(planned, begin, end)
        # Outside its limits a goal may only move inwards.
        back = float(np.clip(first, robot.lower[joint], robot.upper[joint]))
        self._play(planned, _way(robot, planned.centre, back, planned.approach))
        return begin, end

    def _switch_off(self) -> str | None:
        """Switch torque off; what to do if servos do not confirm it."""
        self.driver.set_torque(False)
        holding = ", ".join(self.driver.holding)
        return f"torque off is not confirmed by: {holding}: switch the power off" if holding else None

    def _wait_for_angles(self) -> None:
        """Read until every joint has answered. Raises `DriverError` if one does not."""
        for _ in range(self.robot.safety.max_stale_reads * self.driver.turns + 1):
            self.driver.read(self._state)
            self._pace()
            if not self._state.stale.any() and np.isfinite(self._state.position).all():
                return
        raise self._of(int(np.argmax(self._state.stale)), "does not answer")

    def _refuse_moved(self, planned: Excitation) -> None:
        """Raise `DriverError` if the robot is in another pose than the motion was planned and announced for."""
        away = np.abs(self._state.position - planned.pose)
        if away.max() > _MOVED_RAD:
            index = int(np.argmax(away))
            what = f"has been moved to {self._state.position[index]:.2f} rad since the motion was planned"
            raise self._of(index, what)

    def _pace(self) -> None:
        """Wait for the end of the tick."""
        self._next += 1.0 / self.robot.rate_hz
        now = self._clock()
        if now < self._next:
            self._sleep(self._next - now)
        else:
            self._next = now  # a late tick is not made up for: the record has its times

    def _play(self, planned: Excitation, goals: Float) -> None:
        """Send goals of the joint, one a tick."""
        state, command, joint = self._state, self._command, planned.joint
        for goal in goals.tolist():
            if self._stopped():
                raise KeyboardInterrupt
            self.driver.read(state)
            self._check(planned, float(command.position[joint]))
            command.position[joint] = goal
            sent = self._clock()
            self.driver.write(command)
            imu = state.imu_stale == 0
            nothing = np.full(3, np.nan)
            self._rows.append(
                (
                    state.stamp_ns * 1e-9,
                    sent,
                    command.position.copy(),
                    state.position.copy(),
                    state.effort.copy(),
                    state.voltage.copy(),
                    state.stale == 0,
                    state.accel.copy() if imu else nothing,
                    state.gyro.copy() if imu else nothing,
                )
            )
            self._pace()

    def _check(self, planned: Excitation, goal: float) -> None:
        """Raise `DriverError` where the robot is not as planned."""
        robot, state, joint = self.robot, self._state, planned.joint
        limits = robot.safety
        if not self.driver.connected:
            raise DriverError("the bus is lost")
        if state.stale.max() > limits.max_stale_reads:
            raise self._of(int(np.argmax(state.stale)), f"has not answered for {int(state.stale.max())} reads")
        if state.hardware_error.any():
            index = int(np.flatnonzero(state.hardware_error)[0])
            raise self._of(index, f"reports hardware error 0x{int(state.hardware_error[index]):02x}")
        hot = np.flatnonzero(state.temperature > self.driver.temperature_limit - limits.thermal_margin)
        if len(hot):
            raise self._of(int(hot[0]), f"has {state.temperature[hot[0]]:.0f} °C, close to its own limit")
        if limits.voltage_min is not None and state.voltage[joint] < limits.voltage_min:
            self._strange += 1
            if self._strange > _PATIENCE:
                raise self._of(
                    joint, f"has {state.voltage[joint]:.1f} V, the robot file wants {limits.voltage_min:g} V"
                )
            return
        if state.stale[joint]:
            return
        angle, speed = float(state.position[joint]), float(state.velocity[joint])
        outside = not planned.lowest - _RANGE_SLACK_RAD <= angle <= planned.highest + _RANGE_SLACK_RAD
        fast = abs(speed) > _SPEED_SLACK * max(planned.speed, planned.approach)
        self._strange = self._strange + 1 if outside or fast else 0
        if self._strange > _PATIENCE:
            what = f"turns at {speed:.2f} rad/s" if fast else f"stands at {angle:.2f} rad"
            raise self._of(
                joint,
                f"{what}; planned were {planned.speed:.2f} rad/s between {planned.lowest:.2f} and "
                f"{planned.highest:.2f} rad",
            )
        supply = state.voltage[joint] / robot.nominal_voltage[joint]
        supply = supply if math.isfinite(supply) else 1.0
        drag = 0.0 if not math.isfinite(speed) else robot.back_emf[joint] * speed
        torque = abs(robot.kp[joint] * supply * (goal - angle) - drag)
        self._heavy = self._heavy + 1 if torque > _TORQUE_SHARE * robot.usable_torque[joint] else 0
        if self._heavy > _PATIENCE:
            raise self._of(
                joint,
                f"is {abs(goal - angle):.2f} rad from its goal at {angle:.2f} rad, which takes {torque:.1f} N·m; "
                f"planned were {planned.torque:.1f} N·m: it is blocked, at a stop, or its limb is heavier than in the "
                "robot file",
            )

    def _refuse_unmoved(self, planned: Excitation, begin: int, end: int) -> None:
        """Raise `DriverError` if the joint has not moved as far as planned."""
        rows = self._rows[begin:end]
        seen = np.array([row[3][planned.joint] for row in rows if row[6][planned.joint]])
        if not len(seen):
            raise self._of(planned.joint, "has not been measured during the motion")
        lowest, highest = np.quantile(seen, [0.01, 0.99])
        if highest - lowest < _LEAST_SHARE * 2 * planned.amplitude:
            raise self._of(
                planned.joint,
                f"moved {highest - lowest:.2f} rad of {2 * planned.amplitude:.2f}: it is blocked or at a stop, or its "
                "torque is limited",
            )

    def _record(self, planned: Excitation, begin: int, end: int) -> RobotRecord:
        columns = [np.array(column) for column in zip(*self._rows[begin:end], strict=True)]
        sent, goal, position, effort, voltage, fresh, accel, gyro = columns[1:]
        fresh = new_angles(position, fresh, self.driver.turns)
        motion = f"{planned.amplitude:.2f} rad around {planned.centre:.2f} rad on a stand"
        return RobotRecord(
            columns[0], sent, goal, position, effort, voltage, fresh, accel, gyro, bus_s=self._bus_s, motion=motion
        )

    def _of(self, joint: int, what: str) -> DriverError:
        config = self.robot.joints[joint]
        return DriverError(f"servo of {config.name} (id {config.id}): {what}")


def _way(robot: Robot, start: float, end: float, speed: float) -> Float:
    """Goals from one angle to another with a cosine profile."""
    count = max(math.ceil(way_s(end - start, speed) * robot.rate_hz), 1)
    share = 0.5 - 0.5 * np.cos(math.pi * np.arange(1, count + 1) / count)
    return start + (end - start) * share
