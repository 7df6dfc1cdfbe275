"""A velocity is kept by the robot's way, within bounds, and whatever the robot and its human do."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.sampling.pace import Pace
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.planning.human_ahead import MEAN_S
from flexmotion.streamer.planning.way_keeper import WayKeeper

SCALE, STEP_S, WINDOW = 4.0, 0.1, 11
PACE = Pace(ahead=0.9, back=0.45, aside=0.18, turning=0.7)

Does = Callable[[np.ndarray], np.ndarray]


def as_asked(asked: np.ndarray) -> np.ndarray:
    """A human that does what it is asked for."""
    return asked


@dataclass
class Ahead:
    """The human of a simulated source at a step: way in its own heading at each step that is sampled, (T, 3)."""

    way: list[np.ndarray]
    now: int

    def coming(self) -> tuple[float, np.ndarray] | None:
        """See `HumanAhead.coming`."""
        mean = round(MEAN_S / STEP_S)
        if self.now < mean:
            return None
        before, last = np.array(self.way[self.now - mean : self.now]), np.array(self.way[-mean:])
        return (len(self.way) - self.now) * STEP_S, last.mean(axis=0) - before.mean(axis=0)


@dataclass
class Run:
    """What became of one: way and turn of the robot at each step [m of the human, rad], and all that was asked."""

    way: np.ndarray
    asked: list[Velocity]


def driven(
    wanted: Velocity,
    does: Does = as_asked,
    seconds: float = 60.0,
    *,
    share: float = 1.0,
    late_s: float = 0.3,
    sampled_s: float = 1.5,
    held_s: float = 0.0,
    before: Velocity | None = None,
    sway_m: float = 0.0,
) -> Run:
    """A keeper with a human that does `does` of what it is asked for, window after window.

    Args:
        share: of the human's way that the robot covers; it turns as its human.
        late_s: the robot follows its human so much later.
        sampled_s: human that is sampled ahead, at least.
        held_s: until then the robot does not move.
        before: velocity at which human and robot moved up to then; None: they stood.
        sway_m: how far the torso sways to each side, once a second, in the robot's size.
    """
    place, way = np.zeros(3), np.zeros(3)
    keeper = WayKeeper(wanted, PACE, SCALE, place, 0.0)
    speed = np.zeros(3) if before is None else np.array([before.forward, before.left, before.turning])
    known = round(2 * MEAN_S / STEP_S)  # steps of the human that lie behind
    asked, done, human = [wanted], [np.zeros(3)], [step * STEP_S * speed for step in range(-known, 1)]
    for number in range(1, round(seconds / STEP_S) + 1):
        while len(human) < known + number + sampled_s / STEP_S:
            now = asked[-1]
            window = does(np.array([now.forward, now.left, now.turning])) * STEP_S
            human += [human[-1] + (one + 1) * window for one in range(WINDOW)]
        second = known + number - round(late_s / STEP_S)
        moved = (human[second] - human[second - 1]) * [share, share, 1.0] * (number * STEP_S >= held_s)
        way = way + moved
        done.append(way)
        middle = place[2] + 0.5 * moved[2]
        turned = np.array([[math.cos(middle), -math.sin(middle)], [math.sin(middle), math.cos(middle)]])
        place = place + [*(turned @ moved[:2] / SCALE), moved[2]]
        sway = sway_m * math.sin(2.0 * math.pi * number * STEP_S)
        seen = place + [-math.sin(place[2]) * sway, math.cos(place[2]) * sway, 0.0]
        found = keeper.update(seen, number * STEP_S, Ahead(human, known + number))
        asked += [] if found is None else [found]
    return Run(np.array(done), asked)


def led(wanted: Velocity, seconds: float = 60.0) -> np.ndarray:
    """Where a velocity leads."""
    return seconds * np.array([wanted.forward, wanted.left, wanted.turning])


@pytest.mark.parametrize("share", [0.7, 1.0])
@pytest.mark.parametrize("wanted", [Velocity(0.5, 0.0, 0.0), Velocity(0.4, 0.0, 0.2), Velocity(0.0, 0.12, 0.0)])
def test_a_robot_that_does_less_than_its_human_comes_as_far_as_asked(wanted: Velocity, share: float) -> None:
    way = driven(wanted, share=share).way[-1]
    np.testing.assert_allclose(way, led(wanted), atol=0.05 * np.abs(led(wanted)).max())


@settings(deadline=None, max_examples=40)
@given(
    gain=st.floats(0.5, 2.0),
    late_s=st.floats(0.0, 0.8),
    sampled_s=st.floats(1.0, 2.5),
    turning=st.sampled_from([-0.3, 0.15, 0.3]),
)
def test_a_turn_is_kept_by_a_human_of_any_gain_and_delay(
    gain: float, late_s: float, sampled_s: float, turning: float
) -> None:
    """A human that turned 1.7 times as fast as asked was called back slowly: turns of a minute ended 5 to 13° off."""
    wanted = Velocity(0.0, 0.0, turning)
    run = driven(wanted, lambda asked: gain * asked, late_s=late_s, sampled_s=sampled_s)
    steps = np.arange(len(run.way)) * STEP_S
    off = np.degrees(run.way[:, 2] - turning * steps)[-100:]  # 10 s, also of a loop that oscillates
    assert np.abs(off).max() < 3.0


@settings(deadline=None, max_examples=40)
@given(gain=st.floats(0.5, 2.0), turns=st.floats(0.5, 2.0), share=st.floats(0.7, 1.0))
def test_a_curve_is_kept_by_a_human_of_any_gain(gain: float, turns: float, share: float) -> None:
    """A ratio that was learnt from turns on the spot had curves end 22 to 33° off."""
    wanted, gain = Velocity(0.4, 0.0, 0.2), max(gain, 0.55 / share)
    way = driven(wanted, lambda asked: asked * [gain, 1.0, turns], share=share).way[-1]
    assert abs(math.degrees(way[2] - led(wanted)[2])) < 3.0
    assert way[0] == pytest.approx(led(wanted)[0], rel=0.07)


def test_a_human_that_drifts_ahead_while_it_steps_aside_is_held_back() -> None:
    run = driven(Velocity(0.0, 0.12, 0.0), lambda asked: asked + [0.06, 0.0, 0.0])
    assert abs(run.way[-1, 0]) < 0.25 * 60 * 0.06 and run.asked[-1].forward < 0.0


def test_who_walks_ahead_is_not_asked_to_sway_aside_and_who_goes_straight_not_to_turn() -> None:
    run = driven(Velocity(0.5, 0.0, 0.0), lambda asked: 0.8 * asked + [0.0, 0.02, 0.05])
    assert {(one.left, one.turning) for one in run.asked} == {(0.0, 0.0)}


@pytest.mark.parametrize("wanted", [Velocity(0.5, 0.0, 0.0), Velocity(0.0, 0.0, 0.3)])
def test_a_robot_that_was_held_does_not_hurry(wanted: Velocity) -> None:
    """It makes up for 5 s of its way at most: what it missed before is gone, and its human is asked as before again."""
    at = 2 if wanted.turning else 0
    speed, most = (wanted.turning, PACE.turning) if at else (wanted.forward, PACE.ahead)
    run = driven(wanted, seconds=120.0, held_s=40.0)
    asked = [(one.forward, one.left, one.turning)[at] for one in run.asked]
    assert max(asked) <= 1.5 * most + 1e-9
    assert asked[-1] == pytest.approx(speed, rel=0.3)
    missing = speed * 120.0 - run.way[-1, at]
    assert missing >= speed * (40.0 - 8.0)


@pytest.mark.parametrize("late_s", [0.3, 1.2])
def test_a_slower_velocity_is_not_undershot_for_what_was_sampled_before(late_s: float) -> None:
    """Regression: told to go slower, from .86 m/s to .6, a human was asked for .49 for four seconds."""
    run = driven(Velocity(0.6, 0.0, 0.0), late_s=late_s, before=Velocity(0.86, 0.0, 0.0))
    assert min(one.forward for one in run.asked) > 0.575


@pytest.mark.parametrize("sway_m", [0.04, -0.04])
def test_where_a_torso_sways_as_its_way_begins_to_count_does_not_matter(sway_m: float) -> None:
    """Regression: .3 m/s ahead and .12 aside led half as far aside as asked in the first ten seconds."""
    run = driven(Velocity(0.3, 0.12, 0.0), late_s=0.8, sway_m=sway_m)
    assert run.way[100, 1] == pytest.approx(0.12 * (10.0 - 0.8), abs=0.08)
    assert max(abs(one.left - 0.12) for one in run.asked[:12]) < 0.02


def test_what_is_asked_waits_for_a_human_that_is_known() -> None:
    keeper = WayKeeper(Velocity(0.0, 0.0, 0.3), PACE, SCALE, np.zeros(3), 0.0)
    assert all(keeper.update(np.zeros(3), one * STEP_S, Ahead([np.zeros(3)], 0)) is None for one in range(1, 60))


@given(
    wanted=st.tuples(*(st.floats(-limit, limit) for limit in (1.0, 0.4, 1.0))),
    moves=st.lists(st.tuples(*[st.floats(-0.5, 0.5)] * 3), min_size=40, max_size=80),
    coming=st.tuples(*[st.floats(-5.0, 5.0)] * 3),
)
def test_whatever_the_robot_does_the_human_is_asked_for_nothing_wild(
    wanted: tuple[float, float, float], moves: list[tuple[float, float, float]], coming: tuple[float, float, float]
) -> None:
    class Wild:
        def coming(self) -> tuple[float, np.ndarray]:
            return 2.0, np.array(coming)

    place = np.zeros(3)
    keeper = WayKeeper(Velocity(*wanted), PACE, SCALE, place, 0.0)
    for number, move in enumerate(moves):
        place = place + move
        asked = keeper.update(place, 0.5 * (number + 1), Wild())
        assert asked is not None
        for found, given_one in ((asked.left, wanted[1]), (asked.turning, wanted[2])):
            assert found * given_one >= 0.0
        assert asked.forward * wanted[0] >= 0.0
        within = (asked.forward / (PACE.ahead if asked.forward > 0 else PACE.back), asked.left / PACE.aside)
        assert math.hypot(*within) <= 1.5 + 1e-9 and abs(asked.turning) <= 1.5 * PACE.turning + 1e-9
