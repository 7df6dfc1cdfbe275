"""`Status`: what a run tells about itself over the network."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.gateway.desk import Desk
from flexmotion.streamer.gateway.health import WORKS, Health
from flexmotion.streamer.gateway.mirror_state import Mirrors

_OLD_S = 0.5
"""A loop whose newest row is older does not run [s]."""


class Followed(BaseModel):
    """The newest target that was accepted, and who asked for it.

    Attributes:
        end: how its last step ended ("done", "time limit", …), or "expired" after its time to live; None: it goes on,
            or has no end.
        place: of a heading or a waypoint that has ended: where the robot stands in its odometry, x, y, heading.
    """

    source: str
    asked: dict[str, Any]
    heard_as: str | None
    slowed: str | None
    target: int | None
    tick: int | None
    end: str | None = None
    place: tuple[float, float, float] | None = None


class Holds(BaseModel):
    """A target for a part of the body, or a restriction, that holds beside what the whole body does.

    Attributes:
        target: its number; asked: what for.
        source: who sent it; null if a script did, or if it was sent to an earlier gateway.
        parts: arm, head, foot or joint that is at a place of its own, or what is restricted: names that `relax` takes.
        restricts: it is a restriction, and moves nothing.
        there: of a part, once it is there: how far it is from its place as measured, in words.
        missed: of a part that was not there in time: likewise.
        slowed, moved: as in its answer.
    """

    target: int
    source: str | None
    asked: str
    parts: tuple[str, ...]
    restricts: bool
    there: str | None
    missed: str | None
    slowed: str | None
    moved: str | None


class Status(BaseModel):
    """The run now. Times in seconds, angles in radians, temperatures in °C; null where unknown.

    Attributes:
        loop: "ticks", or "silent" where it has not for half a second.
        state: of the safety ladder.
        cause: why the state is not one that follows targets, in the loop's words: the first fault, and behind it the
            newest one that changed no state, such as torque off that is not confirmed.
        gets_up_from: the side, `front` or `back`, that the robot lies on without torque and from which it gets up on
            request (`clear` with `get_up`); null where it does not lie, or does not get up.
        ready: in READY: the robot has stood up, and waits for its first target.
        must_stop: a stop is in force: no target is followed.
        time_s: of the robot, since the first tick.
        tilt: roll and pitch of the torso.
        limp: joints whose torque an operator has switched off by themselves.
        place: estimated x and y of the centre of mass in the plan's world [m].
        odometry: x, y [m] and heading [rad] since the robot stood up, as headings and waypoints are meant.
        hottest, coldest supply: greatest temperature of a servo, least supply voltage [V].
        target: number of the newest target that the robot follows; 0: none yet.
        following: the newest target that came over the gateway and was accepted; null after a stop, without torque, and
            where the robot stands still for words that it does not understand.
        mirrors: of a run that mirrors: "a person"; "nobody", since nobody is seen; "not yet", of a person who is seen
            and not followed; "waits", after a stop or a stand, for the text "mirror". null in other runs.
        holding: what holds beside it, in order of the targets' numbers.
        operator: who holds the lease.
        counts: of messages, by what became of them.
        stop_port: of the process that takes stops alone.
        bus: "works", or how long no servo has answered.
        ways: of each way for targets and for stops beside HTTP: "works", or why it does not.
    """

    model_config = ConfigDict(extra="forbid")

    type: Literal["status"] = "status"
    version: Literal[1] = 1
    robot: str
    driver: str
    loop: Literal["ticks", "silent"]
    state: str | None = None
    cause: str | None = None
    gets_up_from: str | None = None
    ready: bool | None = None
    must_stop: bool | None = None
    limp: tuple[str, ...] = ()
    tick: int | None = None
    time_s: float | None = None
    tilt: tuple[float, float] | None = None
    place: tuple[float, float] | None = None
    odometry: tuple[float, float, float] | None = None
    hottest: float | None = None
    supply: float | None = None
    missed_deadlines: int | None = None
    target: int | None = None
    following: Followed | None = None
    mirrors: Mirrors | None = None
    holding: tuple[Holds, ...] = ()
    operator: str | None = None
    counts: dict[str, int] = {}
    stop_port: int | None = None
    bus: str | None = None
    ways: dict[str, str] = {}

    @property
    def well(self) -> bool:
        """Whether the loop ticks, the bus answers and every way works."""
        return self.loop == "ticks" and self.bus == WORKS and all(state == WORKS for state in self.ways.values())


def status_of(
    desk: Desk,
    robot: str,
    driver: str,
    rate_hz: float,
    stop_port: int | None,
    health: Health | None = None,
    joints: Sequence[str] = (),
    gets_up_from: Callable[[TickRow], str | None] = lambda _row: None,
    silence: Callable[[TickRow], str | None] = lambda _row: None,
) -> Status:
    """The status from the loop's newest row and the gateway's own record.

    Args:
        joints: names of the robot's.
        gets_up_from: gives the field of this name, from the loop's newest row.
        silence: gives how long the bus has been silent, from it; None while it works.
    """
    known: dict[str, Any] = {"robot": robot, "driver": driver, "operator": desk.lease.holder, "stop_port": stop_port}
    known["counts"] = dict(sorted(desk.counts.items()))
    known["ways"] = {} if health is None else health.problems()
    followed = desk.following
    if followed is not None:
        answer, last = followed.answer, followed.last
        known["following"] = Followed(
            source=followed.source,
            asked=followed.asked,
            heard_as=answer.heard_as,
            slowed=answer.slowed,
            target=answer.target,
            tick=answer.tick,
            end=followed.end,
            place=None if last is None else last.place,
        )
    known["holding"] = tuple(
        Holds(
            target=one.id,
            source=desk.sources.get(one.id),
            asked=one.asked,
            parts=tuple(str(one.heard_as).split(", ")),
            restricts=one.holds == "restriction",
            there=one.there,
            missed=one.missed,
            slowed=one.slowed,
            moved=one.moved,
        )
        for one in desk.holding
    )
    row = desk.row()
    if desk.mirror is not None:
        known["mirrors"] = desk.mirror.mirrors(row, time.perf_counter())
    if row is None:
        return Status(loop="silent", **known)
    age_s = (time.perf_counter_ns() - int(row.stamp_ns)) * 1e-9
    return Status(
        loop="ticks" if age_s < _OLD_S else "silent",
        state=State(int(row.state)).name,
        cause=desk.cause.text,
        gets_up_from=gets_up_from(row),
        ready=bool(row.ready),
        must_stop=bool(row.must_stop),
        limp=tuple(name for name, limp in zip(joints, row.limp, strict=False) if limp),
        tick=int(row.tick),
        time_s=round(int(row.tick) / rate_hz, 3),
        tilt=_pair(row.tilt),
        place=_pair(row.com),
        odometry=_rounded(row.odometry),
        hottest=_extreme(row.temperature, np.max),
        supply=_extreme(row.voltage, np.min),
        missed_deadlines=int(row.missed_deadlines),
        target=int(row.target),
        bus=silence(row) or WORKS,
        **known,
    )


def _pair(values: np.ndarray) -> tuple[float, float] | None:
    return (round(float(values[0]), 4), round(float(values[1]), 4)) if np.isfinite(values).all() else None


def _rounded(values: np.ndarray) -> tuple[float, float, float] | None:
    x, y, heading = (round(float(value), 4) for value in values)
    return (x, y, heading) if np.isfinite(values).all() else None


def _extreme(values: np.ndarray, of: Any) -> float | None:
    known = values[np.isfinite(values)]
    return round(float(of(known)), 2) if len(known) else None
