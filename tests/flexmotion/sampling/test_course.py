"""The course of a motion: what a window is asked for so that the motion keeps its heading and its place."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.features.constraints import Constraints, end_mean
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import Layout
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.sampling.course import (
    FASTEST_RETURN,
    LOST,
    MOST_ASIDE,
    MOST_SUM,
    MOST_TURNED,
    SUMMED,
    Course,
)
from flexmotion.sampling.sampler import Condition
from flexmotion.spatial.heading import wrapped

FRAMES, FPS = 32, 30.0
WINDOW_S = FRAMES / FPS
WALK, STAND = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
FREE = Constraints.none(Layout(FPS), Body(), FRAMES)


def heading_of(asked: Condition, past: Motion) -> float:
    """The mean heading in the world that a window is asked for [rad]."""
    assert asked.constraints is not None
    (value,) = (mean.value for mean in asked.constraints.means if mean.weights[3])
    return value + Anchor.after(past).yaw


def aside_of(asked: Condition) -> float:
    """How far to the left of the last frame a window of who walks ahead is asked to be [m]."""
    assert asked.constraints is not None
    (value,) = (mean.value for mean in asked.constraints.means if not mean.weights[3])
    return value * Body().leg


def moved(motion: Motion, yaw: float, place: tuple[float, float] = (0.0, 0.0), speed: float = 0.0) -> Motion:
    """A second of a motion at a heading [rad], whose mean place is this one; it moves ahead at a speed [m/s]."""
    quaternion = Rotation.from_euler("z", yaw).as_quat(scalar_first=True)
    t = (np.arange(len(motion)) - (len(motion) - 1) / 2) / motion.fps
    root = motion.root_position.copy()
    root[:, 0] = place[0] + speed * t * cos(yaw)
    root[:, 1] = place[1] + speed * t * sin(yaw)
    return replace(motion, root_position=root, root_quaternion=np.tile(quaternion, (len(motion), 1)))


def with_headings(motion: Motion, yaw: NDArray[np.float64]) -> Motion:
    """The motion with a heading in every frame [rad]."""
    return replace(motion, root_quaternion=Rotation.from_euler("z", yaw[:, None]).as_quat(scalar_first=True))


@pytest.fixture
def second(make_standing) -> Motion:
    return make_standing(32)


def test_a_walk_that_turned_is_asked_to_head_back(second: Motion) -> None:
    request = Condition("walk")
    course, asked = Course().followed(request, WALK, moved(second, 0.0, speed=1.0), WINDOW_S, FREE)
    assert asked.asked == pytest.approx(WALK) and asked.text == "walk"
    for yaw in (0.1, -0.1):
        past = moved(second, yaw, speed=1.0)
        _, asked = course.followed(request, WALK, past, WINDOW_S, FREE)
        assert heading_of(asked, past) == pytest.approx(0.0, abs=1e-9)
        assert asked.asked is not None and asked.asked[2] * yaw < 0
    past = moved(second, 0.7, speed=1.0)
    _, asked = course.followed(request, WALK, past, WINDOW_S, FREE)
    assert heading_of(asked, past) == pytest.approx(0.7 - MOST_TURNED)


def test_what_else_was_asked_of_the_window_stays(second: Motion) -> None:
    hand = FREE.place("hand_r", 20, [0.4, -0.1, 1.5])
    request = Condition(velocity=WALK, constraints=hand)
    _, asked = Course().followed(request, WALK, moved(second, 0.0), WINDOW_S, FREE)
    assert asked.constraints is not None and asked.constraints.mask.sum() == 3 and len(asked.constraints.means) == 2


@pytest.mark.parametrize("frames", [26, 30, 31, 34, 40])
def test_a_pelvis_that_swings_with_each_step_neither_drifts_nor_zigzags(second: Motion, frames: int) -> None:
    """Asked for a mean over all of each window, the heading jumped from -10° to 10° and back, with a mean of zero.

    Over half of it, the swing of the pelvis was taken for its heading, which was off by 5° for half a minute.
    """
    swing, drift = radians(6.0), radians(4.0)
    course, begin, headings = Course(), 0, [radians(3.0)] * FRAMES
    trend = radians(13.0)  # it starts with a jolt
    at, later = np.arange(1, FRAMES + 1) / FRAMES, end_mean(np.arange(1, FRAMES + 1) / FRAMES)
    for _ in range(60):
        past = with_headings(second, np.array(headings[-FRAMES:]))
        course, asked = course.followed(Condition(velocity=WALK), WALK, past, WINDOW_S, FREE)
        own = swing * np.sin(2 * np.pi * (begin + np.arange(FRAMES)) / frames)
        # The model turns evenly from where it is, by what brings the mean at the end to what is asked, and drifts on.
        slope = (heading_of(asked, past) - trend - end_mean(own)) / later
        headings.extend(trend + slope * at + own)
        trend, begin = trend + slope + 0.2 * drift, begin + FRAMES
    degrees = np.degrees(headings[5 * FRAMES :]) - 3.0
    mean = np.convolve(degrees, np.ones(5 * FRAMES) / (5 * FRAMES), "valid")
    assert np.abs(mean).max() < 1.5 and np.abs(degrees).max() < 12.5


def test_a_walk_beside_its_line_is_led_back(second: Motion) -> None:
    """Whichever way it walks, it is asked to be nearer to the line, by no more than a step."""
    for own in (WALK, (-0.5, 0.0, 0.0), (0.0, 0.3, 0.0)):
        request = Condition(velocity=own)
        course, _ = Course().followed(request, own, moved(second, 0.0), WINDOW_S, FREE)
        left = np.array([-own[1], own[0]]) / np.hypot(*own[:2])
        for off in (0.04, 1.0):
            past = moved(second, 0.0, tuple(off * left))
            _, asked = course.followed(request, own, past, WINDOW_S, FREE)
            sideways = 1.0 + SUMMED * bool(own[1])
            assert aside_of(asked) == pytest.approx(-sideways * min(off, MOST_ASIDE))


def test_a_walk_sideways_that_goes_ahead_in_every_window_is_asked_for_more(second: Motion) -> None:
    """Asked for its line alone, a model that walks ahead while it steps aside was 2 m ahead of it after 16."""
    request, course = Condition(velocity=(0.0, 0.3, 0.0)), Course()
    course, _ = course.followed(request, (0.0, 0.3, 0.0), moved(second, 0.0), WINDOW_S, FREE)
    found = []
    for _ in range(30):
        past = moved(second, 0.0, (0.05, 0.0))
        course, asked = course.followed(request, (0.0, 0.3, 0.0), past, WINDOW_S, FREE)
        found.append(aside_of(asked))
    assert found == sorted(found) and found[5] > 0.1 and found[-1] <= MOST_ASIDE + SUMMED * MOST_SUM


def test_a_walk_that_is_slow_is_asked_for_more(second: Motion) -> None:
    request = Condition(velocity=WALK)
    course, first = Course().followed(request, WALK, moved(second, 0.0, speed=0.5), WINDOW_S, FREE)
    _, then = course.followed(request, WALK, moved(second, 0.0, speed=0.5), WINDOW_S, FREE)
    assert first.asked is not None and then.asked is not None
    assert then.asked[0] > first.asked[0] > 1.0


def test_a_slow_step_aside_is_not_asked_to_hurry(second: Motion) -> None:
    """Regression: a model that is slow sideways was asked for more and more of it, and walked 18 m ahead instead."""
    own = (0.0, -0.2, 0.0)
    course, request = Course(), Condition(velocity=own)
    for _ in range(20):
        course, asked = course.followed(request, own, moved(second, 0.0), WINDOW_S, FREE)
        assert asked.asked == pytest.approx(own, abs=1e-6)
    # What it goes ahead of its line is made up for.
    _, asked = course.followed(request, own, moved(second, 0.0, (0.2, 0.0)), WINDOW_S, FREE)
    assert asked.asked == pytest.approx(own, abs=1e-6) and aside_of(asked) < 0


def test_who_stands_is_asked_back_to_heading_and_place(second: Motion) -> None:
    course, _ = Course().followed(Condition(), STAND, moved(second, 0.5), WINDOW_S, FREE)
    _, asked = course.followed(Condition(), STAND, moved(second, 0.5 + 0.05, (0.5, 0.0)), WINDOW_S, FREE)
    assert asked.asked is not None and asked.asked[2] < 0
    # In its own heading the place lies behind and to the left.
    assert asked.asked[0] < 0 < asked.asked[1] and np.hypot(*asked.asked[:2]) == pytest.approx(FASTEST_RETURN)


def test_who_comes_to_a_stand_stands_where_it_came_to_rest(second: Motion) -> None:
    course, _ = Course().followed(Condition(velocity=WALK), WALK, moved(second, 0.0, speed=1.0), WINDOW_S, FREE)
    course, _ = course.followed(Condition(), STAND, moved(second, 0.0, (1.0, 0.0), speed=0.6), WINDOW_S, FREE)
    course, _ = course.followed(Condition(), STAND, moved(second, 0.0, (1.4, 0.0), speed=0.2), WINDOW_S, FREE)
    _, asked = course.followed(Condition(), STAND, moved(second, 0.0, (1.4, 0.0)), WINDOW_S, FREE)
    assert asked.asked == pytest.approx(STAND, abs=1e-9)


def test_the_heading_stays_from_request_to_request_and_a_turn_sets_it(second: Motion) -> None:
    walk, stand, turn = Condition(velocity=WALK), Condition(), Condition(velocity=(0.0, 0.0, 0.5))
    course, _ = Course().followed(walk, WALK, moved(second, 0.0), WINDOW_S, FREE)
    course, asked = course.followed(stand, STAND, moved(second, 0.1), WINDOW_S, FREE)
    assert course.heading == pytest.approx(0.0) and asked.asked is not None and asked.asked[2] < 0
    course, asked = course.followed(turn, (0.0, 0.0, 0.5), moved(second, 0.5), WINDOW_S, FREE)
    assert asked.asked is None and asked.velocity == turn.velocity
    # The first window after it ends the turn: the body still turns when it begins.
    course, asked = course.followed(walk, WALK, moved(second, 1.4), WINDOW_S, FREE)
    assert asked == walk
    course, asked = course.followed(walk, WALK, moved(second, 1.6), WINDOW_S, FREE)
    assert course.heading == pytest.approx(1.6)
    _, asked = course.followed(walk, WALK, moved(second, 1.7), WINDOW_S, FREE)
    assert asked.asked is not None and asked.asked[2] < 0


@pytest.mark.parametrize("rate", [0.3, -0.7])
@pytest.mark.parametrize("kept", [1.0, 0.8])
def test_a_turn_is_as_fast_as_it_is_asked(second: Motion, rate: float, kept: float) -> None:
    """Asked for .3 rad/s on the spot a model turned left by .43 and right by .28: 147° too far after 20 s."""
    own, course, headings, at = (0.0, 0.0, rate), Course(), [0.0] * FRAMES, np.arange(1, FRAMES + 1) / FRAMES
    for _ in range(20):
        past = with_headings(second, np.array(headings[-FRAMES:]))
        course, asked = course.followed(Condition(velocity=own), own, past, WINDOW_S, FREE)
        # What is asked is kept but for a share of what the model would do by itself.
        slope = (
            kept * wrapped(heading_of(asked, past) - headings[-1]) / end_mean(at) + (1 - kept) * 1.4 * rate * WINDOW_S
        )
        headings.extend(headings[-1] + slope * at)
    assert headings[-1] == pytest.approx(20 * WINDOW_S * rate, rel=0.05)


def test_a_turn_that_cannot_be_kept_is_not_caught_up_with(second: Motion) -> None:
    """A human that stands although it is to turn is asked for one window's turn and a bit, however long it stood."""
    own, course, past = (0.0, 0.0, 0.5), Course(), moved(second, 0.0)
    for _ in range(30):
        course, asked = course.followed(Condition(velocity=own), own, past, WINDOW_S, FREE)
        assert abs(heading_of(asked, past)) <= 0.5 * WINDOW_S + MOST_TURNED + 1e-9


def test_another_speed_keeps_the_line(second: Motion) -> None:
    """At every change of speed the line began where the body was."""
    course, _ = Course().followed(Condition(velocity=WALK), WALK, moved(second, 0.0, speed=1.0), WINDOW_S, FREE)
    faster, aside, words = (1.5 * WALK[0], 0.0, 0.0), (0.0, 0.3, 0.0), Condition("march")
    after = moved(second, 0.1, (2.0, 0.4), speed=1.0)
    same, _ = course.followed(Condition(velocity=faster), faster, after, WINDOW_S, FREE)
    assert same.place == course.place
    turned, _ = course.followed(Condition(velocity=aside), aside, after, WINDOW_S, FREE)
    assert turned.place != course.place
    other, _ = course.followed(words, None, after, WINDOW_S, FREE)
    assert other.place != course.place


def test_a_gesture_is_left_alone_until_it_is_off(second: Motion) -> None:
    """Its words are of an unknown speed: a velocity beside them would hold the pelvis."""
    wave = Condition("wave with the right hand")
    course, asked = Course().followed(wave, None, moved(second, 0.0), WINDOW_S, FREE)
    assert asked == wave
    course, asked = course.followed(wave, None, moved(second, radians(1.0), (0.02, 0.0)), WINDOW_S, FREE)
    assert asked == wave
    _, asked = course.followed(wave, None, moved(second, radians(6.0)), WINDOW_S, FREE)
    assert asked.asked is not None and asked.asked[2] < 0 and asked.asked[:2] == pytest.approx((0.0, 0.0))


def test_words_of_an_unknown_speed_travel_at_the_one_that_is_measured(second: Motion) -> None:
    march = Condition("march")
    course, _ = Course().followed(march, None, moved(second, 0.0, speed=0.8), WINDOW_S, FREE)
    _, asked = course.followed(march, None, moved(second, 0.2, speed=0.8), WINDOW_S, FREE)
    assert asked.asked is not None and asked.asked[0] == pytest.approx(0.8) and asked.asked[2] < 0


def test_a_motion_that_turns_by_itself_gets_a_new_heading(second: Motion) -> None:
    dance = Condition("dance")
    course, _ = Course().followed(dance, None, moved(second, 0.0), WINDOW_S, FREE)
    course, asked = course.followed(dance, None, moved(second, float(LOST) + 0.1), WINDOW_S, FREE)
    assert course.heading == pytest.approx(float(LOST) + 0.1) and asked == dance
