"""A robot that goes straight does not wander as its human does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.planning.straight_heading import FASTEST, MOST, StraightHeading

STEP_S = 0.1


@dataclass
class Ahead:
    """A human that looks aside by an angle."""

    aside: float | None

    def heading(self, after_s: float) -> float | None:
        """See `HumanAhead.heading`."""
        return self.aside


SLOWLY, FAST = (6.0, 20.0), (20.0, 8.0)
"""How far [degrees] and how often [s] a human that steps aside looks to each side: mostly, and at times."""


def wander(time_s: float, how: tuple[float, float]) -> float:
    """Where such a human looks [rad]."""
    return math.radians(how[0]) * math.sin(2 * math.pi * time_s / how[1])


def looks(
    seconds: float = 60.0, late_s: float = 0.6, turned: float = 0.0, how: tuple[float, float] = SLOWLY
) -> list[float]:
    """Heading of a robot that takes its human's heading, less what is taken off, so much later [rad]."""
    straight, off, facing = StraightHeading(0.0, 0.0), [0.0] * (round(late_s / STEP_S) + 1), [0.0]
    for number in range(1, round(seconds / STEP_S) + 1):
        time_s = number * STEP_S
        straight.update(facing[-1], time_s, Ahead(wander(time_s + late_s, how)))
        off.append(straight.aside)
        facing.append(wander(time_s, how) + turned - off[-round(late_s / STEP_S) - 1])
    return facing


def test_a_human_that_wanders_is_followed_straight() -> None:
    """A robot that took its human's heading looked up to 7° aside of where it was to go."""
    assert max(map(abs, looks()[50:])) < math.radians(1.0)


def test_a_human_that_looks_far_aside_at_once_is_followed_straight_too() -> None:
    """One of 12 robots that stepped aside looked 7° (mean of 5 s) aside at the end, and 29° for a moment."""
    assert max(map(abs, looks(how=FAST)[50:])) < math.radians(8.0)  # of 20


@pytest.mark.parametrize("turned", [-0.08, 0.08])
def test_what_the_robot_itself_looks_aside_is_taken_off_too(turned: float) -> None:
    assert max(map(abs, looks(turned=turned)[400:])) < math.radians(1.5)


def test_another_velocity_goes_on_from_what_is_taken_off() -> None:
    straight = StraightHeading(0.4, 10.0, aside=0.05)
    straight.update(0.4, 10.2, Ahead(1.3))
    assert straight.aside == pytest.approx(0.05)


def test_frames_that_are_not_known_change_nothing() -> None:
    straight = StraightHeading(0.0, 0.0)
    straight.update(0.3, 1.0, Ahead(None))
    assert straight.aside == 0.0


@given(headings=st.lists(st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)), min_size=1, max_size=60))
def test_whatever_robot_and_human_do_little_is_taken_off_and_slowly(headings: list[tuple[float, float]]) -> None:
    straight, before = StraightHeading(0.0, 0.0), 0.0
    for number, (facing, human) in enumerate(headings):
        straight.update(facing, (number + 1) * 0.25, Ahead(human))
        assert abs(straight.aside) <= MOST + 1e-9 and abs(straight.aside - before) <= FASTEST * 0.25 + 1e-9
        before = straight.aside
