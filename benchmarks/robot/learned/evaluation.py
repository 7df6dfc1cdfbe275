"""`evaluate`: a policy walks at a speed, on the robot as it is or as the robustness tests perturb it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.robot.learned.gait import GaitTable
from benchmarks.robot.learned.ground import LOADED_N
from benchmarks.robot.learned.policy import Policy
from benchmarks.robot.learned.walk import RAMP_S, TICKS, Walk
from benchmarks.robot.simulation import simulator
from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.options import SimOptions

Float = NDArray[np.float64]

STEADY_S = RAMP_S + 0.5
"""From here on a walk has its speed [s]."""
SWING_S = 0.07
"""A foot that is unloaded for less does not swing [s]."""


@dataclass(frozen=True)
class Walked:
    """One run.

    Attributes:
        asked: speed that was asked for [m/s].
        perturbed: the robot had the standard perturbations, and 3.5 kg.
        upright: it did not fall.
        seconds: until it fell, or all.
        speed: along the first heading, once it has it [m/s]; NaN where it fell.
        heading_deg: how far it looks aside at the end [degrees]; aside: how far it went aside, over its way.
        slip: speed of loaded feet along the floor, mean [m/s].
        height: the greatest height of a sole's lowest corner in a swing, median over swings [m].
        torque: mean torque of the legs' servos over the usable one; saturated: share of time at a limit of the torque.
        violations: goals outside the envelope; clamped: share of goals that were clamped.
    """

    asked: float
    perturbed: bool
    seed: int
    upright: bool
    seconds: float
    speed: float
    heading_deg: float
    aside: float
    slip: float
    height: float
    torque: float
    saturated: float
    violations: int
    clamped: float


def options_of(robot: Robot, perturbed: bool, seed: int) -> SimOptions:
    """Those of the other benchmarks' simulated robot."""
    options = simulator(robot, perturbed, seed).options
    assert isinstance(options, SimOptions)
    return options


def evaluate(robot: Robot, policy: Policy, asked: float, perturbed: bool, seed: int, seconds: float) -> Walked:
    """One run of a policy, without noise on its actions."""
    walk = Walk(robot, GaitTable(robot, policy.gait))
    walk.begin(options_of(robot, perturbed, seed), asked, right_first=bool(seed % 2))
    legs, usable = walk.table.legs.ravel(), robot.usable_torque
    torque, saturated, slips, swings, clamped = [], [], [], list[float](), 0
    highest, lifted, start = np.zeros(2), np.zeros(2), None
    while walk.time < seconds and not walk.fell:
        walk.step(policy.act(walk.seen))
        ground = walk.ground
        clamped += walk.walker.clamps
        loaded = ground.load > LOADED_N
        for side in (0, 1):
            if not loaded[side]:
                highest[side] = max(highest[side], float(ground.height[side]))
                lifted[side] += 1
                continue
            if lifted[side] * TICKS / robot.rate_hz >= SWING_S:
                swings.append(float(highest[side]))
            highest[side] = lifted[side] = 0.0
        if walk.time < STEADY_S:
            continue
        if start is None:
            start, begin, swings = ground.position.copy(), walk.time, []
        torque.append(float((np.abs(ground.torque) / usable)[legs].mean()))
        saturated.append(float(ground.saturated[legs].mean()))
        slips += ground.slip[loaded].tolist()
    upright = not walk.fell
    way = np.full(2, np.nan)
    if start is not None and upright:
        way = (walk.ground.position - start)[:2] / (walk.time - begin)
    w, x, y, z = walk.walker.driver.truth().base_quaternion
    heading = float(np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))))
    return Walked(
        asked,
        perturbed,
        seed,
        upright,
        walk.time,
        float(way[0]),
        heading,
        float(abs(way[1]) / max(abs(way[0]), 1e-3)),
        _mean(slips),
        float(np.median(swings)) if swings else float("nan"),
        _mean(torque),
        _mean(saturated),
        walk.walker.driver.violations,
        clamped / max(walk.walker.ticks * robot.n / 2, 1),
    )


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
