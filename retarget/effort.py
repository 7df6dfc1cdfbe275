"""The effort of a plan: how much of its servos' envelope its inverse dynamics need, where it can still be changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.envelope import Envelope
from flexmotion.retarget.steps import Step

Float = NDArray[np.float64]

REACTION_S = 0.1
"""Arms and trunk go on as before for this long: their filters answer no faster [s]."""
SETTLING_S = 0.08
"""A leg's torque is still that of its last step for this long after a touch-down [s]."""


@dataclass(frozen=True)
class Effort:
    """The hardest moment of the rows of a plan that can still be changed.

    Attributes:
        load: share of the envelope, 1 on its border; 0 where no row can be changed.
        joint: column of the joint.
        row: row of the plan.
        torque, limit: there [N·m].
        cap: the torque cap of this joint, where that is what binds most [N·m]; None: the servo's envelope does.
        may_wait: whether it is that of an arm or the head of a robot that makes no step, which may take any time.
    """

    load: float
    joint: int = 0
    row: int = 0
    torque: float = 0.0
    limit: float = 0.0
    cap: float | None = None
    may_wait: bool = False


@dataclass(frozen=True)
class Judged:
    """What plans are judged by.

    Attributes:
        envelope: of the servos; None: torque caps alone count.
        allowed: greatest load.
        legs: columns of the leg joints.
    """

    envelope: Envelope | None
    allowed: float
    legs: NDArray[np.int64]


def effort(
    judged: Judged, torque: Float, speed: Float, begins: tuple[int, int], ends: int, cap: Float | None = None
) -> Effort:
    """The hardest moment of a plan.

    Args:
        torque, speed: of the plan, (T, n) [N·m, rad/s].
        begins: first row that counts at all, and first one of the legs, not before it; see `changeable`.
        ends: row after the last one that counts.
        cap: greatest torque of each joint, at which its load is the allowed one, (n,) [N·m]; infinite, or None: none.
    """
    envelope, limit = judged.envelope, np.full(torque.shape[1], np.inf) if cap is None else cap
    capped = judged.allowed * np.abs(torque[:ends]) / limit
    load = capped if envelope is None else np.maximum(envelope.load(torque[:ends], speed[:ends]), capped)
    load[: begins[0]] = 0.0
    load[: begins[1], judged.legs] = 0.0
    if not load.size:
        return Effort(0.0)
    row, joint = (int(place) for place in np.unravel_index(int(np.argmax(load)), load.shape))
    binds = load[row, joint] > 0.0 and load[row, joint] == capped[row, joint]
    most = limit[joint] if binds or envelope is None else envelope.limit(torque[row], speed[row])[joint]
    return Effort(
        load=float(load[row, joint]),
        joint=joint,
        row=row,
        torque=abs(float(torque[row, joint])),
        limit=float(most),
        cap=float(limit[joint]) if binds else None,
    )


def changeable(settled: list[Step], tick: int, rate_hz: float) -> tuple[int, int]:
    """First rows of a plan from `tick` on that another draft could change: of arms and head, and of legs.

    Steps that an earlier plan has settled are carried out as they are.
    """
    arms = round(REACTION_S * rate_hz)
    landed = max((step.land - tick + round(SETTLING_S * rate_hz) for step in settled), default=0)
    return arms, max(arms, int(landed))
