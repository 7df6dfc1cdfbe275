"""The course of a motion: what a window is asked for so that the motion keeps its heading and its place."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.sampling.course import FASTEST_RETURN, LOST, MOST_TURNING, Course
from flexmotion.sampling.sampler import Condition

WINDOW_S = 32 / 30
WALK, STAND = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)


def moved(motion: Motion, yaw: float, place: tuple[float, float] = (0.0, 0.0), speed: float = 0.0) -> Motion:
    """A second of a motion at a heading [rad], whose mean place is this one; it moves ahead at a speed [m/s]."""
    quaternion = Rotation.from_euler("z", yaw).as_quat(scalar_first=True)
    t = (np.arange(len(motion)) - (len(motion) - 1) / 2) / motion.fps
    root = motion.root_position.copy()
    root[:, 0] = place[0] + speed * t * cos(yaw)
    root[:, 1] = place[1] + speed * t * sin(yaw)
    return replace(motion, root_position=root, root_quaternion=np.tile(quaternion, (len(motion), 1)))


@pytest.fixture
def second(make_standing) -> Motion:
    return make_standing(32)


def test_a_walk_that_turned_is_asked_to_turn_back(second: Motion) -> None:
    request = Condition("walk")
    course, asked = Course().followed(request, WALK, moved(second, 0.0, speed=1.0), WINDOW_S)
    assert asked.asked == pytest.approx(WALK) and asked.text == "walk"
    for yaw in (0.1, -0.1):
        _, asked = course.followed(request, WALK, moved(second, yaw, speed=1.0), WINDOW_S)
        assert asked.asked is not None and asked.asked[2] * yaw < 0
    _, asked = course.followed(request, WALK, moved(second, 0.7, speed=1.0), WINDOW_S)
    assert asked.asked is not None and asked.asked[2] == -MOST_TURNING


def test_the_loop_holds_a_model_that_drifts(second: Motion) -> None:
    """With a model that turns by 4° in every window, and does 80 % of what it is asked for one window late."""
    request, course, yaw, before = Condition(velocity=WALK), Course(), 0.0, 0.0
    found = []
    for _ in range(60):
        course, asked = course.followed(request, WALK, moved(second, yaw, speed=1.0), WINDOW_S)
        assert asked.asked is not None
        yaw += radians(4.0) + 0.8 * WINDOW_S * (0.5 * asked.asked[2] + 0.5 * before)
        before = asked.asked[2]
        found.append(np.degrees(yaw))
    assert np.abs(found).max() < 20 and np.abs(found[25:]).max() < 1.0


def test_a_walk_beside_its_line_is_led_back(second: Motion) -> None:
    """To the left of its line it turns right, whichever way it walks."""
    for own in (WALK, (-0.5, 0.0, 0.0), (0.0, 0.3, 0.0)):
        request = Condition(velocity=own)
        course, _ = Course().followed(request, own, moved(second, 0.0), WINDOW_S)
        left = np.array([-own[1], own[0]]) / np.hypot(*own[:2])
        _, asked = course.followed(request, own, moved(second, 0.0, (float(left[0]), float(left[1]))), WINDOW_S)
        assert asked.asked is not None and asked.asked[2] < 0


def test_a_walk_that_is_slow_is_asked_for_more(second: Motion) -> None:
    request = Condition(velocity=WALK)
    course, first = Course().followed(request, WALK, moved(second, 0.0, speed=0.5), WINDOW_S)
    _, then = course.followed(request, WALK, moved(second, 0.0, speed=0.5), WINDOW_S)
    assert first.asked is not None and then.asked is not None
    assert then.asked[0] > first.asked[0] > 1.0


def test_a_slow_step_aside_is_not_asked_to_hurry(second: Motion) -> None:
    """Regression: a model that is slow sideways was asked for more and more of it, and walked 18 m ahead instead."""
    own = (0.0, -0.2, 0.0)
    course, request = Course(), Condition(velocity=own)
    for _ in range(20):
        course, asked = course.followed(request, own, moved(second, 0.0), WINDOW_S)
        assert asked.asked == pytest.approx(own, abs=1e-6)
    # What it goes ahead of its line is made up for.
    _, asked = course.followed(request, own, moved(second, 0.0, (0.2, 0.0)), WINDOW_S)
    assert asked.asked is not None and asked.asked[0] < 0 and asked.asked[1] == pytest.approx(-0.2)


def test_who_stands_is_asked_back_to_heading_and_place(second: Motion) -> None:
    course, _ = Course().followed(Condition(), STAND, moved(second, 0.5), WINDOW_S)
    _, asked = course.followed(Condition(), STAND, moved(second, 0.5 + 0.05, (0.5, 0.0)), WINDOW_S)
    assert asked.asked is not None and asked.asked[2] < 0
    # In its own heading the place lies behind and to the left.
    assert asked.asked[0] < 0 < asked.asked[1] and np.hypot(*asked.asked[:2]) == pytest.approx(FASTEST_RETURN)


def test_who_comes_to_a_stand_stands_where_it_came_to_rest(second: Motion) -> None:
    course, _ = Course().followed(Condition(velocity=WALK), WALK, moved(second, 0.0, speed=1.0), WINDOW_S)
    course, _ = course.followed(Condition(), STAND, moved(second, 0.0, (1.0, 0.0), speed=0.6), WINDOW_S)
    course, _ = course.followed(Condition(), STAND, moved(second, 0.0, (1.4, 0.0), speed=0.2), WINDOW_S)
    _, asked = course.followed(Condition(), STAND, moved(second, 0.0, (1.4, 0.0)), WINDOW_S)
    assert asked.asked == pytest.approx(STAND, abs=1e-9)


def test_the_heading_stays_from_request_to_request_and_a_turn_sets_it(second: Motion) -> None:
    walk, stand, turn = Condition(velocity=WALK), Condition(), Condition(velocity=(0.0, 0.0, 0.5))
    course, _ = Course().followed(walk, WALK, moved(second, 0.0), WINDOW_S)
    course, asked = course.followed(stand, STAND, moved(second, 0.1), WINDOW_S)
    assert course.heading == pytest.approx(0.0) and asked.asked is not None and asked.asked[2] < 0
    course, asked = course.followed(turn, (0.0, 0.0, 0.5), moved(second, 0.5), WINDOW_S)
    assert asked == turn
    # The first window after it ends the turn: the body still turns when it begins.
    course, asked = course.followed(walk, WALK, moved(second, 1.4), WINDOW_S)
    assert asked == walk
    course, asked = course.followed(walk, WALK, moved(second, 1.6), WINDOW_S)
    assert course.heading == pytest.approx(1.6)
    _, asked = course.followed(walk, WALK, moved(second, 1.7), WINDOW_S)
    assert asked.asked is not None and asked.asked[2] < 0


def test_another_speed_keeps_the_line_and_what_the_turning_needs(second: Motion) -> None:
    """At every change of speed the sum of the heading's errors began at zero, and the line where the body was."""
    course, _ = Course().followed(Condition(velocity=WALK), WALK, moved(second, 0.0, speed=1.0), WINDOW_S)
    course, _ = course.followed(Condition(velocity=WALK), WALK, moved(second, 0.1, (1.0, 0.2), speed=1.0), WINDOW_S)
    faster, aside, words = (1.5 * WALK[0], 0.0, 0.0), (0.0, 0.3, 0.0), Condition("march")
    after = moved(second, 0.1, (2.0, 0.4), speed=1.0)
    same, _ = course.followed(Condition(velocity=faster), faster, after, WINDOW_S)
    assert same.place == course.place and same.summed == pytest.approx(2 * course.summed, rel=0.6)
    turned, _ = course.followed(Condition(velocity=aside), aside, after, WINDOW_S)
    assert turned.place != course.place and abs(turned.summed) > abs(course.summed)
    other, _ = course.followed(words, None, after, WINDOW_S)
    assert other.place != course.place and abs(other.summed) < abs(same.summed)


def test_a_gesture_is_left_alone_until_it_is_off(second: Motion) -> None:
    """Its words are of an unknown speed: a velocity beside them would hold the pelvis."""
    wave = Condition("wave with the right hand")
    course, asked = Course().followed(wave, None, moved(second, 0.0), WINDOW_S)
    assert asked == wave
    course, asked = course.followed(wave, None, moved(second, radians(1.0), (0.02, 0.0)), WINDOW_S)
    assert asked == wave
    _, asked = course.followed(wave, None, moved(second, radians(6.0)), WINDOW_S)
    assert asked.asked is not None and asked.asked[2] < 0 and asked.asked[:2] == pytest.approx((0.0, 0.0))


def test_words_of_an_unknown_speed_travel_at_the_one_that_is_measured(second: Motion) -> None:
    march = Condition("march")
    course, _ = Course().followed(march, None, moved(second, 0.0, speed=0.8), WINDOW_S)
    _, asked = course.followed(march, None, moved(second, 0.2, speed=0.8), WINDOW_S)
    assert asked.asked is not None and asked.asked[0] == pytest.approx(0.8) and asked.asked[2] < 0


def test_a_motion_that_turns_by_itself_gets_a_new_heading(second: Motion) -> None:
    dance = Condition("dance")
    course, _ = Course().followed(dance, None, moved(second, 0.0), WINDOW_S)
    course, asked = course.followed(dance, None, moved(second, float(LOST) + 0.1), WINDOW_S)
    assert course.heading == pytest.approx(float(LOST) + 0.1) and asked == dance
