"""`Excitation`: the goals of a short motion of one joint that shows every figure of its servo.

Slow sweeps to both ends and back show the stiffness (angle against the limb's weight and the current) and dry friction
(both directions). An oscillation of rising frequency and constant greatest speed, past the servo's own frequency, shows
back-EMF and viscous friction (speed), armature (acceleration) and delay (phase).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.identification.limb import Limb, LimbLoad
from flexmotion.drivers.identification.model import FIGURES, JointModel, Stretch
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

LARGEST_AMPLITUDE, LEAST_AMPLITUDE = 0.4, 0.12
"""Amplitude of the motion unless asked for another, and the least one with which a fit makes sense [rad]."""

TIP_SPEED = 0.25
"""Greatest speed of any point of the moved limb [m/s]: reduced speed control of ISO 10218-1:2011, 5.6.2, the speed at
which people may be near an industrial robot."""
NO_LOAD_SHARE = 0.4
"""Greatest speed of the joint over the servo's no-load speed."""
TORQUE_SHARE = 0.6
"""Greatest torque of the motion over the servo's usable torque, by the robot's model."""

_SLOW_SHARE, _REST_S, _OSCILLATION_S, _SPAN, _MARGIN_RAD = 0.25, 0.4, 7.0, 1.6, 0.03
"""Speed of the sweeps over the greatest; rest at the beginning; duration of the oscillation; its last frequency over
the servo's own; distance that is kept from the ends of the range."""


@dataclass(frozen=True)
class Excitation:
    """Planned motion of one joint, and what the robot's model predicts of it.

    Attributes:
        joint: index.
        pose: of all joints when it was planned, (n,) [rad]; the joint returns there.
        goals: of every tick, (T, ) [rad]; they begin and end at the centre.
        centre, amplitude: [rad].
        approach: greatest speed on the way to the centre and back [rad/s].
        lowest, highest: predicted angles [rad].
        speed, torque: greatest predicted speed [rad/s] and torque [N·m].
        reach: distance of the limb's farthest point from the axis [m].
        weight: greatest torque of the limb's weight [N·m].
    """

    joint: int
    pose: Float
    goals: Float
    centre: float
    amplitude: float
    approach: float
    lowest: float
    highest: float
    speed: float
    torque: float
    reach: float
    weight: float

    @property
    def start(self) -> float:
        """Angle from which the joint comes [rad]."""
        return float(self.pose[self.joint])

    def seconds(self, robot: Robot) -> float:
        """Duration with the way there and back [s]."""
        return len(self.goals) / robot.rate_hz + 2 * way_s(self.centre - self.start, self.approach)


def way_s(distance: float, speed: float) -> float:
    """Duration of a way with a cosine profile whose greatest speed is `speed` [s]."""
    return 0.5 * math.pi * abs(distance) / speed


def plan(
    robot: Robot, joint: int, pose: Float, *, amplitude: float | None = None, up: Float | None = None
) -> Excitation:
    """The motion of a joint from a pose.

    Args:
        pose: present angles of all joints, (n,) [rad].
        amplitude: greatest distance from the centre [rad]; as much as there is room for, if not given.
        up: specific force in the torso frame, (3,) [m/s²]; upright if not given.

    Raises:
        DriverError: there is no room for the motion, or the limb is too heavy for it.
    """
    limb = Limb(robot, joint)
    config, servo = robot.joints[joint], robot.servos[joint]
    where = f"servo of {config.name} (id {config.id})"
    lowest, highest = limb.free_range(pose)
    lowest, highest = lowest + _MARGIN_RAD, highest - _MARGIN_RAD
    room = 0.5 * (highest - lowest)
    if room < LEAST_AMPLITUDE:
        raise DriverError(
            f"{where}: may move from {lowest:.2f} to {highest:.2f} rad in this pose, within its limits and clear of "
            f"the robot's other parts; it needs {2 * LEAST_AMPLITUDE:.2f} rad: bring the other joints out of its way"
        )
    if amplitude is not None and not LEAST_AMPLITUDE <= amplitude <= room:
        raise DriverError(
            f"{where}: amplitude {amplitude:g} rad: expected {LEAST_AMPLITUDE:g} to {room:.2f} rad in this pose"
        )
    wide = min(LARGEST_AMPLITUDE, room) if amplitude is None else amplitude
    centre = float(np.clip(pose[joint], lowest + wide, highest - wide))
    reach = limb.reach(pose)
    gravity = np.array([0.0, 0.0, -GRAVITY]) if up is None else -up
    ends = np.linspace(centre - wide, centre + wide, 9)
    load = limb.at(pose, ends, gravity)
    weight, allowed = float(np.abs(load.load).max()), TORQUE_SHARE * float(robot.usable_torque[joint])
    if weight > 0.8 * allowed:
        raise DriverError(
            f"{where}: its limb weighs {weight:.2f} N·m on it, by the masses of the robot file; the motion is allowed "
            f"{allowed:.2f} N·m: turn the robot so that the limb hangs down, or take a part of it off"
        )
    fastest = min(TIP_SPEED / max(reach, 1e-3), NO_LOAD_SHARE * servo.no_load_speed)
    armature = max(servo.armature, 1e-9) + float(load.inertia.mean())
    own_hz = math.sqrt(robot.kp[joint] / armature) / (2 * math.pi)
    last_hz = min(_SPAN * own_hz, 0.1 * robot.rate_hz)
    speed, found = fastest, None
    for _ in range(12):
        goals = _goals(robot.rate_hz, centre, wide, min(_SLOW_SHARE * fastest, 0.5 * speed), speed, last_hz)
        found = Excitation(
            joint=joint,
            pose=pose.copy(),
            goals=goals,
            centre=centre,
            amplitude=wide,
            approach=min(robot.safety.soft_start_speed, 0.5 * fastest),
            lowest=0.0,
            highest=0.0,
            speed=0.0,
            torque=0.0,
            reach=reach,
            weight=weight,
        )
        found = _predicted(robot, limb, found, pose, gravity)
        over = max(found.speed / fastest, found.torque / allowed)
        if over <= 1.0:
            return found
        speed *= min(0.95 / over, 0.95)
    assert found is not None
    raise DriverError(
        f"{where}: the motion would need {found.torque:.2f} N·m at {found.speed:.2f} rad/s by the robot's model, it is "
        f"allowed {allowed:.2f} N·m and {fastest:.2f} rad/s"
    )


def _goals(rate_hz: float, centre: float, amplitude: float, slow: float, fast: float, last_hz: float) -> Float:
    """Sweeps at speed `slow`, then an oscillation whose greatest speed is `fast` [rad/s]."""
    dt = 1.0 / rate_hz
    rest = np.zeros(round(_REST_S * rate_hz))
    corners = np.array([0.0, amplitude, -amplitude, 0.0])
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / slow)])
    sweep = np.interp(np.arange(0.0, times[-1], dt), times, corners)
    first_hz = min(fast / (2 * math.pi * amplitude), 0.5 * last_hz)
    t = np.arange(0.0, _OSCILLATION_S, dt)
    growth = math.log(last_hz / first_hz) / _OSCILLATION_S
    frequency = first_hz * np.exp(growth * t)
    phase = 2 * math.pi * (frequency - first_hz) / growth
    size = np.minimum(amplitude, fast / (2 * math.pi * frequency))
    fade = np.minimum(1.0, (_OSCILLATION_S - t) / 0.5)
    return centre + np.concatenate([rest, sweep, rest, size * fade * np.sin(phase), rest])


def _predicted(robot: Robot, limb: Limb, planned: Excitation, pose: Float, gravity: Float) -> Excitation:
    """The same with what the servo plant makes of it, by the figures of the robot file."""
    joint, servo, count = planned.joint, robot.servos[planned.joint], len(planned.goals)
    time = np.arange(count) / robot.rate_hz
    grid = np.linspace(planned.goals.min(), planned.goals.max(), 15)
    known = limb.at(pose, grid, gravity)
    load = LimbLoad(np.interp(planned.goals, grid, known.inertia), np.interp(planned.goals, grid, known.load))
    unknown = np.full(count, np.nan)
    begin = np.full(count, planned.goals[0])
    stretch = Stretch(time, time, planned.goals, begin, unknown, unknown, np.ones(count, np.bool_), load, 0.0)
    figures = {
        "kp": robot.kp[joint],
        "back_emf": servo.back_emf,
        "frictionloss": servo.frictionloss,
        "damping": servo.damping,
        "armature": servo.armature,
        "delay": servo.delay,
    }
    found = JointModel(robot, joint, [stretch]).simulate(np.array([[figures[name] for name in FIGURES]]))
    angle, torque = found.angle, found.torque
    speed = np.gradient(angle[:, 0], 1.0 / robot.rate_hz)
    return replace(
        planned,
        lowest=float(min(angle.min(), planned.start)),
        highest=float(max(angle.max(), planned.start)),
        speed=float(np.abs(speed).max()),
        torque=float(np.abs(torque).max()),
    )
