"""`Outcome`: how something that was asked of a run has ended."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.gateway.messages import Answer

LOOK_S = 0.1
"""Time between two looks at the status of a run [s]."""
_NEVER_BEGAN = ("superseded", "expired", "refused")

Ending = Literal["done", "time limit", "expired", "superseded", "stopped", "refused"]


class Outcome(BaseModel):
    """How something that was asked has ended.

    Attributes:
        end: done: by the robot's own measure. time limit: it took too long. expired: its time to live is over.
            superseded: another target came first. stopped: a stop, a fault or torque off came first; also words that
            the robot stands still for. refused: it never began.
        place: of a heading or a waypoint: where the robot stands in its odometry, x, y [m], heading [rad].
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    end: Ending
    place: tuple[float, float, float] | None = None

    @property
    def finished(self) -> bool:
        """Whether the robot has done what was asked, or for as long as was asked."""
        return self.end in ("done", "expired")


def outcome_of(answer: Answer, status: Mapping[str, Any]) -> Outcome | None:
    """How a target has ended by the status of its run; None: it has not yet.

    Args:
        answer: to the target.
        status: of the run, newer than the answer.

    Raises:
        GatewayError: the answer is to a target for a part of the body, or to no target: no status tells its end.
    """
    if answer.state in _NEVER_BEGAN:
        return Outcome(end=answer.state)
    if answer.target is None or answer.part is not None:
        what = answer.asked if answer.part is None else f"{answer.asked} ({answer.part})"
        raise GatewayError(f"{what}: no end is told of it; of targets for the whole body one is")
    followed = status.get("following")
    if followed is None:
        return Outcome(end="stopped")
    if followed["target"] != answer.target:
        return Outcome(end="superseded")
    return None if followed["end"] is None else Outcome(end=followed["end"], place=followed["place"])
