"""`RunTotals`: what is known of rows that a record no longer keeps, in memory of fixed size."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexmotion.spatial.tilt import falls, lean_of
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow

Float = NDArray[np.float64]
TorqueSource = Literal["simulation", "servos"]
"""Where torques come from: the simulation's true state, or the servos' own measurement (of current)."""

FALL_TILT_RAD = np.deg2rad(45.0)
"""A robot that is to be upright, and whose torso is tilted further than this, has fallen."""

TIMES = (
    *("work_s", "lateness_s", "robot_lateness_s"),
    *("sample_s", "retarget_s", "target_to_command_s", "target_to_effect_s"),
)
"""Times of a tick, or of a plan (`sample_s`, `retarget_s`)."""
OF_PLANS = ("sample_s", "retarget_s")


class Times:
    """Times as a histogram: percentiles are known to 1 %, the greatest exactly."""

    _EDGES = np.concatenate([[-np.inf], np.geomspace(1e-7, 1e3, 2315)])  # [s]
    _MIDDLES = np.concatenate([[0.0], np.sqrt(_EDGES[1:-1] * _EDGES[2:]), [_EDGES[-1]]])

    def __init__(self) -> None:
        self._counts = np.zeros(len(self._EDGES), np.int64)
        self._most = -np.inf

    def add(self, seconds: Float) -> None:
        """Count times, (k,) [s]; those that are not finite are left out."""
        seconds = seconds[np.isfinite(seconds)]
        if len(seconds):
            bins = np.searchsorted(self._EDGES, seconds, side="right") - 1
            self._counts += np.bincount(bins, minlength=len(self._counts))
            self._most = max(self._most, float(seconds.max()))

    def with_(self, seconds: Float) -> Times:
        """These and further times."""
        both = Times()
        both._counts, both._most = self._counts.copy(), self._most
        both.add(seconds)
        return both

    @property
    def count(self) -> int:
        """How many times were counted."""
        return int(self._counts.sum())

    @property
    def most(self) -> float:
        """The greatest one [s]."""
        return self._most

    def percentile(self, percent: float) -> float:
        """A percentile [s]; NaN without any time."""
        if not self.count:
            return float("nan")
        place = np.searchsorted(np.cumsum(self._counts), percent / 100.0 * self.count, side="left")
        return min(float(self._MIDDLES[place]), self._most)


@dataclass
class JointSums:
    """Sums over the ticks with goals sent, for each of n joints.

    Attributes:
        known: ticks with a torque, (n,).
        torque_squares: sum of their squares, (n,) [N²·m²].
        peak_torque, peak_speed: greatest amounts, (n,) [N·m, rad/s]; -inf: unknown.
        powered: ticks with goals sent.
        saturated: sum of the shares of time at a limit over these, (n,); NaN: unknown.
    """

    known: NDArray[np.int64]
    torque_squares: Float
    peak_torque: Float
    peak_speed: Float
    powered: int
    saturated: Float

    @classmethod
    def of(cls, ticks: TickRow, torque: Float) -> JointSums:
        """Of rows, (k,), and their torques, (k, n) [N·m]."""
        powered = np.isfinite(ticks.q_cmd).all(axis=1)
        torque, speed = torque[powered], ticks.qd[powered]
        return cls(
            np.isfinite(torque).sum(axis=0),
            np.nansum(torque**2, axis=0),
            np.max(np.abs(torque), axis=0, initial=-np.inf, where=np.isfinite(torque)),
            np.max(np.abs(speed), axis=0, initial=-np.inf, where=np.isfinite(speed)),
            int(powered.sum()),
            ticks.true_saturated[powered].sum(axis=0),
        )

    def __add__(self, other: JointSums) -> JointSums:
        return JointSums(
            self.known + other.known,
            self.torque_squares + other.torque_squares,
            np.maximum(self.peak_torque, other.peak_torque),
            np.maximum(self.peak_speed, other.peak_speed),
            self.powered + other.powered,
            self.saturated + other.saturated,
        )


@dataclass
class RunTotals:
    """Of the rows that were dropped.

    Attributes:
        plans: that were played and began in these rows.
        times: by field of the row.
        joints: None before the first row.
        torque_source: of the first rows with torques.
        streamed: whether a plan was played.
        fall_tick: first tick with a tilt of a fall, or in which the loop found one; None: none.
        laid_down: whether a robot without torque in the next row has been parked before.
    """

    plans: int = 0
    times: dict[str, Times] = field(default_factory=lambda: {name: Times() for name in TIMES})
    joints: JointSums | None = None
    torque_source: TorqueSource | None = None
    streamed: bool = False
    fall_tick: int | None = None
    last_plan: int = 0
    laid_down: bool = True

    def fold(self, ticks: TickRow) -> None:
        """Add rows, (k,), in order."""
        first = self.first_of_plans(ticks)
        self.plans += len(first)
        self.last_plan = max(self.last_plan, int(ticks.plan.max(initial=0)))
        for name, times in self.times.items():
            values = getattr(ticks, name)
            times.add(values[first] if name in OF_PLANS else values)
        source = torque_source(ticks)
        self.torque_source = self.torque_source or source
        sums = JointSums.of(ticks, torques(ticks, source))
        self.joints = sums if self.joints is None else self.joints + sums
        self.streamed = self.streamed or bool((ticks.state == State.STREAMING).any())
        if self.fall_tick is None:
            tilted = toppled(ticks.true_base, ticks.base_ref)
            fallen = np.flatnonzero(
                (tilted & ~laid_down(ticks.state, before=self.laid_down)) | (ticks.state == State.DAMPED)
            )
            self.fall_tick = int(ticks.tick[fallen[0]]) if len(fallen) else None
        if len(ticks.state):
            self.laid_down = bool(laid_down(ticks.state, before=self.laid_down)[-1]) or ticks.state[-1] == State.PARK

    def first_of_plans(self, ticks: TickRow) -> NDArray[np.int64]:
        """Rows at which plans begin that were not played before; their ids ascend."""
        plans, first = np.unique(ticks.plan, return_index=True)
        return np.asarray(first[plans > self.last_plan])


def toppled(base: Float, planned: Float) -> NDArray[np.bool_]:
    """Ticks in which a torso is tilted as no torso is that stands, or bows as planned.

    Args:
        base: position and quaternion w x y z, (k, 7); one that is unknown (NaN) has not toppled.
        planned: likewise; one that is unknown is upright.
    """
    return falls(lean_of(base[:, 3:]), lean_of(planned[:, 3:]), FALL_TILT_RAD)


def laid_down(states: NDArray[np.integer], *, before: bool = True) -> NDArray[np.bool_]:
    """Ticks in which a robot has no torque because it was parked, or has not stood up yet; it may lie then.

    Args:
        states: of the ladder, (k,).
        before: whether a robot without torque in the first tick was parked before.
    """
    off = np.isin(states, (State.OFF, State.FAULT))
    last = np.maximum.accumulate(np.where(off, -1, np.arange(len(states))))
    parked: NDArray[np.bool_] = off & np.where(last < 0, before, states[last] == State.PARK)
    return parked


def torque_source(ticks: TickRow) -> TorqueSource | None:
    """Where the torques of rows come from; None where they are unknown."""
    if np.isfinite(ticks.true_torque).any():
        return "simulation"
    return "servos" if np.isfinite(ticks.effort).any() else None


def torques(ticks: TickRow, source: TorqueSource | None) -> Float:
    """Torques of the servos according to their source, (k, n) [N·m]; NaN where unknown."""
    if source == "servos":
        return np.where(ticks.stale > 0, np.nan, ticks.effort)
    return ticks.true_torque
