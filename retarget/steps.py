"""`Step`: one footstep of the robot, when it is settled, and how steps are stored in a retargeter's state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.records import Record, column

Float = NDArray[np.float64]

NOTICE_S = 0.25
"""A step is settled this long before its foot lifts, and none is decided on shorter notice: the weight must move."""
UNHURRIED_S = 0.45
"""Notice of an inserted step, and of the first step from a stand, where the weight is at rest between the feet. An
inserted step is not urgent, and each new window of the human may decide differently about it: it must be settled before
the weight moves."""


@dataclass(frozen=True, eq=False)
class Bend:
    """What the path of a step lacked of the one before at the tick at which it was changed in the air.

    Attributes:
        tick: at which it was changed.
        offset: old path minus new path, (4,) [m, m, m, rad]; speed: of that, (4,) [m/s, rad/s].
    """

    tick: int = 0
    offset: Float = field(default_factory=lambda: np.zeros(4))
    speed: Float = field(default_factory=lambda: np.zeros(4))


@dataclass(frozen=True, eq=False)
class Step:
    """One footstep of the robot, in loop ticks.

    Attributes:
        side: foot that moves, 0 left, 1 right.
        lift, land: ticks of lift-off and touch-down.
        start, target: x, y, z, yaw of the sole centre, (4,) [m, m, m, rad].
        consumed_s: source time up to which the human swings of this foot are used up.
        dropped: number of human steps left out before this one.
        inserted: whether the robot corrects its feet by this step, without a step of the human.
        notice_s: how long before its lift the step is settled, so that no later plan delays it [s].
        human: position of the human's foot that the target represents, (2,) [m]; NaN where there is none.
        shift: how far the target has been moved to capture the robot, (2,) [m]; part of `target`.
        bend: how its path goes on from the one that the foot was on when the step was changed in the air.
    """

    side: int
    lift: int
    land: int
    start: Float
    target: Float
    consumed_s: float
    dropped: int = 0
    inserted: bool = False
    notice_s: float = NOTICE_S
    human: Float = field(default_factory=lambda: np.full(2, np.nan))
    shift: Float = field(default_factory=lambda: np.zeros(2))
    bend: Bend = field(default_factory=lambda: Bend())

    @property
    def stance(self) -> int:
        """The foot on the ground during the step."""
        return 1 - self.side

    def longer(self, ticks: int) -> Step:
        """Return this step with a swing that is longer by some ticks."""
        return replace(self, land=self.land + ticks) if ticks else self


def settled_from(steps: list[Step], rate_hz: float) -> Float:
    """Ticks from which steps, in order of time, are settled: no step later than the one after it, (steps,)."""
    own = np.array([step.lift - step.notice_s * rate_hz for step in steps])
    return np.minimum.accumulate(own[::-1])[::-1]


class StepRecord(Record):
    """A step as floats; fields as in `Step`. An unused row has -1 in all of them."""

    side: Float = column("f8")
    lift: Float = column("f8")
    land: Float = column("f8")
    start: Float = column("f8", 4)
    target: Float = column("f8", 4)
    consumed_s: Float = column("f8")
    inserted: Float = column("f8")
    notice_s: Float = column("f8")
    human: Float = column("f8", 2)
    shift: Float = column("f8", 2)
    bend: Float = column("f8", 9)
    """Tick, offset and speed of `Bend`."""

    def steps(self) -> list[Step]:
        """The steps of a row of records, in order, as copies; unused rows are left out. `dropped` is not stored."""
        return [self[row]._step() for row in np.flatnonzero(self.side >= 0)]

    def _step(self) -> Step:
        return Step(
            side=int(self.side),
            lift=int(self.lift),
            land=int(self.land),
            start=self.start.copy(),
            target=self.target.copy(),
            consumed_s=float(self.consumed_s),
            inserted=bool(self.inserted),
            notice_s=float(self.notice_s),
            human=self.human.copy(),
            shift=self.shift.copy(),
            bend=Bend(int(self.bend[0]), self.bend[1:5].copy(), self.bend[5:].copy()),
        )


def pack_steps(steps: Sequence[Step], rows: int | None = None) -> StepRecord:
    """Steps as records, a row each, followed by unused rows.

    Args:
        rows: number of rows; as many as steps where not given.

    Raises:
        ValueError: more steps than rows.
    """
    count = len(steps) if rows is None else rows
    if len(steps) > count:
        raise ValueError(f"{len(steps)} steps, expected at most {count}")
    dtype = StepRecord.dtype()
    packed = np.full((count, dtype.itemsize // 8), -1.0).view(dtype)[:, 0]
    for row, step in enumerate(steps):
        bend = np.concatenate([[step.bend.tick], step.bend.offset, step.bend.speed])
        packed[row] = tuple(bend if name == "bend" else getattr(step, name) for name in StepRecord.names())
    return StepRecord(packed)
