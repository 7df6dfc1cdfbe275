"""`Fallen`: a simulated robot that has really fallen, in the control loop alone: no planner, no gateway.

It stands up into a pose of arms and legs drawn at random, is pushed over ahead or back, gives way as the ladder has it,
and lies without torque. Or its torque is cut, as by `kill`, and it collapses limp, pushed a little. Mass, friction of
floor and joints, stiffness, supply, slope and latency are drawn as well, within those of the project's robustness tests
(`flexmotion.drivers.sim.options.PERTURBED`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import PERTURBED, SimOptions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.lying import lying_on
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.telemetry import Telemetry, events

ARMS_RAD, LEGS_RAD = 0.8, 0.25
"""Greatest angle by which a joint of arms and head, or of a leg, differs from the stand pose when the robot falls."""
PUSHED_AT_S, FALLS_WITHIN_S, LIES_S = 4.0, 4.0, 3.0
"""When it is pushed, how long it may take to fall, and how long it lies before it is asked to get up [s]."""
OVER_NS, LIMP_NS = (1.8, 2.8), (0.5, 1.1)
"""Least and greatest impulse that pushes it over, and that decides to which side a limp robot falls [N·s]."""
MASS_KG = (3.15, 3.5)
"""Least and greatest mass of the robot: without and with battery and cables [kg]."""
LIGHT, FRICTION, STIFF, VOLTS, DRY = 0.94, 1.0, 1.04, (11.4, 12.4), (0.7, 1.5)
"""Mass of the torso and stiffness of the servos over nominal, friction of the floor, supply [V] and dry friction of the
joints over nominal, at the end of their range that the perturbations do not have."""
ASK_AGAIN, ASKS, ASKS_AGAIN_S = "ask again", 5, 1.0
"""What a refusal says that is not for good, how often a robot is asked at most, and after which time again [s]. A limp
leg that slides down seconds after the fall moves the torso as a hand would."""
STANDS_S = 2.0
"""Time that it must stand after it has got up, still upright [s]."""
LONGEST_S = 45.0
"""Bound against hanging [s]."""


def way_to_lie(side: str, limp: bool) -> str:
    """The side that a robot lies on, and whether it had collapsed limp, in words."""
    return f"{side}, limp" if limp else side


@dataclass(frozen=True)
class GotUp:
    """How one attempt ended.

    Attributes:
        side: that it lay on.
        limp: it had collapsed limp.
        asked: requests until it began to get up, or all of them.
        stood: it got up, and stood for `STANDS_S`.
        seconds: from the last request until it was ready for a plan.
        peak_nm: greatest torque of a servo; peak_share: the same over its usable torque. A servo that brakes makes more
            than that, up to its stall torque.
        rms_share: greatest RMS torque of a servo over its usable torque.
        violations: goals outside the servos' envelope.
        reason: why it does not stand; empty where it does.
    """

    seed: int
    side: str
    limp: bool
    asked: int
    stood: bool
    seconds: float
    peak_nm: float
    peak_share: float
    rms_share: float
    violations: int
    reason: str

    @property
    def way(self) -> str:
        """See `way_to_lie`."""
        return way_to_lie(self.side, self.limp)


def perturbed_options(rng: np.random.Generator, side: str, *, limp: bool) -> dict[str, Any]:
    """Options of a simulated robot that is pushed over to a side, or collapses limp to it."""
    angle, impulse = rng.uniform(-0.35, 0.35), rng.uniform(*(LIMP_NS if limp else OVER_NS))
    impulse *= 1.0 if side == "front" else -1.0
    slope = np.abs(PERTURBED.slope_deg).max()
    return {
        "torso_mass_scale": rng.uniform(LIGHT, PERTURBED.torso_mass_scale),
        "total_mass": rng.uniform(*MASS_KG),
        "kp_scale": rng.uniform(PERTURBED.kp_scale, STIFF),
        "extra_latency_s": rng.uniform(0.0, PERTURBED.extra_latency_s),
        "friction": rng.uniform(PERTURBED.friction or FRICTION, FRICTION),
        "joint_friction_scale": rng.uniform(*DRY),
        "voltage": rng.uniform(*VOLTS),
        "slope_deg": tuple(rng.uniform(-slope, slope, 2)),
        "pushes": (
            {
                "at": PUSHED_AT_S,
                "impulse": (impulse * np.cos(angle), impulse * np.sin(angle), 0.0),
                "duration": 0.2,
            },
        ),
    }


class Fallen:
    """A robot and its loop, from the stand to the fall and up again.

    Args:
        robot: to simulate.
        retargeter: of the robot; may be shared, since the loop changes nothing in it.
        side: that it is to fall on, `front` or `back`.
        seed: of pose, push, perturbations and noise.
        limp: its torque is cut as it is pushed.

    Attributes:
        lies_on: the side that it has fallen on; None: it has not.
    """

    def __init__(self, robot: Robot, retargeter: Retargeter, side: str, seed: int, *, limp: bool = False) -> None:
        self.robot, self.seed, self.limp, self._retargeter = robot, seed, limp, retargeter
        self._rng = np.random.default_rng([seed, side == "front"])
        options = SimOptions(seed=seed, **perturbed_options(self._rng, side, limp=limp))
        self.driver = SimDriver(robot, options=options)
        plans = PlanBuffer(robot.n, retargeter.layout.size, retargeter.horizon, robot.rate_hz)
        self.telemetry = Telemetry(robot.n, robot.rate_hz)
        self.loop = ControlLoop(robot, self.driver, retargeter, plans, self.telemetry)
        self.loop.awaits_arm = True
        self._peak, self._squares = np.zeros(robot.n), np.zeros(robot.n)
        self._asked = 0
        self.lies_on: str | None = None

    def fall(self) -> None:
        """Stand up into a random pose, be pushed, and lie; sets `lies_on`."""
        loop, robot = self.loop, self.robot
        carries = loop.joints.carries
        spread = np.where(carries, LEGS_RAD, ARMS_RAD) * self._rng.uniform(-1.0, 1.0, robot.n)
        loop.stand_pose = np.clip(loop.stand_pose + spread, robot.lower, robot.upper)
        self.driver.open()
        self._until(State.OFF, 0.3)
        loop.inputs.start = True
        if self.limp and not self._until(State.FAULT, PUSHED_AT_S - 0.3):
            loop.inputs.kill = True
        if not self._until(State.FAULT, PUSHED_AT_S + FALLS_WITHIN_S):
            return
        self._until(State.OFF, LIES_S)
        loop.stand_pose = self._retargeter.layout.view(self._retargeter.standing()).q[0].copy()
        self.lies_on = lying_on(loop.estimator.tilt, robot.safety.fall_tilt)

    def get_up(self) -> GotUp:
        """Ask it to get up, again where it is told to, and watch what becomes of it."""
        loop, rate = self.loop, self.robot.rate_hz
        told = self.telemetry.events.reader(new_only=True)
        for self._asked in range(1, ASKS + 1):
            before, begin = self.driver.violations, loop.tick_count
            self._peak[:] = self._squares[:] = 0.0
            loop.inputs.get_up = True
            self._tick()
            refused = "; ".join(event.message for event in events(told) if event.kind == "refused")
            if ASK_AGAIN not in refused:
                break
            self._until(State.OFF, ASKS_AGAIN_S)
        if refused:
            return self._ended(refused, before, begin)
        while self._in(State.GET_UP, State.READY) and not loop.ready:
            self._tick()
            if loop.tick_count - begin > LONGEST_S * rate:
                return self._ended("it takes too long", before, begin)
        if not loop.ready:
            return self._ended(loop.ladder.fault or loop.ladder.state.name, before, begin)
        ended = self._ended("", before, begin)
        self._until(State.FAULT, STANDS_S)
        if not self._in(State.READY):
            return self._ended(f"it stood, then: {loop.ladder.fault}", before, begin)
        return ended

    def _in(self, *states: State) -> bool:
        return self.loop.ladder.state in states

    def _ended(self, reason: str, before: int, begin: int) -> GotUp:
        usable, ticks = self.robot.usable_torque, self.loop.tick_count - begin
        return GotUp(
            seed=self.seed,
            side=str(self.lies_on),
            limp=self.limp,
            asked=self._asked,
            stood=not reason,
            seconds=ticks / self.robot.rate_hz,
            peak_nm=float(self._peak.max()),
            peak_share=float((self._peak / usable).max()),
            rms_share=float((np.sqrt(self._squares / ticks) / usable).max()),
            violations=self.driver.violations - before,
            reason=reason,
        )

    def _until(self, state: State, seconds: float) -> bool:
        """Tick until the ladder is in a state, for `seconds` at most; OFF: for that long. Returns whether it is."""
        for _ in range(round(seconds * self.robot.rate_hz)):
            self._tick()
            if state is not State.OFF and self._in(state):
                return True
        return self._in(state)

    def _tick(self) -> None:
        self.loop.tick()
        self.driver.advance(1.0 / self.robot.rate_hz)
        torque = self.driver.plant.torque
        np.maximum(self._peak, np.abs(torque), out=self._peak)
        self._squares += torque**2
