"""`retarget_offline`: the plans that a run would play, one after another, without robot or clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import StreamSettings
from flexmotion.retarget.human_steps import count_steps
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.motion.sources import Performance
from flexmotion.streamer.planning.planner import Planner

Float = NDArray[np.float64]

LONGEST_S = 1800.0
"""Longest motion that is retargeted [s]; the result takes about 1 MB of memory a second."""


@dataclass(frozen=True)
class Trajectory:
    """The planned motion, one row a tick of `rate_hz`; fields as in `flexmotion.retarget.plan.Plan`.

    Attributes:
        human_steps: steps that the human makes.
        steps, inserted, dropped: footsteps planned, those inserted by the robot, and human steps left out.
        repairs: counts by kind.
        retarget_s: time that each plan took [s].
    """

    rate_hz: float
    source_s: Float
    q: Float
    qd: Float
    qdd: Float
    torque: Float
    contacts: NDArray[np.bool_]
    feet: Float
    base: Float
    com: Float
    zmp: Float
    dcm: Float
    hand_error: Float
    human_steps: int
    steps: int
    inserted: int
    dropped: int
    repairs: dict[str, int]
    retarget_s: list[float]

    def __len__(self) -> int:
        return len(self.q)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return len(self) / self.rate_hz


_ROWS = ("source_s", "q", "qd", "qdd", "torque", "contacts", "feet", "base", "com", "zmp", "dcm", "hand_error")


def retarget_offline(
    robot: Robot,
    source: Performance,
    settings: StreamSettings,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Plan all of a source at the cadence of a live run: each plan is played until the next joins, the last to its end.

    Args:
        source: has an end.
        progress: called with the share done, in [0, 1].

    Raises:
        ConfigError: the source is longer than `LONGEST_S` or has no end.
    """
    if source.seconds is None or source.seconds > LONGEST_S:
        length = "has no end" if source.seconds is None else f"is {source.seconds:g} s long"
        raise ConfigError(f"{source.name}: {length}, expected {LONGEST_S:g} s at most")
    planner = Planner(Retargeter(robot, settings), source, settings)
    cadence = max(round(settings.replan_s * robot.rate_hz), 1)
    played: list[tuple[Plan, int]] = []
    times: list[float] = []
    join, plan = 0, None
    over = False
    while not over:
        planned = planner.plan(join, plan)
        over = planned.source_over
        plan = planned.plan
        rows = len(plan) if over else min(cadence, len(plan))
        played.append((plan, rows))
        times.append(planned.retarget_s)
        join += rows
        if progress is not None:
            progress(min(join / robot.rate_hz / max(source.seconds, 1e-9), 1.0))
    made = [step for plan, rows in played for step in plan.steps if step.lift < plan.start_tick + rows]
    arrays = {name: np.concatenate([getattr(plan, name)[:rows] for plan, rows in played]) for name in _ROWS}
    return Trajectory(
        rate_hz=robot.rate_hz,
        **arrays,
        human_steps=count_steps(source.human()),
        steps=len(made),
        inserted=sum(step.inserted for step in made),
        dropped=sum(step.dropped for step in made),
        repairs={
            kind: int(sum(plan.repairs[kind][:rows].sum() for plan, rows in played)) for kind in played[0][0].repairs
        },
        retarget_s=times,
    )
