"""Fit of a joint's figures to a record: output error, by least squares, with the uncertainty of every figure.

The joint is simulated with the servo plant under the goals that were sent, and its angle and torque are compared with
what was measured. The covariance of the estimate follows from the Jacobian and from the residual as it is, with its
correlation in time (quantisation at slow motion, friction), which the formula for white noise would understate by
far: E. A. Morelli, V. Klein, "Accuracy of aerodynamic model parameters estimated from flight test data", Journal of
Guidance, Control, and Dynamics 20 (1997), 74-80, equation 19.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Servo, catalogue
from flexmotion.drivers.identification.model import FIGURES, JointModel, Stretch

Float = NDArray[np.float64]

EFFORT, PHASE, AGE = "effort", "phase", "age"
"""The last columns of an estimate if torque is measured: measured over true torque, when in a tick it is sampled, and
its age, both over the tick's duration (see `JointModel.simulate`)."""

_COVERAGE = 2.0
"""Standard deviations of a stated uncertainty: 95 % of a normal distribution."""

MODEL_SHARE, SPLIT_SHARE, UNKNOWN_TORQUE_SHARE, TIMING_S = 0.02, 0.05, 0.0015, 0.0008
"""Parts of an uncertainty that no residual shows: of every torque, over it (a supply known to 0.1 V, torque as its mean
over a tick, steps of the integration); of the two kinds of drag against each other, over the back-EMF; a torque that
grows with the angle as the limb's weight does, such as a cable's, over the stall torque; of the delay (when in its own
cycle a servo takes its angle) [s]."""

_WEAK = 10.0
"""Standard deviation of the belief that a figure is as in the catalogue, over that figure: keeps a figure that the
motion does not show at all finite, with an uncertainty that nobody can mistake."""

_STEP, _OUTLIER, _CORRELATION_S, _MOST_EVALUATIONS = 0.01, 5.0, 0.4, 40
_ROUNDS, _TRIALS, _FIRST_SHARE = 2, 6, 0.05
"""Fits, each with the noise of the one before; evaluations to compare two ways of measuring a current; noise of torque
in the first fit, over the stall torque."""
_EDGES = (-0.3, 0.3)
"""How much earlier than the angle a current may be sampled, over a tick, to tell which goal was in effect."""


@dataclass(frozen=True)
class Estimate:
    """Figures that fit a record best.

    Attributes:
        names: of the figures: those of `FIGURES` that were fitted, and `EFFORT` if torque was measured.
        value, uncertainty: by name, units of `FIGURES`.
        error, motion: RMS of the angle's error and of its motion around its mean [rad].
        samples, rejected: compared ticks, and those of them that were left out as outliers.
    """

    names: tuple[str, ...]
    value: dict[str, float]
    uncertainty: dict[str, float]
    error: float
    motion: float
    samples: int
    rejected: int


@dataclass(frozen=True)
class _Unknowns:
    """The fitted figures, scaled: a candidate is `scale` times x."""

    names: tuple[str, ...]
    scale: Float
    start: Float
    lower: Float
    upper: Float
    belief: Float
    """Standard deviation of the belief in `start`, scaled."""

    def figures(self, x: Float) -> Float:
        """Candidates (m, 6) in the order of `FIGURES` of scaled unknowns (m, p)."""
        values = dict(zip(self.names, (x * self.scale).T, strict=True))
        return np.column_stack([values.get(name, np.zeros(len(x))) for name in FIGURES])


class Fit:
    """Fits one joint to its stretches.

    Args:
        robot, joint: with the figures from which the fit begins.
        stretches: at least one.
    """

    def __init__(self, robot: Robot, joint: int, stretches: list[Stretch]) -> None:
        self.model = JointModel(robot, joint, stretches)
        self.servo = robot.servos[joint]
        self._rate = robot.rate_hz
        self._position = np.concatenate([each.position for each in stretches])
        self._effort = np.concatenate([each.effort for each in stretches])
        self._compared = np.concatenate([each.compared for each in stretches])
        self._has_effort = self._compared & np.isfinite(self._effort)
        self._measures_torque = bool(self._has_effort.sum() > 0.5 * self._compared.sum())
        self._unknowns = _unknowns(robot, joint, effort=self._measures_torque)
        tick = float(robot.tick_rad[joint])
        unit = (self.servo.current_unit or math.nan) * (
            self.servo.torque_constant or self.servo.stall_torque / self.servo.stall_current
        )
        self._floor = tick / math.sqrt(12), unit / math.sqrt(12)
        # First the angle alone decides, which has one minimum over the delay.
        self._noise = self._floor[0], _FIRST_SHARE * self.servo.stall_torque
        self._goal_of_effort: Float | None = None
        self._cache: tuple[Float, Float, Float] | None = None

    def solve(self) -> Estimate:
        """The estimate. The noise of angle and torque is that of the residual of the fit before."""
        x = self._solve(self._start())
        rejected = self._weigh(x)
        if self._measures_torque:
            x = self._choose_sampling(x)
        for _ in range(_ROUNDS):
            rejected += self._weigh(x)
            x = self._solve(x)
        x = np.asarray(x)
        unknowns = self._unknowns
        deviation = np.sqrt(np.diag(self._covariance(x)) + self._split(x) ** 2 / _COVERAGE**2)
        angle = self._errors(x)[0]
        motion = self._position[self._compared]
        return Estimate(
            names=unknowns.names,
            value=dict(zip(unknowns.names, (x * unknowns.scale).tolist(), strict=True)),
            uncertainty=self._uncertainty(x * unknowns.scale, _COVERAGE * deviation * unknowns.scale),
            error=float(np.sqrt(np.mean(angle**2))),
            motion=float(motion.std()),
            samples=int(self._compared.sum()) + rejected,
            rejected=rejected,
        )

    # ---------------------------------------------------------------- inside

    def _solve(self, x: Float, evaluations: int = _MOST_EVALUATIONS) -> Float:
        """Unknowns with the least squares of the present weights, from `x` on."""
        bounds = self._unknowns.lower, self._unknowns.upper
        found = least_squares(
            self._residual, x, jac=self._jacobian, bounds=bounds, xtol=1e-4, ftol=1e-5, max_nfev=evaluations
        )
        return np.asarray(found.x)

    def _choose_sampling(self, x: Float) -> Float:
        """Find out how the servo measures its current; returns the unknowns for that.

        Either it samples the current under the goal that is in effect: which one that is, is uncertain if goals arrive
        close to the sample. Or its current is filtered over more than a tick.
        """
        place = self._unknowns.names.index("delay")
        delay = float(x[place] * self._unknowns.scale[place])
        best = (math.inf, x, self._goal_of_effort)
        for early in (*_EDGES, None):
            self._goal_of_effort = None if early is None else self._goals_in_effect(delay, early / self._rate)
            self._cache = None
            tried = self._solve(x, _TRIALS)
            cost = float(np.sum(self._residual(tried) ** 2))
            if cost < best[0]:
                best = cost, tried, self._goal_of_effort
        self._goal_of_effort, self._cache = best[2], None
        return best[1]

    def _goals_in_effect(self, delay: float, early: float) -> Float:
        """The goal that has arrived at each tick, `early` before the measurement [s], (N,) [rad]."""
        goals = []
        for each in self.model.stretches:
            arrived = np.searchsorted(each.goal_time + delay + each.bus_s, each.time - early, side="right") - 1
            goals.append(each.goal[np.maximum(arrived, 0)])
        return np.concatenate(goals)

    def _start(self) -> Float:
        """The catalogue's figures with the delay that fits them best."""
        start, place = self._unknowns.start, self._unknowns.names.index("delay")
        delays = np.linspace(0.0, self._unknowns.upper[place], 13)
        candidates = np.tile(start, (len(delays), 1))
        candidates[:, place] = delays
        angle = self._outputs(candidates)[0][self._compared]
        error = np.sum((self._position[self._compared][:, None] - angle) ** 2, axis=0)
        return np.asarray(candidates[int(np.argmin(error))])

    def _outputs(self, x: Float) -> tuple[Float, Float]:
        """Simulated angle and measured torque, (N, m) each, of scaled unknowns (m, p)."""
        figures = self._unknowns.figures(x)
        if not self._measures_torque:
            found = self.model.simulate(figures)
            return found.angle, found.torque
        effort, phase, age = x[:, -3:].T
        found = self.model.simulate(figures, age / self._rate)
        if self._goal_of_effort is None:
            return found.angle, (found.torque + found.slope * (phase / self._rate)) * effort
        kp, back_emf = figures[:, 0], figures[:, 1]
        supply = found.supply[:, None]
        torque = kp * supply * (self._goal_of_effort[:, None] - found.late_angle) - back_emf * found.late_speed
        return found.angle, np.clip(torque, -self.servo.stall_torque, self.servo.stall_torque) * effort

    def _evaluate(self, x: Float) -> tuple[Float, Float]:
        """Weighted residual (R,) and its Jacobian (R, p): all candidates of the central differences at once."""
        if self._cache is not None and np.array_equal(self._cache[0], x):
            return self._cache[1], self._cache[2]
        unknowns, p = self._unknowns, len(x)
        step = np.minimum(_STEP, 0.5 * (unknowns.upper - unknowns.lower))
        above = np.minimum(x + step, unknowns.upper)
        below = np.maximum(x - step, unknowns.lower)
        candidates = np.vstack(
            [x, np.where(np.eye(p, dtype=bool), above, x), np.where(np.eye(p, dtype=bool), below, x)]
        )
        angle, torque = self._outputs(candidates)
        rows = [(self._position[self._compared][:, None] - angle[self._compared]) / self._noise[0]]
        if self._measures_torque:
            rows.append((self._effort[self._has_effort][:, None] - torque[self._has_effort]) / self._noise[1])
        rows.append((candidates - unknowns.start).T / unknowns.belief[:, None])
        errors = np.vstack(rows)
        jacobian = (errors[:, 1 : p + 1] - errors[:, p + 1 :]) / (above - below)
        self._cache = x.copy(), errors[:, 0], jacobian
        return errors[:, 0], jacobian

    def _residual(self, x: Float) -> Float:
        return self._evaluate(x)[0]

    def _jacobian(self, x: Float) -> Float:
        return self._evaluate(x)[1]

    def _errors(self, x: Float) -> tuple[Float, Float]:
        """Errors of angle [rad] and torque [N·m] at the compared ticks."""
        residual = self._evaluate(x)[0]
        angles, torques = int(self._compared.sum()), int(self._has_effort.sum()) * self._measures_torque
        return residual[:angles] * self._noise[0], residual[angles : angles + torques] * self._noise[1]

    def _weigh(self, x: Float) -> int:
        """Leave out outliers, and take the noise of the rest; returns how many angles were left out."""
        angle, torque = self._errors(x)
        kept, left_out = [], 0
        for errors, which in ((angle, self._compared), (torque, self._has_effort)):
            if not len(errors):
                kept.append(0.0)
                continue
            spread = max(1.4826 * float(np.median(np.abs(errors))), 1e-12)
            spread = max(spread, self._floor[0] if which is self._compared else self._floor[1])
            good = np.abs(errors) <= _OUTLIER * spread
            which[np.flatnonzero(which)[~good]] = False
            if which is self._compared:
                left_out = int(np.count_nonzero(~good))
            kept.append(float(np.sqrt(np.mean(errors[good] ** 2))))
        self._noise = max(kept[0], self._floor[0]), max(kept[1], self._floor[1])
        self._has_effort &= self._compared
        self._cache = None
        return left_out

    def _split(self, x: Float) -> Float:
        """What an error of `SPLIT_SHARE` in viscous friction makes of every scaled unknown, (p,)."""
        if "damping" not in self._unknowns.names:
            return np.zeros(len(x))
        place = self._unknowns.names.index("damping")
        jacobian = self._evaluate(x)[1]
        column = np.linalg.inv(jacobian.T @ jacobian)[:, place]
        return np.asarray(column / column[place]) * SPLIT_SHARE * self.servo.back_emf / self._unknowns.scale[place]

    def _uncertainty(self, value: Float, random: Float) -> dict[str, float]:
        """Uncertainties by name: those by the residual, with those that it cannot show."""
        loads = np.concatenate([each.load.load for each in self.model.stretches])[self._compared]
        limb = float(np.mean(np.concatenate([each.load.inertia for each in self.model.stretches])))
        # Every torque is known by the limb's weight, or else by the belief in the torque constant.
        unknown = UNKNOWN_TORQUE_SHARE * self.servo.stall_torque
        scale = unknown / max(2.0 * float(loads.std()), 1e-9)
        scale = min(scale, _COVERAGE * (torque_constant_belief() if self._measures_torque else _WEAK))
        share = math.hypot(MODEL_SHARE, scale)
        speed = self.model.simulate(self._unknowns.figures((value / self._unknowns.scale)[None])).late_speed[:, 0]
        acceleration = float(np.std(np.gradient(speed)[self._compared])) * self._rate
        table = {"delay": TIMING_S, PHASE: 0.0, AGE: 0.0}
        found = {}
        for name, each, known in zip(self._unknowns.names, random.tolist(), value.tolist(), strict=True):
            own = share * abs(known)
            if name == "damping":
                # What the drag is beyond the back-EMF, which the current shows: an error of every torque is one of it.
                own = share * (abs(known) + abs(float(value[self._unknowns.names.index("back_emf")])))
            elif name == "armature":
                # At one frequency acceleration follows the angle, as that torque does.
                own = math.hypot(share * (abs(known) + limb), unknown / max(2.0 * acceleration, 1e-9))
            found[name] = math.hypot(each, table.get(name, own))
        return found

    def _covariance(self, x: Float) -> Float:
        """Covariance of the scaled unknowns, (p, p): Morelli and Klein, with the residual's own autocorrelation."""
        residual, jacobian = self._evaluate(x)
        angles, torques = int(self._compared.sum()), int(self._has_effort.sum()) * self._measures_torque
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        middle = np.zeros_like(inverse)
        lags = round(_CORRELATION_S * self._rate)
        for rows in (slice(0, angles), slice(angles, angles + torques)):
            middle += _spread(jacobian[rows], residual[rows], lags)
        believed = jacobian[angles + torques :]
        middle += believed.T @ believed
        return np.asarray(inverse @ middle @ inverse)


def _spread(jacobian: Float, residual: Float, lags: int) -> Float:
    """Sum over i, j of s_i R(i - j) s_jᵀ with the autocovariance R of the residual, tapered (Bartlett), (p, p)."""
    total = np.zeros((jacobian.shape[1],) * 2)
    count = len(residual)
    for lag in range(min(lags, count)):
        covariance = float(residual[lag:] @ residual[: count - lag]) / count * (1.0 - lag / lags)
        product = jacobian[lag:].T @ jacobian[: count - lag]
        total += covariance * (product if lag == 0 else product + product.T)
    return total


def torque_constant_belief() -> float:
    """How far a torque constant of the catalogue is off, as a share, where no motion shows it.

    Standard deviation between the torque constants of the vendor and stall torque over stall current, by which the
    others are known: of the servos for which both are.
    """
    known = [each for each in catalogue().values() if each.torque_constant and not _assumed(each)]
    ratios = [each.torque_constant / (each.stall_torque / each.stall_current) for each in known if each.torque_constant]
    return float(np.sqrt(np.mean((np.array(ratios) - 1.0) ** 2)))


def _assumed(servo: Servo) -> bool:
    return servo.provenance["torque_constant"].assumption


def _unknowns(robot: Robot, joint: int, *, effort: bool) -> _Unknowns:
    servo = robot.servos[joint]
    back_emf, stall = servo.back_emf, servo.stall_torque
    # Name: scale, start, lower and upper bound.
    table = {
        "kp": (float(robot.kp[joint]), 1.0, 0.1, 10.0),
        "back_emf": (back_emf, 1.0, 0.05, 10.0),
        "frictionloss": (max(servo.frictionloss, 0.002 * stall), 1.0, 0.0, 50.0),
        "damping": (back_emf, servo.damping / back_emf, -0.5, 5.0),
        "armature": (max(servo.armature, 1e-3 * stall), 1.0, 0.0, 20.0),
        "delay": (0.005, servo.delay / 0.005, -2.0, 12.0),
    }
    if effort:
        table[EFFORT] = (1.0, 1.0, 0.2, 5.0)
        table[PHASE] = (1.0, 0.0, -1.0, 1.0)
        table[AGE] = (1.0, 0.0, -1.0, 3.0)
    else:
        table.pop("damping")  # indistinguishable from back-EMF in the angle alone
    rows = np.array(list(table.values()))
    belief = np.full(len(rows), _WEAK)
    if effort:
        belief[-3:] = torque_constant_belief(), 1.0, 1.0
    return _Unknowns(tuple(table), rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], belief)
