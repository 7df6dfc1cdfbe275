"""`evaluate`: a policy walks at a speed, on the robot as it is or as the robustness tests perturb it.

`evaluate_plan` measures the plan's walk by the same figures: the whole live system in lockstep.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.robot.learned.gait import GaitTable
from benchmarks.robot.learned.ground import LOADED_N, Ground
from benchmarks.robot.learned.policy import Policy
from benchmarks.robot.learned.walk import RAMP_S, TICKS, Walk
from benchmarks.robot.simulation import simulator
from benchmarks.robot.steering import torso_yaw
from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.human.body import Body
from flexmotion.retarget.legs import CHAIN
from flexmotion.streamer import api
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.robot_pace import human_scale

Float = NDArray[np.float64]

STEADY_S = RAMP_S + 0.5
"""From here on a learned walk has its speed [s]."""
STOOD_S, PLAN_STEADY_S = 3.0, 4.0
"""The same of a plan's: until its velocity is asked for, and then until it has it [s]."""
SWING_S = 0.07
"""A foot that is unloaded for less does not swing [s]."""


@dataclass(frozen=True)
class Walked:
    """One run.

    Attributes:
        asked: speed that was asked for [m/s].
        perturbed: the robot had the standard perturbations, and 3.5 kg.
        upright: it did not fall.
        speed: along the first heading, once it has it [m/s]; NaN where it fell.
        heading_deg: how far it looks aside at the end [degrees]; aside: how far it went aside, over its way.
        slip: speed of loaded feet along the floor, mean [m/s].
        height: the greatest height of a sole's lowest corner in a swing, median over swings [m].
        swing_s: median length of a swing [s]; double_share: share of the time on both feet.
        torque: mean torque of the legs' servos over the usable one; saturated: share of time at a limit of the torque.
        violations: goals outside the envelope.
    """

    asked: float
    perturbed: bool
    seed: int
    upright: bool
    speed: float
    heading_deg: float
    aside: float
    slip: float
    height: float
    swing_s: float
    double_share: float
    torque: float
    saturated: float
    violations: int


class Watch:
    """Collects the figures of a steady walk, look by look.

    Args:
        driver: of the robot.
        ground: what its feet do.
        every_s: time between two looks [s].
    """

    def __init__(self, driver: SimDriver, ground: Ground, every_s: float) -> None:
        robot = driver.robot
        self._driver, self._ground, self._every = driver, ground, every_s
        chains = [robot.chain(f"{side}_leg") for side in ("left", "right")]
        self._legs = [chain[name] for chain in chains for name in CHAIN]
        self._highest, self._air = np.zeros(2), np.zeros(2)
        self._swings = list[tuple[float, float]]()
        self._torque, self._saturated, self._slips = list[float](), list[float](), list[float]()
        self._double = list[bool]()
        self._first: Float | None = None
        self._looks = 0

    def look(self) -> None:
        """Take the present state, which `ground` has seen."""
        ground, usable = self._ground, self._driver.robot.usable_torque
        if self._first is None:
            self._first, self._yaw = ground.position.copy(), self.heading()
        self._looks += 1
        loaded = ground.load > LOADED_N
        for side in (0, 1):
            if not loaded[side]:
                self._highest[side] = max(self._highest[side], float(ground.height[side]))
                self._air[side] += self._every
                continue
            if self._air[side] >= SWING_S:
                self._swings.append((float(self._highest[side]), float(self._air[side])))
            self._highest[side] = self._air[side] = 0.0
        self._double.append(bool(loaded.all()))
        self._torque.append(float((np.abs(ground.torque) / usable)[self._legs].mean()))
        self._saturated.append(float(ground.saturated[self._legs].mean()))
        self._slips += ground.slip[loaded].tolist()

    def walked(self, asked: float, perturbed: bool, seed: int, upright: bool, yaw: float = 0.0) -> Walked:
        """The figures so far; `yaw`: of the heading that the robot is to go along [rad]."""
        way = np.full(2, np.nan)
        if self._first is not None and upright and self._looks > 1:
            way = (self._ground.position - self._first)[:2] / ((self._looks - 1) * self._every)
        along = float(way @ [np.cos(yaw), np.sin(yaw)])
        across = float(way @ [-np.sin(yaw), np.cos(yaw)])
        heights, lengths = zip(*self._swings, strict=True) if self._swings else ((np.nan,), (np.nan,))
        return Walked(
            asked,
            perturbed,
            seed,
            upright,
            along,
            float(np.degrees(self.heading() - yaw)),
            abs(across) / max(abs(along), 1e-3),
            _mean(self._slips),
            float(np.median(heights)),
            float(np.median(lengths)),
            _mean(self._double),
            _mean(self._torque),
            _mean(self._saturated),
            self._driver.violations,
        )

    def heading(self) -> float:
        """Heading of the torso [rad]."""
        truth = self._driver.truth()
        return float(torso_yaw(np.concatenate([truth.base_position, truth.base_quaternion])[None])[0])


def options_of(robot: Robot, perturbed: bool, seed: int) -> SimOptions:
    """Those of the other benchmarks' simulated robot."""
    options = simulator(robot, perturbed, seed).options
    assert isinstance(options, SimOptions)
    return options


def evaluate(robot: Robot, policy: Policy, asked: float, perturbed: bool, seed: int, seconds: float) -> Walked:
    """One run of a policy, without noise on its actions, for `seconds` from the stand on."""
    walk = Walk(robot, GaitTable(robot, policy.gait))
    walk.begin(options_of(robot, perturbed, seed), asked, right_first=bool(seed % 2))
    watch = Watch(walk.walker.driver, walk.ground, TICKS / robot.rate_hz)
    while walk.time < seconds and not walk.fell:
        walk.step(policy.act(walk.seen))
        if walk.time >= STEADY_S:
            watch.look()
    return watch.walked(asked, perturbed, seed, not walk.fell)


def evaluate_plan(robot: Robot, asked: float, perturbed: bool, seed: int, seconds: float) -> Walked:
    """The same by plans: the velocity is asked for from a stand as an operator asks, and held for `seconds`."""
    ratio = human_scale(robot, Body())
    driver = simulator(robot, perturbed, seed)
    assert isinstance(driver, SimDriver)
    with api.open_session(robot, driver, seed=seed) as session:
        session.advance(STOOD_S)
        session.send(Velocity(asked * ratio, 0.0, 0.0))
        begin, ground = session.state.tick, Ground(driver)
        watch = Watch(driver, ground, 1.0 / robot.rate_hz)
        upright, yaw = True, watch.heading()
        while session.state.tick < begin + seconds * robot.rate_hz and session.step():
            upright &= driver.torso_up > np.cos(robot.safety.fall_tilt)
            if session.state.tick >= begin + PLAN_STEADY_S * robot.rate_hz and upright:
                ground.update()
                watch.look()
        return watch.walked(asked, perturbed, seed, upright, yaw)


def _mean(values: list[float] | list[bool]) -> float:
    return float(np.mean(values)) if values else float("nan")
