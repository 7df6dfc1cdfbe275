"""Whether a planner that does not run is noticed, whenever that happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from multiprocessing import Event
from typing import Any, cast

import pytest

from flexmotion.drivers.realtime.ring import Ring
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.planning.replanning import Replanner
from flexmotion.streamer.run import planner_guard
from flexmotion.streamer.run.planner_guard import MOST_RESTARTS, PlannerGuard
from flexmotion.streamer.run.requests import Request, RequestChannel, RequestReader
from tests.waiting import wait_until

Begin = Callable[..., tuple[PlannerGuard, RequestReader]]


class Starting:
    """A replanner whose start never ends."""

    def __init__(self, follows_targets: bool) -> None:
        self.follows_targets = follows_targets

    def succeed(self) -> None:
        """Another planner planned before."""

    def warm_up(self) -> None:
        """Wait for what never comes."""
        Event().wait()


@pytest.fixture
def begin() -> Iterator[Begin]:
    """Starts the planner's process; gives its guard and what the loop is told."""
    guards = []

    def begun(replanner: Starting) -> tuple[PlannerGuard, RequestReader]:
        to_loop = RequestChannel()
        told, ticks = to_loop.reader(), Ring(TickRow.dtype(joints=2), 8)
        guard = PlannerGuard(cast(Replanner, replanner), ticks, 125.0, RequestChannel(), to_loop, realtime=False)
        guards.append(guard)
        return guard, told

    yield begun
    for guard in guards:
        guard.end()


def checked(guard: PlannerGuard, told: RequestReader, count: int) -> list[tuple[Request, Any]]:
    """The first requests that the guard's checks send to the loop."""
    found: list[tuple[Request, Any]] = []

    def seen() -> bool:
        guard.check()
        found.extend(told.read())
        return len(found) >= count

    wait_until(seen, f"{count} requests to the loop")
    return found


def test_a_planner_that_hangs_as_it_starts_is_started_again_and_then_given_up(
    begin: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing told of a planner that never came as far as its first sign of life: no fault, no restart, ARM allowed."""
    monkeypatch.setattr(planner_guard, "_OPENING_S", 0.05)
    guard, told = begin(Starting(follows_targets=True))
    found = checked(guard, told, MOST_RESTARTS + 1)
    assert [kind for kind, _ in found] == [Request.LOST] * MOST_RESTARTS + [Request.GIVEN_UP]
    assert all("the planner did not begin to run within 0.05 s and was ended" in reason for _, reason in found)
    assert "started again (1 of 3)" in found[0][1]


def test_without_targets_a_planner_that_hangs_as_it_starts_is_given_up(
    begin: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planner_guard, "_OPENING_S", 0.05)
    guard, told = begin(Starting(follows_targets=False))
    ((kind, _),) = checked(guard, told, 1)
    assert kind is Request.GIVEN_UP


def test_a_planner_that_starts_slowly_is_waited_for(begin: Begin, monkeypatch: pytest.MonkeyPatch) -> None:
    """A start is judged by its own bound, not by those of a planner that runs."""
    monkeypatch.setattr(planner_guard, "_SILENT_S", 0.0)
    monkeypatch.setattr(planner_guard, "_HUNG_S", 0.0)
    guard, told = begin(Starting(follows_targets=True))
    guard.check()
    assert told.read() == []
