"""`HumanView`: the human that a plan follows, on the clock of the control loop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.retarget.easing import WHOLE, Ease
from flexmotion.retarget.footholds import Scaling
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.state import RetargetState

Float = NDArray[np.float64]

_MOST_TURNED = 0.26
"""Turn of the human's feet beyond those of a robot that stays in its place, which is not the robot's [rad]."""
_MOST_DRIFT = 0.2
"""Most that a robot drifts from its plan's heading between two plans [rad]."""


@dataclass(frozen=True)
class HumanView:
    """The frames of the human that a plan follows.

    Attributes:
        window: features of the frames.
        scaling: human to robot, of steps: smaller where they are eased.
        source_tick: loop tick of source time 0, had the human always gone at its own pace.
        rate_hz: loop ticks a second.
        tick: first tick of the plan.
        follow: number of rows that follow the human, at least 1; the rest of the plan is its stop tail.
        whole: whether the frames reach to the horizon, so that the human may continue after them.
        exact: whether the feet turn to where the human looks by small steps too.
        ease: how much of the human's motion is followed; its pace is that of the human's clock in this plan.
    """

    window: HumanWindow
    scaling: Scaling
    source_tick: float
    rate_hz: float
    tick: int
    follow: int
    whole: bool
    exact: bool = False
    ease: Ease = WHOLE

    @property
    def end_tick(self) -> int:
        """First tick of the stop tail."""
        return self.tick + self.follow

    @property
    def first_frame(self) -> int:
        """Index of the first frame on the source's own clock."""
        return round(float(self.window.times[0]) * self.window.motion.fps)

    @property
    def body_scaling(self) -> Scaling:
        """Human to robot, of the body's own size: not eased."""
        return replace(self.scaling, ratio=self.scaling.ratio / self.ease.size)

    def seconds(self, ticks: Float) -> Float:
        """Source time of loop ticks [s]."""
        if self.ease.pace == 1.0:  # to the last digit as in the plans before
            return (ticks - self.source_tick) / self.rate_hz
        return self._start_s + (ticks - self.tick) * (self.ease.pace / self.rate_hz)

    def second_at(self, tick: float) -> float:
        """Source time of a loop tick [s]."""
        return float(self.seconds(np.array(tick, dtype=float)))

    def ticks_at(self, seconds: Float) -> Float:
        """Loop ticks at source times [s], not rounded."""
        if self.ease.pace == 1.0:
            return self.source_tick + seconds * self.rate_hz
        return self.tick + (seconds - self._start_s) * (self.rate_hz / self.ease.pace)

    def tick_at(self, second: float) -> int:
        """Loop tick nearest to a source time [s]."""
        if self.ease.pace == 1.0 and float(self.source_tick).is_integer():
            # Plans that see an event again at another place of theirs round it alike.
            return int(self.source_tick) + int(round(second * self.rate_hz))
        return int(round(float(self.ticks_at(np.array(second)))))

    @cached_property
    def _start_s(self) -> float:
        """Source time of the plan's first tick [s]."""
        return (self.tick - self.source_tick) / self.rate_hz


def view_human(
    state: RetargetState,
    motion: Motion | None,
    first_frame: int,
    tick: int,
    *,
    horizon: int,
    lead_in_s: float,
    leg_length: float,
    rate_hz: float,
    exact: bool = False,
    ease: Ease = WHOLE,
) -> HumanView | None:
    """Read the frames that a plan is given.

    Args:
        state: where the plan resumes. It is updated: the first frames set its clock and heading, and feet
            that represent none of the human's represent this human's from here on.
        motion: frames from source frame `first_frame` on.
        tick: first tick of the plan.
        horizon: most rows that may follow the human.
        lead_in_s: time from the first plan's start to source time 0 [s].
        leg_length: of the robot [m].
        rate_hz: loop ticks a second.
        exact, ease: see `HumanView`.

    Returns:
        None where no row of the plan can follow the human.
    """
    if motion is None or len(motion) < 2:
        return None
    first = bool(np.isnan(state.source_tick))
    start_s = first_frame / motion.fps
    window = HumanWindow(motion, start_s, state.detector, None if first else state.yaws.copy())
    if first:
        state.source_tick[...] = tick + round((lead_in_s - start_s) * rate_hz)
        state.heading[...] = state.feet[:, 3].mean() - window.yaws[0, 2]
        state.yaws[...] = window.yaws[0]
        state.consumed[...] = window.times[0]
    if (state.planted > 0).any():
        _stand_in_place(state, window)
    state.human_feet[...] = np.where(np.isnan(state.human_feet), window.feet[0, :, :2], state.human_feet)
    source_tick = float(state.source_tick)
    rows = (source_tick + window.end_s * rate_hz - tick) / ease.pace
    follow = min(max(int(np.floor(rows + 1e-6)) + 1, 0), horizon)
    if not follow:
        return None
    scaling = Scaling(
        ratio=ease.size * leg_length / motion.body.leg,
        heading=float(state.heading),
        human_width=motion.body.segments.hip_width,
    )
    return HumanView(
        window, scaling, source_tick, rate_hz, tick, follow, whole=follow == horizon, exact=exact, ease=ease
    )


def _stand_in_place(state: RetargetState, window: HumanWindow) -> None:
    """Let the feet of a robot that stays where it is represent the human's wherever those have gone, and turned to."""
    state.human_feet[...] = np.nan
    turned = float(state.heading) + window.yaws[0, :2].mean() - state.feet[:, 3].mean()
    if abs(turned) > _MOST_TURNED:
        state.heading[...] -= turned


def forget_human(state: RetargetState) -> None:
    """Let the feet represent none of the human's, for a stop: the next human may be somewhere else."""
    state.human_feet[...] = state.steps.human[...] = np.nan


def follow_drift(state: RetargetState, drift: float) -> None:
    """Let the robot turn back by what it has turned beyond its plans since the plan before: its heading is the human's.

    A robot that has been turned by much at once, as by hands, goes on from there.

    Args:
        state: where a plan resumes; it is updated.
        drift: turn of the robot beyond its plans, up to a constant [rad]; NaN: not known.
    """
    if np.isnan(drift):
        return
    turned = drift - float(state.drift)
    if abs(turned) < _MOST_DRIFT:
        state.heading[...] -= turned
    state.drift[...] = drift


def begin_human(state: RetargetState) -> None:
    """Let the next human be another one, whose time begins anew: for a robot that stands."""
    forget_human(state)
    state.source_tick[...] = state.heading[...] = state.yaws[...] = state.drift[...] = np.nan
    state.consumed[...] = -np.inf
    state.detector[...] = ContactDetector().initial()
