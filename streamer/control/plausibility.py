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
from flexmotion.drivers.masks import every, some
from flexmotion.streamer.control.believed import Believed, Suspicion
from flexmotion.streamer.control.imu_plausibility import ImuPlausibility
from flexmotion.streamer.control.servo_command import SUPPLY_MARGIN

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

KINDS = ("position", "speed", "voltage", "temperature")
"""What a servo reports and may be wrong, in the order of `Plausibility.suspicions`."""

OVERSPEED = 1.25
"""Greatest speed of a joint over the servo's no-load speed at the highest supply: the load may drive the servo. Walking
and falling robots in simulation reach 0.95 of the no-load speed."""
SPEED_SHARE, LAG_SHARE = 0.5, 0.1
"""Difference of a speed from the change of the position, over the no-load speed. From the first on one of them is
wrong, beyond the second (and the quantisation of the position) the speed is bounded. Robots in simulation reach 0.06,
servos that filter their speed more."""
STEADY_SHARE = 0.3
"""Change between two reads of the speed at which the positions move, over the no-load speed, up to which they are not
blamed for a difference to the speed that is read: a servo that filters its speed lags behind."""
MARGIN_TICKS = 12
"""Error of a position that is not a wrong reading: quantisation, play, the time stamp of the reading [servo units]."""
COLDEST, HOTTEST = -20.0, 50.0
"""Valid temperatures: from this [°C] to the servo's own limit plus this [K] (assumption)."""
TEMPERATURE_STEP = 4.0
"""Change between two readings that a heat capacity permits [K] (assumption)."""


class Plausibility:
    """Checks readings in place; allocates nothing that grows.

    Args:
        robot: gives the limits.
        turns: ticks within which the driver reads every joint once.

    Attributes:
        unread: ticks since each joint's position was last believed, (n,).
        doubted: joints whose reading was not believed this time, (n,) bool.
        expected: where joints were assumed to be whose position is known again, (n,) [rad]; NaN for the others.
        returned: whether there are such joints.
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
        self._middle = 0.5 * (self._lower + self._upper)
        self._lag, self._strange = LAG_SHARE * robot.no_load_speed, SPEED_SHARE * robot.no_load_speed
        self._steady = STEADY_SHARE * robot.no_load_speed
        self._in_turns = turns > 1
        self._position, self._velocity = np.full(n, np.nan), np.zeros(n)
        self._reported, self._moved = np.zeros(n), np.full(n, np.nan)  # speed as it was read, and that of the positions
        self._since = np.full(n, np.inf)  # time since a joint's last believed reading [s]
        self._believed = np.full(n, np.nan)  # the position then
        self._stamp_ns, self._tick = 0, -1
        self.unread = np.full(n, patience + 1, np.int64)
        self.doubted, self.expected = np.zeros(n, np.bool_), np.full(n, np.nan)
        self.suspicions = tuple(Suspicion(n, patience) for _ in KINDS)
        self.imu_suspicion = Suspicion(1, patience)
        self.returned = False
        self._held = np.zeros(n, np.bool_)  # joints whose torque is on
        self._calm = False  # all were believed the last time, none is wrong for good, and none is limp by itself
        self._none, self._all = np.zeros(n, np.bool_), np.ones(n, np.bool_)
        # Of each joint its step, the difference of its speeds, its speed, and its place in the middle of the range; and
        # what these may be at most, for an elapsed time.
        self._away, self._most = np.zeros((4, n)), np.zeros((4, n))
        self._most_for = (math.nan, math.nan, False)
        self._moving = np.zeros(n)  # speed of the positions this time
        self._never = np.zeros(n, np.bool_)  # joints that are not believed again before torque goes off
        least = np.array([servo.min_voltage for servo in servos])
        self._voltage = Believed(n, (1 - SUPPLY_MARGIN) * least, (1 + SUPPLY_MARGIN) * most)
        limits = np.array([servo.temperature_limit for servo in servos])
        self._temperature = Believed(
            n, np.full(n, COLDEST), limits + HOTTEST, step=TEMPERATURE_STEP, agreeing=patience + 1
        )
        self._imu = ImuPlausibility(robot, self.imu_suspicion)

    @property
    def disbelieved(self) -> int:
        """Readings that were not believed so far, of all sensors."""
        return sum(suspicion.total for suspicion in (*self.suspicions, self.imu_suspicion))

    @property
    def imu_restored(self) -> bool:
        """Whether the gyro is believed again with the last check: the torso of a robot that lies is at rest."""
        return self._imu.restored

    @property
    def imu_doubted(self) -> bool:
        """Whether something of the last sample of the IMU was not believed."""
        return self._imu.doubted

    def check(
        self,
        state: RobotState,
        speed: Float,
        tick: int,
        *,
        powered: bool,
        limp: Bool | None = None,
        moved_s: float | None = None,
        lies: bool = False,
    ) -> None:
        """Replace what cannot be believed in `state`, and count it in `stale` and `imu_stale`.

        Args:
            speed: speeds of the reference, (n,) [rad/s]: unread joints are assumed to move with them.
            tick: number of the tick; a loop that was late skips some.
            powered: whether torque is on; hands may move limp joints to wherever they go. What is held against other
                sensors stays, so that a robot with one that lies does not start.
            limp: joints without torque all the same, (n,); None: no joint.
            moved_s: for how long the reference has moved since the last check [s]; None: all of the time.
            lies: the robot lies or gets up: its balance does not depend on the gyro.
        """
        if not powered:
            self._never.fill(False)
            for suspicion in self.suspicions[:2]:
                suspicion.reset()
        # By the readings' own stamps, if they have any; a stall of the loop may be longer.
        stamped = (state.stamp_ns - self._stamp_ns) * 1e-9
        ticked = (tick - self._tick) / self.robot.rate_hz
        self._tick, self._stamp_ns = tick, state.stamp_ns
        self._held.fill(powered)
        if limp is not None and some(limp):
            self._held &= ~limp
            self._calm = False
            for suspicion in self.suspicions[:2]:
                suspicion.level[limp] = 0.0
        elapsed, between = max(stamped, ticked), stamped if stamped > 0 else ticked
        self._check_joints(state, speed, elapsed, between, powered, elapsed if moved_s is None else moved_s)
        voltage, temperature = self.suspicions[2:]
        asked = self._all if self._calm else state.stale == 0
        voltage.note(self._voltage.take(state.voltage), asked)
        temperature.note(self._temperature.take(state.temperature), asked)
        self._imu.check(state, elapsed, powered=powered, lies=lies)

    def _check_joints(
        self, state: RobotState, speed: Float, elapsed: float, between: float, powered: bool, moved_s: float
    ) -> None:
        """`elapsed`, `between`: time since the last check, and between the readings [s]; `moved_s`: see `check`."""
        position, velocity, held = state.position, state.velocity, self._held
        calm = self._calm and between > 0 and not some(state.stale)
        if calm and self._as_expected(position, velocity, elapsed, between, powered):
            self._go_on(position, velocity)
            return
        came = np.isfinite(position) & np.isfinite(velocity)
        # The first reading of a bus may be that of its set-up, some cycles old: the joints are off and stay.
        first = np.isnan(self._position) & (state.stale <= self.robot.safety.max_stale_reads)
        fresh = came & ((state.stale == 0) | first)
        expected = self._position + np.where(held, speed * moved_s, 0.0)
        self._since += elapsed
        with np.errstate(invalid="ignore"):
            jumped = np.abs(position - self._position) > self._fastest * self._since + self._margin
            racing = np.abs(velocity) > self._fastest
            jumped |= held & ((position < self._lower) | (position > self._upper) | self._never)
        unseen = racing.copy()
        if not self._in_turns and between > 0:
            known = fresh & (self.unread == 0) & ~jumped
            unseen &= ~known
            self._compare(position, velocity, between, known, jumped, racing)
            self._compare_after_gap(position, velocity, fresh & (self.unread > 0) & ~jumped, racing)
        jumped &= fresh
        racing &= fresh & ~jumped
        np.logical_or(jumped, unseen & fresh, out=self.doubted)
        for suspicion, wrong in zip(self.suspicions, (jumped, racing), strict=False):
            suspicion.note(wrong, fresh)
        # A speed that lies takes no position with it.
        self._never |= held & (self.suspicions[0].level > self.robot.safety.max_stale_reads)
        believed = fresh & ~self.doubted
        # Before the first reading there is nothing to expect: what came is kept.
        assumed = ~believed & ~(np.isnan(expected) & came)
        np.copyto(position, expected, where=assumed)
        np.copyto(velocity, np.where(held, speed, 0.0), where=assumed)
        back = believed & (self.unread > 0)
        np.copyto(self.expected, np.where(back, expected, np.nan))
        self.returned = some(back)
        self.unread += 1
        self.unread[believed] = 0
        self._since[believed] = 0.0
        np.copyto(self._believed, position, where=believed)
        np.copyto(state.stale, np.maximum(state.stale, self.unread), where=~came | self.doubted)
        np.copyto(self._position, position)
        np.copyto(self._velocity, velocity)
        self._calm = every(believed) and not self._in_turns and not some(self._never)

    def _as_expected(self, position: Float, velocity: Float, elapsed: float, between: float, powered: bool) -> bool:
        """Whether `_check_joints` would believe all positions and speeds as they are, as in nearly every tick.

        The same limits as there, for joints of which all were believed the last time.
        """
        away, most = self._away, self._most
        if (elapsed, between, powered) != self._most_for:
            self._most_for = elapsed, between, powered
            most[0] = self._fastest * elapsed + self._margin
            most[1] = self._lag + self.robot.tick_rad / between
            most[2] = self._fastest
            most[3] = 0.5 * (self._upper - self._lower) if powered else math.inf
        np.subtract(position, self._position, out=away[0])
        np.divide(away[0], between, out=self._moving)
        np.subtract(self._moving, velocity, out=away[1])
        away[2] = velocity
        np.subtract(position, self._middle, out=away[3])
        np.abs(away, out=away)
        return every(away <= most)

    def _go_on(self, position: Float, velocity: Float) -> None:
        """Believe positions and speeds of all joints, of which all were believed the last time."""
        for suspicion in self.suspicions[:2]:
            suspicion.note(self._none, self._all)
        if self.returned:
            self.expected.fill(np.nan)
            self.returned = False
        np.copyto(self._position, position)
        np.copyto(self._believed, position)
        np.copyto(self._velocity, velocity)
        np.copyto(self._reported, velocity)
        self._moved, self._moving = self._moving, self._moved

    def _compare(
        self, position: Float, velocity: Float, between: float, known: Bool, jumped: Bool, racing: Bool
    ) -> None:
        """Compare speeds with the change of the positions in `between` [s], of the joints in `known`.

        Of two that disagree, the one nearer to the last speed is believed, and positions that move on at much the same
        speed: a wrong speed is replaced, a wrong position is marked in `jumped`. `racing` marks speeds that are clearly
        wrong and not on their way to the right one, as filtered speeds are.
        """
        moved = (position - self._position) / between
        quantum = self.robot.tick_rad / between
        slack = self._lag + quantum
        with np.errstate(invalid="ignore"):
            away = np.abs(velocity - moved)
            if (known & (away > slack)).any():
                steady = np.abs(moved - self._moved) < self._steady + quantum
                speed_lies = steady | (np.abs(velocity - self._velocity) > np.abs(moved - self._velocity))
                strange = known & (away > self._strange + quantum)
                coming = (velocity - self._reported) * (moved - self._reported) > 0.0
                racing |= strange & speed_lies & ~coming
                jumped |= strange & ~speed_lies
                bounded = np.clip(velocity, moved - slack, moved + slack)
                np.copyto(self._reported, velocity)
                np.copyto(velocity, bounded, where=known & speed_lies)
            else:
                np.copyto(self._reported, velocity)
        np.copyto(self._moved, np.where(known & ~jumped, moved, np.nan))

    def _compare_after_gap(self, position: Float, velocity: Float, back: Bool, racing: Bool) -> None:
        """Bound the speeds of joints in `back`, which were not read for a few ticks, by what they moved meanwhile.

        The speed at the end may be further from the mean one the longer the gap was.
        """
        if not some(back):
            return
        with np.errstate(invalid="ignore"):
            mean = (position - self._believed) / self._since
            slack = (self._lag + self.robot.tick_rad / self._since) * (1 + self.unread)
            judged = back & (self.unread <= self.robot.safety.max_stale_reads) & np.isfinite(mean)
            racing |= judged & (np.abs(velocity - mean) > self._strange + slack)
            np.copyto(velocity, np.clip(velocity, mean - slack, mean + slack), where=judged)
