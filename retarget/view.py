"""`HumanView`: the human that a plan follows, on the clock of the control loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.retarget.footholds import Scaling
from flexmotion.retarget.human import HumanWindow
from flexmotion.retarget.state import RetargetState

Float = NDArray[np.float64]


@dataclass(frozen=True)
class HumanView:
    """The frames of the human that a plan follows.

    Attributes:
        window: features of the frames.
        scaling: human to robot.
        source_tick: loop tick of source time 0.
        rate_hz: loop ticks a second.
        tick: first tick of the plan.
        follow: number of rows that follow the human, at least 1; the rest of the plan is its stop tail.
        whole: whether the frames reach to the horizon, so that the human may continue after them.
        exact: whether the feet turn to where the human looks by small steps too.
    """

    window: HumanWindow
    scaling: Scaling
    source_tick: float
    rate_hz: float
    tick: int
    follow: int
    whole: bool
    exact: bool = False

    @property
    def end_tick(self) -> int:
        """First tick of the stop tail."""
        return self.tick + self.follow

    @property
    def first_frame(self) -> int:
        """Index of the first frame on the source's own clock."""
        return round(float(self.window.times[0]) * self.window.motion.fps)

    def seconds(self, ticks: Float) -> Float:
        """Source time of loop ticks [s]."""
        return (ticks - self.source_tick) / self.rate_hz

    def second_at(self, tick: float) -> float:
        """Source time of a loop tick [s]."""
        return float((tick - self.source_tick) / self.rate_hz)

    def tick_at(self, second: float) -> int:
        """Loop tick nearest to a source time [s]."""
        return int(self.source_tick) + int(round(second * self.rate_hz))


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
        exact: see `HumanView`.

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
    state.human_feet[...] = np.where(np.isnan(state.human_feet), window.feet[0, :, :2], state.human_feet)
    source_tick = float(state.source_tick)
    follow = min(max(int(np.floor(source_tick + window.end_s * rate_hz + 1e-6)) + 1 - tick, 0), horizon)
    if not follow:
        return None
    scaling = Scaling(
        ratio=leg_length / motion.body.leg,
        heading=float(state.heading),
        human_width=motion.body.segments.hip_width,
    )
    return HumanView(window, scaling, source_tick, rate_hz, tick, follow, whole=follow == horizon, exact=exact)


def forget_human(state: RetargetState) -> None:
    """Let the feet represent none of the human's, for a stop: the next human may be somewhere else."""
    state.human_feet[...] = state.steps.human[...] = np.nan


def begin_human(state: RetargetState) -> None:
    """Let the next human be another one, whose time begins anew: for a robot that stands."""
    forget_human(state)
    state.source_tick[...] = state.heading[...] = state.yaws[...] = np.nan
    state.consumed[...] = -np.inf
    state.detector[...] = ContactDetector().initial()
