"""When a pose of a mirrored person calls for a plan."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.planning.mirroring import Mirroring

RATE = 1000.0


class Person:
    """A source of which only the times count: frames come every `between_s`, each is seen `delay_s` later."""

    wanted, resting = False, False

    def __init__(self, between_s: float, delay_s: float = 0.0) -> None:
        self.between_s, self.delay_s, self.newest_s = between_s, delay_s, -math.inf
        self.ended_s = math.inf

    def update(self, now_s: float) -> None:
        count = math.floor((min(now_s, self.ended_s) - self.delay_s) / self.between_s + 1e-9)
        self.newest_s = count * self.between_s if count >= 0 else -math.inf


def follow(person: Person, plan_s: float, seconds: float) -> list[tuple[float, float]]:
    """When plans are begun that each take `plan_s`, and the age of the pose that they follow [s]."""
    mirroring = Mirroring(cast(MirrorSource, person), RATE, lockstep=True)
    begun, tick = [], 0
    while tick < seconds * RATE:
        mirroring.update(tick)
        if mirroring.fresh:
            begun.append((tick / RATE, tick / RATE - person.newest_s))
            mirroring.planned()
            tick += round(plan_s * RATE)
        else:
            tick += 1
    return begun


def test_a_plan_that_takes_longer_than_a_pose_begins_with_one_that_has_just_come() -> None:
    """Plans of 50 ms began wherever the one before had ended: their pose was up to 33 ms old, 17 ms in the mean."""
    ages = [age for begin, age in follow(Person(1 / 30, delay_s=0.01), 0.05, 4.0) if begin > 1.0]
    assert max(ages) < 0.01 + 0.5 / 30
    assert sum(ages) / len(ages) < 0.01 + 0.2 / 30


def test_every_pose_gets_a_plan_where_there_is_time_for_it() -> None:
    begun = follow(Person(1 / 30, delay_s=0.01), 0.02, 4.0)
    assert len(begun) == pytest.approx(4.0 * 30, abs=2)


def test_a_pose_that_does_not_come_is_not_waited_for_any_longer() -> None:
    person = Person(1 / 30)
    person.ended_s = 2.0
    last = follow(person, 0.045, 4.0)[-1]
    assert last[0] < 2.0 + 0.045 + 1.25 / 30  # the last pose was planned for, though none came after it


def test_before_the_rate_of_the_frames_is_known_nothing_is_waited_for() -> None:
    person = Person(1 / 30)
    mirroring = Mirroring(cast(MirrorSource, person), RATE, lockstep=True)
    mirroring.update(60)
    person.between_s = math.nan
    assert mirroring.fresh


@given(st.floats(1 / 120, 1 / 20), st.floats(0.005, 0.2), st.floats(0.0, 0.03))
def test_plans_go_on_however_often_frames_come(between_s: float, plan_s: float, delay_s: float) -> None:
    begun = [begin for begin, _ in follow(Person(between_s, delay_s), plan_s, 3.0)]
    waits = [later - begin - plan_s for begin, later in pairwise(begun)]
    assert max(waits) <= between_s + 2 / RATE
