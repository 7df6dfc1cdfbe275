"""A velocity is kept by the robot's way, within bounds, and whatever the robot does."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.sampling.pace import Pace
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.planning.way_keeper import WayKeeper

SCALE, STEP_S, LATE_S = 4.0, 0.1, 3.0
PACE = Pace(ahead=0.9, back=0.45, aside=0.18, turning=0.7)

Does = Callable[[np.ndarray], np.ndarray]


def driven(
    wanted: Velocity, does: Does, seconds: float = 60.0, held_s: float = 0.0
) -> tuple[np.ndarray, list[Velocity]]:
    """Way and turn in its own heading of a robot whose human does `does` of what it is asked for, `LATE_S` later.

    Returns:
        Forward, left [m of the human] and turn [rad] over what was asked in that time; all that was asked of the human.
    """
    place, way = np.zeros(3), np.zeros(3)
    keeper = WayKeeper(wanted, PACE, SCALE, place, 0.0)
    asked = [wanted]
    under_way: deque[Velocity] = deque([Velocity(0.0, 0.0, 0.0)] * round(LATE_S / STEP_S))
    for number in range(1, round(seconds / STEP_S) + 1):
        under_way.append(asked[-1])
        now = under_way.popleft()
        done = does(np.array([now.forward, now.left, now.turning])) * STEP_S * (number * STEP_S >= held_s)
        way += done
        middle = place[2] + 0.5 * done[2]
        turned = np.array([[math.cos(middle), -math.sin(middle)], [math.sin(middle), math.cos(middle)]])
        place = place + [*(turned @ done[:2] / SCALE), done[2]]
        asked += [one for one in [keeper.update(place, number * STEP_S)] if one is not None]
    return way, asked


@pytest.mark.parametrize("share", [0.7, 1.0, 1.4])
@pytest.mark.parametrize("wanted", [Velocity(0.5, 0.0, 0.0), Velocity(0.4, 0.0, 0.2), Velocity(0.0, 0.0, -0.4)])
def test_a_robot_that_does_less_or_more_than_its_human_comes_as_far_as_asked(wanted: Velocity, share: float) -> None:
    way, _ = driven(wanted, lambda asked: share * asked)
    expected = 60.0 * np.array([wanted.forward, wanted.left, wanted.turning])
    np.testing.assert_allclose(way, expected, atol=0.05 * np.abs(expected).max())


def test_a_human_that_drifts_ahead_while_it_steps_aside_is_held_back() -> None:
    way, asked = driven(Velocity(0.0, 0.12, 0.0), lambda asked: asked + [0.06, 0.0, 0.0])
    assert abs(way[0]) < 0.25 * 60 * 0.06 and asked[-1].forward < 0.0


def test_who_walks_ahead_is_not_asked_to_sway_aside_and_who_goes_straight_not_to_turn() -> None:
    _, asked = driven(Velocity(0.5, 0.0, 0.0), lambda asked: 0.8 * asked + [0.0, 0.02, 0.05])
    assert {(one.left, one.turning) for one in asked} == {(0.0, 0.0)}


def test_a_robot_that_was_held_does_not_hurry_without_bound() -> None:
    _, asked = driven(Velocity(0.5, 0.0, 0.0), lambda asked: asked, held_s=40.0)
    assert max(one.forward for one in asked) <= 1.5 * PACE.ahead
    _, asked = driven(Velocity(0.5, 0.0, 0.0), lambda asked: asked, seconds=120.0, held_s=40.0)
    assert asked[-1].forward == pytest.approx(0.5, abs=0.15)


def test_the_human_is_changed_at_most_every_two_seconds() -> None:
    _, asked = driven(Velocity(0.5, 0.0, 0.0), lambda asked: 0.7 * asked)
    assert len(asked) - 1 <= 60.0 / 2.0


@given(
    wanted=st.tuples(*(st.floats(-limit, limit) for limit in (1.0, 0.4, 1.0))),
    moves=st.lists(st.tuples(*[st.floats(-0.5, 0.5)] * 3), min_size=40, max_size=80),
)
def test_whatever_the_robot_does_the_human_is_asked_for_nothing_wild(
    wanted: tuple[float, float, float], moves: list[tuple[float, float, float]]
) -> None:
    place = np.zeros(3)
    keeper = WayKeeper(Velocity(*wanted), PACE, SCALE, place, 0.0)
    for number, move in enumerate(moves):
        place = place + move
        asked = keeper.update(place, 0.5 * (number + 1))
        if asked is None:
            continue
        for found, given_one in ((asked.left, wanted[1]), (asked.turning, wanted[2])):
            assert found * given_one >= 0.0
        assert asked.forward * wanted[0] >= 0.0
        within = (asked.forward / (PACE.ahead if asked.forward > 0 else PACE.back), asked.left / PACE.aside)
        assert math.hypot(*within) <= 1.5 + 1e-9 and abs(asked.turning) <= 1.5 * PACE.turning + 1e-9
