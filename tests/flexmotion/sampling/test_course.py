"""The course of a motion: what a window is asked for so that the motion keeps its heading and its place."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.features.constraints import END, Constraints, end_mean
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import Layout
from flexmotion.human.body import Body
from flexmotion.human.kinematics import foot_points
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.sampling.course import (
    FASTEST_RETURN,
    LOST,
    MOST_AWAY,
    MOST_TURNED,
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
    """Asked of a window of words that walk ahead: how far to be to the left of the last frame [m]."""
    assert asked.constraints is not None
    (value,) = (mean.value for mean in asked.constraints.means if not mean.weights[3])
    return value * Body().leg


def place_of(asked: Condition, past: Motion) -> NDArray[np.float64]:
    """The mean place in the world that the end of a window at a velocity is asked for, (2,) [m]."""
    assert asked.constraints is not None
    x, y = (mean.value * Body().leg for mean in asked.constraints.means if not mean.weights[3])
    yaw, here = Anchor.after(past).yaw, past.root_position[-1, :2]
    return np.array([cos(yaw) * x - sin(yaw) * y, sin(yaw) * x + cos(yaw) * y]) + here


DUE_S = WINDOW_S * (1 - END / 2) + 0.5 / FPS
"""From the last frame to the mean time of the end of the next window [s]."""


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
    course, asked = Course().followed(request, WALK, moved(second, 0.0, speed=1.0), FREE)
    assert asked.asked == pytest.approx(WALK) and asked.text == "walk"
    for yaw in (0.1, -0.1):
        past = moved(second, yaw, speed=1.0)
        _, asked = course.followed(request, WALK, past, FREE)
        assert heading_of(asked, past) == pytest.approx(0.0, abs=1e-9)
        assert asked.asked is not None and asked.asked[2] * yaw < 0
    past = moved(second, 0.7, speed=1.0)
    _, asked = course.followed(request, WALK, past, FREE)
    assert heading_of(asked, past) == pytest.approx(0.7 - MOST_TURNED)
    assert asked.noise == 1.0
    _, asked = course.followed(request, WALK, past, FREE, noise=0.7)
    assert asked.noise == 0.7


def test_what_else_was_asked_of_the_window_stays(second: Motion) -> None:
    hand = FREE.place("hand_r", 20, [0.4, -0.1, 1.5])
    request = Condition(velocity=WALK, constraints=hand)
    _, asked = Course().followed(request, WALK, moved(second, 0.0), FREE)
    assert asked.constraints is not None and asked.constraints.mask.sum() == 3 and len(asked.constraints.means) == 3


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
        course, asked = course.followed(Condition(velocity=WALK), WALK, past, FREE)
        own = swing * np.sin(2 * np.pi * (begin + np.arange(FRAMES)) / frames)
        # The model turns evenly from where it is, by what brings the mean at the end to what is asked, and drifts on.
        slope = (heading_of(asked, past) - trend - end_mean(own)) / later
        headings.extend(trend + slope * at + own)
        trend, begin = trend + slope + 0.2 * drift, begin + FRAMES
    degrees = np.degrees(headings[5 * FRAMES :]) - 3.0
    mean = np.convolve(degrees, np.ones(5 * FRAMES) / (5 * FRAMES), "valid")
    assert np.abs(mean).max() < 1.5 and np.abs(degrees).max() < 12.5


@pytest.mark.parametrize("facing", [0.0, 2.0, -3.0])
@pytest.mark.parametrize("own", [WALK, (-0.5, 0.0, 0.0), (0.0, 0.3, 0.0)])
def test_who_is_beside_its_way_is_led_back(second: Motion, facing: float, own: tuple[float, float, float]) -> None:
    """Whichever way it walks and faces, it is asked to be nearer to its way, by no more than a step in a window."""
    request, angle, speed = Condition(velocity=own), facing + np.arctan2(own[1], own[0]), np.hypot(*own[:2])
    course, _ = Course().followed(request, own, moved(second, facing), FREE)
    ahead, left = np.array([cos(angle), sin(angle)]), np.array([-sin(angle), cos(angle)])
    # It stood for a window, and walked in another.
    for off in (0.04, 1.0):
        place = 0.5 * WINDOW_S * speed * ahead + off * left
        past = moved(second, facing, (float(place[0]), float(place[1])))
        _, asked = course.followed(request, own, past, FREE)
        found = place_of(asked, past)
        assert left @ found == pytest.approx(max(0.0, off - MOST_AWAY), abs=1e-9)
        assert ahead @ found == pytest.approx(speed * (WINDOW_S + DUE_S), rel=0.02)


@pytest.mark.parametrize("facing", [0.0, 2.0])
def test_who_walks_by_words_is_led_back_to_its_line_alone(second: Motion, facing: float) -> None:
    """Words of walking have the model's own speed: of how far they lead nothing is asked."""
    request, left = Condition("walk"), np.array([-sin(facing), cos(facing)])
    course, _ = Course().followed(request, WALK, moved(second, facing), FREE)
    for off in (0.04, 1.0):
        place = 3.0 * np.array([cos(facing), sin(facing)]) + off * left
        _, asked = course.followed(request, WALK, moved(second, facing, (float(place[0]), float(place[1]))), FREE)
        assert aside_of(asked) == pytest.approx(-min(off, MOST_AWAY))


@pytest.mark.parametrize("own", [WALK, (0.2, 0.0, 0.0), (-0.3, 0.0, 0.0), (0.0, -0.2, 0.0), (0.5, 0.0, 0.4)])
def test_a_velocity_is_kept_by_places_whatever_the_model_does_of_it(second: Motion, own: tuple[float, ...]) -> None:
    """Asked for .45 m/s a human went .63 in the first two seconds, and .2 after ten; asked for .15 back it went .57.

    The robot's way was put right by asking for less, so that it hurried for two seconds and nearly stood for four.
    """
    velocity = (own[0], own[1], own[2])
    course, past, going = Course(), moved(second, 0.0), np.zeros(2)
    places, headings = past.root_position[:, :2], np.zeros(FRAMES)
    for window in range(12):
        course, asked = course.followed(Condition(velocity=velocity), velocity, past, FREE)
        assert asked.asked is not None and asked.asked[:2] == pytest.approx(velocity[:2])
        # A model that keeps what is asked, but for a drift of its own to the side and ahead.
        middle = round(FRAMES * (1 - END / 2))
        going = (place_of(asked, past) + (0.02, 0.03) - places[-1]) / (middle + 0.5)
        places = np.concatenate([places, places[-1] + going * np.arange(1, FRAMES + 1)[:, None]])
        headings = np.concatenate([headings, headings[-1] + own[2] / FPS * np.arange(1, FRAMES + 1)])
        past = with_headings(replace(past, root_position=past.root_position.copy()), headings[-FRAMES:])
        past.root_position[:, :2] = places[-FRAMES:]
        if window >= 2:
            speed = np.linalg.norm(places[-1] - places[-1 - FRAMES]) / WINDOW_S
            assert speed == pytest.approx(np.hypot(*own[:2]), rel=0.15, abs=0.02)


@pytest.mark.parametrize("every", [3, 10, 20])
def test_a_velocity_that_is_asked_for_again_and_again_is_no_faster_and_no_slower(second: Motion, every: int) -> None:
    """Each new target cuts the window after a few frames: a human walked at a third of its speed under a stick."""
    course, past, velocity = Course(), moved(second, 0.0), (0.5, 0.0, 0.0)
    places = past.root_position[:, :2]
    for _ in range(20 * FRAMES // every):
        course, asked = course.followed(Condition(velocity=velocity), velocity, past, FREE, played=every)
        going = (place_of(asked, past) - places[-1]) / (DUE_S * FPS)
        places = np.concatenate([places, places[-1] + going * np.arange(1, every + 1)[:, None]])
        past = replace(past, root_position=past.root_position.copy())
        past.root_position[:, :2] = places[-FRAMES:]
    assert places[-1, 0] == pytest.approx(0.5 * (len(places) - FRAMES) / FPS, rel=0.05)


def test_a_curve_ends_where_its_arc_leads(second: Motion) -> None:
    own, course, past = (0.5, 0.0, 0.4), Course(), moved(second, 0.0)
    places, headings = past.root_position[:, :2], np.zeros(FRAMES)
    for _ in range(8):
        course, asked = course.followed(Condition(velocity=own), own, past, FREE)
        turned = headings[-1] + own[2] / FPS * np.arange(1, FRAMES + 1)
        steps = np.column_stack([np.cos(turned), np.sin(turned)]) * own[0] / FPS
        # A model that walks an arc, shifted so that its end has the mean place that is asked for.
        arc = places[-1] + np.cumsum(steps, axis=0)
        shift = place_of(asked, past) - end_mean(arc)
        assert np.linalg.norm(shift) < 0.03
        places = np.concatenate([places, arc + shift * np.linspace(0.0, 1.0, FRAMES)[:, None]])
        headings = np.concatenate([headings, turned])
        past = with_headings(replace(past, root_position=past.root_position.copy()), headings[-FRAMES:])
        past.root_position[:, :2] = places[-FRAMES:]
    angle = own[2] * 8 * WINDOW_S
    radius = own[0] / own[2]
    np.testing.assert_allclose(places[-1], radius * np.array([sin(angle), 1.0 - cos(angle)]), atol=0.05)


def test_who_was_held_up_does_not_hurry_afterwards(second: Motion) -> None:
    course, past = Course(), moved(second, 0.0)
    for _ in range(20):
        course, asked = course.followed(Condition(velocity=WALK), WALK, past, FREE)
        assert place_of(asked, past)[0] <= WALK[0] * DUE_S + MOST_AWAY + 0.5 * WINDOW_S * WALK[0]


def test_words_that_are_slow_are_asked_for_more(second: Motion) -> None:
    request = Condition("walk")
    course, found = Course(), []
    for _ in range(4):
        course, asked = course.followed(request, WALK, moved(second, 0.0, speed=0.5), FREE)
        assert asked.asked is not None
        found.append(asked.asked[0])
    # What it did before the request does not count.
    assert found[0] == 1.0 < found[1] < found[2] < found[3]


def test_who_stands_is_asked_back_to_heading_and_place(second: Motion) -> None:
    course, _ = Course().followed(Condition(), STAND, moved(second, 0.5), FREE)
    _, asked = course.followed(Condition(), STAND, moved(second, 0.5 + 0.05, (0.5, 0.0)), FREE)
    assert asked.asked is not None and asked.asked[2] < 0
    # In its own heading the place lies behind and to the left.
    assert asked.asked[0] < 0 < asked.asked[1] and np.hypot(*asked.asked[:2]) == pytest.approx(FASTEST_RETURN)


def test_who_comes_to_a_stand_stands_where_it_came_to_rest(second: Motion) -> None:
    course, _ = Course().followed(Condition(velocity=WALK), WALK, moved(second, 0.0, speed=1.0), FREE)
    course, _ = course.followed(Condition(), STAND, moved(second, 0.0, (1.0, 0.0), speed=0.6), FREE)
    course, _ = course.followed(Condition(), STAND, moved(second, 0.0, (1.4, 0.0), speed=0.2), FREE)
    _, asked = course.followed(Condition(), STAND, moved(second, 0.0, (1.4, 0.0)), FREE)
    assert asked.asked == pytest.approx(STAND, abs=1e-9)


def test_the_heading_stays_from_request_to_request_and_a_turn_moves_it(second: Motion) -> None:
    """It was taken from the motion once the body had come out of a turn, and was up to 17° more than was asked for."""
    walk, stand, own = Condition(velocity=WALK), Condition(), (0.0, 0.0, 0.5)
    course, _ = Course().followed(walk, WALK, moved(second, 0.0), FREE)
    course, asked = course.followed(stand, STAND, moved(second, 0.1), FREE)
    assert course.heading == pytest.approx(0.0) and asked.asked is not None and asked.asked[2] < 0
    for window in range(2):
        course, asked = course.followed(Condition(velocity=own), own, moved(second, 0.5 * window), FREE)
        assert asked.asked is None and asked.velocity == own
    past = moved(second, 0.75)
    course, asked = course.followed(walk, WALK, past, FREE)
    assert course.heading == pytest.approx(2 * 0.5 * WINDOW_S)
    course, asked = course.followed(walk, WALK, moved(second, 1.3), FREE)
    assert course.heading == pytest.approx(2 * 0.5 * WINDOW_S)
    assert heading_of(asked, moved(second, 1.3)) == pytest.approx(2 * 0.5 * WINDOW_S)


@pytest.mark.parametrize("every", [3, 10, 20])
def test_a_turn_that_is_asked_for_again_and_again_is_not_faster(second: Motion, every: int) -> None:
    """Each new target cut the window after a few frames, and all of its turn counted: twice as fast under a stick."""
    own, course, headings = (0.0, 0.0, 0.3), Course(), [0.0] * FRAMES
    at, played = np.arange(1, FRAMES + 1) / FRAMES, FRAMES
    for _ in range(20 * FRAMES // every):
        past = with_headings(second, np.array(headings[-FRAMES:]))
        course, asked = course.followed(Condition(velocity=own), own, past, FREE, played=played)
        slope = wrapped(heading_of(asked, past) - headings[-1]) / end_mean(at)
        headings.extend((headings[-1] + slope * at)[:every])
        played = every
    assert headings[-1] == pytest.approx((len(headings) - FRAMES) / FPS * own[2], rel=0.03)


def test_a_body_begins_to_turn_half_a_window_behind_one_that_turns(second: Motion) -> None:
    own, past = (0.0, 0.0, 0.6), moved(second, 1.0)
    course, asked = Course().followed(Condition(velocity=own), own, past, FREE)
    assert heading_of(asked, past) == pytest.approx(1.0 + own[2] * WINDOW_S * (1 - END / 2))
    turning = with_headings(second, 1.0 + own[2] / FPS * np.arange(1, FRAMES + 1))
    _, asked = course.followed(Condition(velocity=own), own, turning, FREE)
    assert heading_of(asked, turning) == pytest.approx(1.0 + own[2] * WINDOW_S * (2 - END / 2))


@pytest.mark.parametrize("rate", [2.9, -2.9])
def test_a_fast_turn_is_never_asked_for_the_other_way_round(second: Motion, rate: float) -> None:
    own, past = (0.0, 0.0, rate), with_headings(second, rate / FPS * np.arange(1, FRAMES + 1))
    course, _ = Course().followed(Condition(velocity=own), own, moved(second, 0.0), FREE)
    _, asked = course.followed(Condition(velocity=own), own, past, FREE)
    assert asked.constraints is not None
    (value,) = (mean.value for mean in asked.constraints.means if mean.weights[3])
    assert value * rate > 0


def test_what_lacks_is_summed_by_the_time_that_was_played(second: Motion) -> None:
    """Words that are said again ten times a second wound the sum up: the human then walked twice as fast."""
    sums = []
    for played in (FRAMES, FRAMES // 8):
        course = Course()
        for _ in range(1 + 4 * FRAMES // played):
            course, _ = course.followed(Condition("walk"), WALK, moved(second, 0.0, speed=0.8), FREE, played=played)
        sums.append(course.slow)
    assert sums[0] == pytest.approx(sums[1], rel=0.3) and min(sums) > 0.0


@pytest.mark.parametrize("rate", [0.3, -0.7])
@pytest.mark.parametrize("kept", [1.0, 0.8])
def test_a_turn_is_as_fast_as_it_is_asked(second: Motion, rate: float, kept: float) -> None:
    """Asked for .3 rad/s on the spot a model turned left by .43 and right by .28: 147° too far after 20 s."""
    own, course, headings, at = (0.0, 0.0, rate), Course(), [0.0] * FRAMES, np.arange(1, FRAMES + 1) / FRAMES
    for _ in range(20):
        past = with_headings(second, np.array(headings[-FRAMES:]))
        course, asked = course.followed(Condition(velocity=own), own, past, FREE)
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
        course, asked = course.followed(Condition(velocity=own), own, past, FREE)
        assert abs(heading_of(asked, past)) <= 0.5 * WINDOW_S + MOST_TURNED + 1e-9


def test_another_velocity_keeps_the_way(second: Motion) -> None:
    """At every change of velocity the way began where the body was, and a way keeper changes it in every window."""
    course, _ = Course().followed(Condition(velocity=WALK), WALK, moved(second, 0.0, speed=1.0), FREE)
    faster, words = (1.5 * WALK[0], 0.1, 0.0), Condition("march")
    after = moved(second, 0.0, (WINDOW_S, 0.4), speed=1.0)
    course, asked = course.followed(Condition(velocity=faster), faster, after, FREE)
    # The leftmost part of what it is aside of its way is not made up for in this window.
    across = np.array([-faster[1], faster[0]]) / np.hypot(*faster[:2])
    assert across @ (place_of(asked, after) - (WINDOW_S, 0.0)) == pytest.approx(0.4 - MOST_AWAY, abs=0.05)
    other, _ = course.followed(words, None, after, FREE)
    assert other.place == pytest.approx((WINDOW_S, 0.4)) and other.way is None


def test_a_gesture_is_asked_for_its_heading_alone_until_it_is_off(second: Motion) -> None:
    """Its words are of an unknown speed: a velocity beside them would hold the pelvis.

    Left alone within 2°, a look to the side swung by 15°: the window that came back went beyond.
    """
    wave, course = Condition("wave with the right hand"), Course()
    for yaw, place in ((0.0, (0.0, 0.0)), (radians(1.0), (0.02, 0.0)), (radians(6.0), (0.0, 0.0))):
        past = moved(second, yaw, place)
        course, asked = course.followed(wave, None, past, FREE, noise=0.7)
        assert asked.asked is None and asked.noise == 1.0
        assert heading_of(asked, past) == pytest.approx(0.0, abs=1e-9)
    _, asked = course.followed(wave, None, moved(second, 0.0, (0.1, 0.0)), FREE, noise=0.7)
    assert asked.asked is not None and asked.asked[0] < 0.0 and asked.noise == 0.7


def test_a_pelvis_that_goes_back_over_feet_that_stay_is_asked_for_no_velocity(second: Motion) -> None:
    """Regression: a squat takes the pelvis back by a decimetre, and was asked to walk ahead: it ended half way down."""
    bent = second.joints.copy()
    for side in SIDES:
        bent[:, JOINTS.index(f"hip_flexion_{side}")] = 0.11
    back = moved(replace(second, joints=bent), 0.0, (-0.1, 0.0))
    squat = Condition("squat")
    course, _ = Course().followed(squat, None, second, FREE)
    feet = foot_points(second)[..., 0].mean() - foot_points(back)[..., 0].mean()
    assert abs(feet) < 0.02
    course, asked = course.followed(squat, None, back, FREE)
    assert asked.asked is None
    _, asked = course.followed(squat, None, moved(second, 0.0, (-0.1, 0.0)), FREE)
    assert asked.asked is not None and asked.asked[0] > 0.0


def test_words_of_an_unknown_speed_travel_at_the_one_that_is_measured(second: Motion) -> None:
    march = Condition("march")
    course, _ = Course().followed(march, None, moved(second, 0.0, speed=0.8), FREE)
    _, asked = course.followed(march, None, moved(second, 0.2, speed=0.8), FREE)
    assert asked.asked is not None and asked.asked[0] == pytest.approx(0.8) and asked.asked[2] < 0


def test_a_motion_that_turns_by_itself_gets_a_new_heading(second: Motion) -> None:
    dance = Condition("dance")
    course, _ = Course().followed(dance, None, moved(second, 0.0), FREE)
    past = moved(second, float(LOST) + 0.1)
    course, asked = course.followed(dance, None, past, FREE)
    assert course.heading == pytest.approx(float(LOST) + 0.1) == heading_of(asked, past)
