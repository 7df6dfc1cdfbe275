"""`JointModel`: one joint with the servo plant, simulated for several candidates at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Servo
from flexmotion.drivers.identification.limb import Limb, LimbLoad
from flexmotion.drivers.identification.record import RobotRecord
from flexmotion.drivers.plant import ServoPlant

Float = NDArray[np.float64]

FIGURES = ("kp", "back_emf", "frictionloss", "damping", "armature", "delay")
"""Columns of a candidate. `kp` is the stiffness of the joint, at its own gain [N·m/rad]."""

TIMESTEP = 0.002
"""Longest step of the integration [s]; position and speed are half a step apart, so its error is of second order."""

BURN_IN_S = 0.5
"""Start of a stretch that is simulated and not compared: the speed at its beginning is known badly [s]."""

KEPT = 8
"""Results that are kept: fits with other weights, and of another sampling of torque, begin where one before ended."""

_SUPPLY_WINDOW_S, _SUPPLY_STEP = 0.3, 0.02
"""Mean and resolution of the measured supply, which has a resolution of 0.1 V [s, V]."""


@dataclass
class Candidates:
    """A servo m times: `flexmotion.drivers.plant.ServoFigures`, (m,) arrays."""

    n: int
    servos: tuple[Servo, ...]
    kp: Float
    back_emf: Float
    stall_torque: Float
    usable_torque: Float
    nominal_voltage: Float


@dataclass(frozen=True)
class Stretch:
    """One joint over ticks without a gap; arrays are (N,), as in `RobotRecord`.

    Attributes:
        compared: ticks that are compared with a simulation.
        load: of the limb.
        bus_s: see `RobotRecord`.
    """

    time: Float
    goal_time: Float
    goal: Float
    position: Float
    effort: Float
    voltage: Float
    compared: NDArray[np.bool_]
    load: LimbLoad
    bus_s: float


@dataclass(frozen=True)
class Simulated:
    """What m candidates do, (N, m) each.

    Attributes:
        angle: when it is measured [rad].
        torque: mean over a tick, when torque is measured [N·m].
        slope: its change with time by the goals alone [N·m/s]. Torque jumps with each goal and falls until the next;
            a current that is filtered follows the mean, early or late by an unknown part of a tick.
        late_angle, late_speed: when torque is measured [rad, rad/s].
        supply: over the nominal one, (N,).
    """

    angle: Float
    torque: Float
    slope: Float
    late_angle: Float
    late_speed: Float
    supply: Float


class JointModel:
    """Simulates a joint under the goals of a record.

    Attributes:
        servo: of the joint.
        stretches: of the record.
    """

    def __init__(self, robot: Robot, joint: int, stretches: Sequence[Stretch]) -> None:
        self.servo, self.stretches = robot.servos[joint], tuple(stretches)
        self._usable, self._period = robot.usable_torque[joint], 1.0 / robot.rate_hz
        self._kept: dict[tuple[bytes, bytes], Simulated] = {}

    def simulate(self, figures: Float, age: Float | None = None) -> Simulated:
        """The joint at the ticks of all stretches.

        Args:
            figures: (m, 6) in the order of `FIGURES`.
            age: of a measured torque when the angle is measured, (m,) [s]; 0 if not given.
        """
        figures = np.atleast_2d(figures)
        age = np.zeros(len(figures)) if age is None else age
        key = figures.tobytes(), age.tobytes()
        found = self._kept.pop(key, None)
        if found is None:
            parts = [self._simulate(stretch, figures, age) for stretch in self.stretches]
            found = Simulated(*(np.concatenate(each) for each in zip(*parts, strict=True)))
        self._kept[key] = found
        if len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]
        return found

    def _simulate(self, stretch: Stretch, figures: Float, age: Float) -> tuple[Float, ...]:
        kp, back_emf, friction, damping, armature, delay = (np.ascontiguousarray(row) for row in figures.T)
        m, start, end = len(figures), stretch.time[0], stretch.time[-1]
        inertia = armature + stretch.load.inertia.min()
        quickest = float(np.sqrt(kp / np.maximum(inertia, 1e-9)).max())
        steps = int(np.ceil((end - start) / min(TIMESTEP, 0.2 / quickest)))
        dt = (end - start) / steps
        grid = start + dt * np.arange(steps + 1)
        goals = _mean_goals(stretch, grid, delay + stretch.bus_s)
        known = np.isfinite(stretch.voltage)
        voltage = _steady(stretch, known, self.servo.nominal_voltage)
        voltage = np.interp(grid, stretch.time, voltage)
        voltage = np.round(voltage / _SUPPLY_STEP) * _SUPPLY_STEP
        load = np.interp(grid, stretch.time, stretch.load.load)
        limb = np.interp(grid, stretch.time, stretch.load.inertia)

        servo = self.servo
        plant = ServoPlant(
            Candidates(
                n=m,
                servos=(servo,) * m,
                kp=kp,
                back_emf=back_emf,
                stall_torque=np.full(m, servo.stall_torque),
                usable_torque=np.full(m, self._usable),
                nominal_voltage=np.full(m, servo.nominal_voltage),
            )
        )
        q, v = np.full(m, _first(stretch)), np.full(m, _first_speed(stretch))
        before, scratch = v.copy(), np.empty(m)
        angles, speeds, torques = (np.empty((steps + 1, m)) for _ in range(3))
        per_step = dt / (armature + limb[:, None])
        stop = friction * per_step
        # In place and on plain numbers: these lines are most of the time of an identification.
        for goal, volts, weight, angle, speed, torque, share, least in zip(
            goals, voltage.tolist(), load.tolist(), angles, speeds, torques, per_step, stop, strict=True
        ):
            if volts != plant.supply:
                plant.set_supply(volts)
            plant.goal = goal
            # The speed is known half a step before the angle: extrapolated to the same time.
            np.multiply(v, 1.5, out=speed)
            before *= 0.5
            speed -= before
            angle[:], torque[:] = q, plant.driven(q, speed)
            np.multiply(damping, speed, out=scratch)
            np.subtract(torque, scratch, out=scratch)
            scratch -= weight
            scratch *= share
            np.add(v, scratch, out=before)
            before, v = v, before
            # Dry friction stops a motion and never reverses it.
            np.abs(v, out=scratch)
            scratch -= least
            np.maximum(scratch, 0.0, out=scratch)
            np.copysign(scratch, v, out=v)
            np.multiply(v, dt, out=scratch)
            q += scratch
        width = max(round(self._period / dt), 1)
        supply = voltage[:, None] / servo.nominal_voltage
        slope = kp * supply * np.gradient(uniform_filter1d(goals, width, axis=0), dt, axis=0)
        torques = uniform_filter1d(torques, width, axis=0)
        none = np.zeros(m)
        return (
            _sampled(angles, stretch.time, none, grid),
            _sampled(torques, stretch.time, age, grid),
            _sampled(slope, stretch.time, none, grid),
            _sampled(angles, stretch.time, age, grid),
            _sampled(speeds, stretch.time, age, grid),
            np.interp(stretch.time, grid, supply[:, 0]),
        )


def stretches_of(robot: Robot, joint: int, record: RobotRecord) -> list[Stretch]:
    """The stretches of a record, for one joint, with the load of its limb."""
    limb, found = Limb(robot, joint), []
    goals = _quantised(robot, record.goal)
    for rows in record.stretches(1.0 / robot.rate_hz):
        part = record.part(rows)
        good = part.believed(joint)
        if not good.any():
            continue
        first = int(np.argmax(good))
        part, good = part.part(slice(first, len(part))), good[first:]
        found.append(
            Stretch(
                time=part.time,
                goal_time=part.goal_time,
                goal=goals[rows][first:, joint],
                position=part.position[:, joint],
                effort=part.effort[:, joint],
                voltage=part.voltage[:, joint],
                compared=good & (part.time > part.time[0] + BURN_IN_S),
                load=limb.along(part),
                bus_s=record.bus_s,
            )
        )
    return found


def _quantised(robot: Robot, goals: Float) -> Float:
    return np.array([robot.from_ticks(robot.to_ticks(row)) for row in goals]).reshape(goals.shape)


def _mean_goals(stretch: Stretch, grid: Float, delay: Float) -> Float:
    """Mean goal in effect over the step from each grid time on, (T, m): goals hold until the next one arrives.

    The integral of the goals over time is linear between their changes, so that it can be interpolated.
    """
    times, goal = stretch.goal_time, stretch.goal
    integral = np.concatenate([[0.0], np.cumsum(np.diff(times) * goal[:-1])])
    dt = grid[1] - grid[0]
    means = np.empty((len(grid), len(delay)))
    for column, late in enumerate(delay):
        # Half a step earlier and later: centred at the time of the angle.
        edges = np.concatenate([grid - 0.5 * dt, grid[-1:] + 0.5 * dt]) - late
        inside = np.interp(edges, times, integral)
        inside += goal[0] * np.minimum(edges - times[0], 0.0) + goal[-1] * np.maximum(edges - times[-1], 0.0)
        means[:, column] = np.diff(inside) / dt
    return means


def _steady(stretch: Stretch, known: NDArray[np.bool_], nominal: float) -> Float:
    if not known.any():
        return np.full(len(stretch.time), nominal)
    voltage = np.interp(stretch.time, stretch.time[known], stretch.voltage[known])
    period = (stretch.time[-1] - stretch.time[0]) / max(len(stretch.time) - 1, 1)
    return np.asarray(uniform_filter1d(voltage, max(round(_SUPPLY_WINDOW_S / period), 1)))


def _first(stretch: Stretch) -> float:
    return float(stretch.position[0])


def _first_speed(stretch: Stretch) -> float:
    """Slope of the first angles [rad/s]."""
    early = np.isfinite(stretch.position) & (stretch.time < stretch.time[0] + 0.05)
    if np.count_nonzero(early) < 3:
        return 0.0
    return float(np.polyfit(stretch.time[early] - stretch.time[0], stretch.position[early], 1)[0])


def _sampled(values: Float, times: Float, age: Float, grid: Float) -> Float:
    """Values on the grid at `times` minus the `age` of each column, linear between grid times, (N, m)."""
    columns = [np.interp(times - late, grid, column) for late, column in zip(age, values.T, strict=True)]
    return np.column_stack(columns)
