"""`Plausibility`: readings that cannot be are not believed.

A joint moves no faster than its servo without load, and no further than its stops. A reading beyond is treated as one
that did not come: the joint is stale, and is assumed to move as planned. Supply, temperature and the IMU keep the value
before. Every such reading is counted; a sensor that goes on is a fault (`flexmotion.streamer.control.hardware_audit`).
All limits follow from the robot file and the servo catalogue.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.believed import Believed, Suspicion
from flexmotion.streamer.control.servo_command import SUPPLY_MARGIN

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

KINDS = ("position", "speed", "voltage", "temperature")
"""What a servo reports and may be wrong, in the order of `Plausibility.suspicions`."""

OVERSPEED = 1.25
"""Greatest speed of a joint over the servo's no-load speed at the highest supply: the load may drive the servo. Walking
and falling robots in simulation reach 0.95 of the no-load speed."""
MARGIN_TICKS = 12
"""Error of a position that is not a wrong reading: quantisation, play, the time stamp of the reading [servo units]."""
COLDEST, HOTTEST = -20.0, 50.0
"""Valid temperatures: from this [°C] to the servo's own limit plus this [K] (assumption)."""
TEMPERATURE_STEP = 4.0
"""Change between two readings that a heat capacity permits [K] (assumption)."""
FALL_STEPS = 4.0
"""Change of the angular velocity in a tick, over that of a falling robot, g / h: pushes and steps stay below. A larger
one (an impact) is believed once it is seen twice."""
MOST_ACCEL, ACCEL_STEP = 17.0 * GRAVITY, 5.0 * GRAVITY
"""Greatest specific force, above the range of the usual sensors, and the greatest change that is believed at once
[m/s²]. The foot of a walking robot strikes with up to 4 g."""


class Plausibility:
    """Checks readings in place; allocates nothing that grows.

    Args:
        robot: gives the limits.
        turns: ticks within which the driver reads every joint once.

    Attributes:
        unread: ticks since each joint's position was last believed, (n,).
        doubted: joints whose reading was not believed this time, (n,) bool.
        expected: where joints were assumed to be whose position is known again, (n,) [rad]; NaN for the others.
        suspicions: of each of `KINDS`, per servo.
        imu_suspicion: of the IMU.
        disbelieved: readings that were not believed so far, of all sensors.
    """

    def __init__(self, robot: Robot, turns: int = 1) -> None:
        self.robot = robot
        n, servos, patience = robot.n, robot.servos, robot.safety.max_stale_reads
        most = np.array([servo.max_voltage for servo in servos])
        self._fastest = OVERSPEED * robot.no_load_speed * most / robot.nominal_voltage
        self._margin = MARGIN_TICKS * robot.tick_rad + self._fastest * (turns - 1) / robot.rate_hz
        # Outside its limits a joint rests on its stops, or the load bends it out by what the servo can hold.
        beyond = robot.safety.standing_margin + robot.usable_torque / robot.kp + self._margin
        self._lower, self._upper = robot.lower - beyond, robot.upper + beyond
        self._position = np.full(n, np.nan)
        self._since = np.full(n, np.inf)  # time since a joint's last believed reading [s]
        self._stamp_ns, self._tick = 0, -1
        self.unread = np.full(n, patience + 1, np.int64)
        self.doubted, self.expected = np.zeros(n, np.bool_), np.full(n, np.nan)
        self.suspicions = tuple(Suspicion(n) for _ in KINDS)
        self.imu_suspicion = Suspicion(1)
        self._never = np.zeros(n, np.bool_)  # joints that are not believed again before torque goes off
        least = np.array([servo.min_voltage for servo in servos])
        self._voltage = Believed(n, (1 - SUPPLY_MARGIN) * least, (1 + SUPPLY_MARGIN) * most)
        limits = np.array([servo.temperature_limit for servo in servos])
        self._temperature = Believed(
            n, np.full(n, COLDEST), limits + HOTTEST, step=TEMPERATURE_STEP, agreeing=patience + 1
        )
        # A robot that topples turns with sqrt(3 g / h) where it hits the ground; its joints may add their speed.
        height = robot.gait.stand_hip_height
        turn = 2.0 * (math.sqrt(3 * GRAVITY / height) + float(robot.no_load_speed.max()))
        turn_step = FALL_STEPS * GRAVITY / height / robot.rate_hz
        self._gyro = Believed(3, np.full(3, -turn), np.full(3, turn), step=turn_step)
        self._accel = Believed(3, np.full(3, -MOST_ACCEL), np.full(3, MOST_ACCEL), step=ACCEL_STEP)
        self._imu_unread = 0

    @property
    def disbelieved(self) -> int:
        """Readings that were not believed so far, of all sensors."""
        return sum(suspicion.total for suspicion in (*self.suspicions, self.imu_suspicion))

    def check(self, state: RobotState, speed: Float, tick: int, *, powered: bool) -> None:
        """Replace what cannot be believed in `state`, and count it in `stale` and `imu_stale`.

        Args:
            speed: speeds of the reference, (n,) [rad/s]: unread joints are assumed to move with them.
            tick: number of the tick; a loop that was late skips some.
            powered: whether torque is on; hands may move limp joints to wherever they go.
        """
        if not powered:
            self._never.fill(False)
            for suspicion in (*self.suspicions, self.imu_suspicion):
                suspicion.reset()
        self._check_joints(state, speed, self._elapsed(state, tick), powered)
        voltage, temperature = self.suspicions[2:]
        asked = state.stale == 0
        voltage.note(self._voltage.take(state.voltage), asked)
        temperature.note(self._temperature.take(state.temperature), asked)
        self._check_imu(state)

    def _elapsed(self, state: RobotState, tick: int) -> float:
        """Time since the reading before [s]: by the loop's ticks, or longer by the readings' stamps."""
        passed = max((tick - self._tick) / self.robot.rate_hz, (state.stamp_ns - self._stamp_ns) * 1e-9)
        self._tick, self._stamp_ns = tick, state.stamp_ns
        return passed

    def _check_joints(self, state: RobotState, speed: Float, elapsed: float, powered: bool) -> None:
        position, velocity = state.position, state.velocity
        came = np.isfinite(position) & np.isfinite(velocity)
        fresh = came & (state.stale == 0)
        expected = self._position + (speed * elapsed if powered else 0.0)
        self._since += elapsed
        with np.errstate(invalid="ignore"):
            jumped = np.abs(position - self._position) > self._fastest * self._since + self._margin
            racing = np.abs(velocity) > self._fastest
            if powered:
                jumped |= (position < self._lower) | (position > self._upper) | self._never
        jumped &= fresh
        racing &= fresh & ~jumped
        np.logical_or(jumped, racing, out=self.doubted)
        for suspicion, wrong in zip(self.suspicions, (jumped, racing), strict=False):
            suspicion.note(wrong, fresh)
            if powered:
                self._never |= suspicion.level > self.robot.safety.max_stale_reads
        believed = fresh & ~self.doubted
        # Before the first reading there is nothing to expect: what came is kept.
        assumed = ~believed & ~(np.isnan(expected) & came)
        np.copyto(position, expected, where=assumed)
        np.copyto(velocity, speed if powered else 0.0, where=assumed)
        np.copyto(self.expected, np.where(believed & (self.unread > 0), expected, np.nan))
        self.unread += 1
        self.unread[believed] = 0
        self._since[believed] = 0.0
        np.copyto(state.stale, np.maximum(state.stale, self.unread), where=~came | self.doubted)
        np.copyto(self._position, position)

    def _check_imu(self, state: RobotState) -> None:
        if not (np.isfinite(state.gyro).all() and np.isfinite(state.accel).all()):
            state.gyro.fill(0.0)
            if state.imu_stale >= 0:
                self._imu_unread += 1
                state.imu_stale = max(state.imu_stale, self._imu_unread)
            return
        self._imu_unread = 0
        if state.imu_stale != 0:
            return
        wrong = bool(self._gyro.take(state.gyro).any()) | bool(self._accel.take(state.accel).any())
        self.imu_suspicion.note(np.array([wrong]), np.ones(1, np.bool_))
        level = int(self.imu_suspicion.level[0])
        if wrong and level > self.robot.safety.max_stale_reads:
            state.imu_stale = level
