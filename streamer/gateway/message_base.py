"""`MessageBase`: the fields that every message between a program and a run has."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from flexmotion.configs.problems import Wording

VERSION: Literal[1] = 1

LONGEST_HOLD_S = 600.0
"""Longest time to live of a target [s]."""

Name = Annotated[
    str, StringConstraints(pattern=r"^[\w.:@/ -]{1,64}$"), Wording("letters, digits, blanks and _.:@/-, 64 at most")
]
"""A word that logs and pages can show: letters, digits and `_.:@/ -`, 64 at most."""


class MessageBase(BaseModel):
    """The fields of every message.

    Attributes:
        version: of the message set.
        id: the sender's own; the answer carries it.
        source: who sends, such as "page" or "joystick"; its priority is set in the stream settings, not here.
        sequence: number of the message among those of its source on its connection, over HTTP in all requests; one that
            does not ascend is refused.
        stamp_s: when it was sent, seconds since 1970 by the sender's clock. One that is older than its time to live has
            expired; so has one without `ttl_s` that is older than `take_up_s` of the stream settings, but for what
            brings the robot to rest. Without a stamp its age counts from its arrival.
        ttl_s: time to live [s]. A target ends after it: the robot comes to a stand. None: a velocity, and a part of
            the body, hold as long as the stream settings say, all others until the next target.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    version: Literal[1] = VERSION
    id: Name | None = None
    source: Name = "anonymous"
    sequence: Annotated[int, Field(ge=0, le=2**53)] | None = None
    stamp_s: Annotated[float, Field(ge=0.0, le=1e12)] | None = None
    ttl_s: Annotated[float, Field(gt=0.0, le=LONGEST_HOLD_S)] | None = None
