"""Gestures of repeated strokes: nods, shaken heads, claps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.dataset.gestures.clearance import clearance
from flexmotion.evaluation.motions import jerk
from flexmotion.gestures.moved import NECK
from flexmotion.gestures.recipes import recipes
from flexmotion.human.body import Body
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.rhythm import SIZES, TURNS, Rhythm, is_rhythm, rhythm_kinds

from ...standing_human import standing

BEFORE, WINDOW = 8, 32
TOUCH = 0.03
"""Depth to which clapping hands may overlap, as in the recipe's own clips [m]."""


@pytest.fixture(scope="module")
def human() -> Motion:
    return standing(14.0)


def played(rhythm: Rhythm, human: Motion, windows: int, before: Motion | None = None) -> Motion:
    """A gesture over a standing human, window after window, and the frames before it."""
    known = human[:BEFORE] if before is None else before
    joints = known.joints
    for number in range(windows):
        first = BEFORE + number * WINDOW
        last = replace(human[first - 2 : first], joints=joints[-2:])
        window = rhythm.later(number * WINDOW).kept(human[first : first + WINDOW], last)
        joints = np.concatenate([joints, window.joints])
    return replace(human[: len(joints)], joints=joints)


def of(kind: str, human: Motion, size: int = 0) -> Rhythm:
    return Rhythm.of(kind, human.body, human.joints[0], size)


def test_the_kinds_are_those_whose_strokes_follow_each_other_and_their_mirror_images() -> None:
    assert rhythm_kinds() == {
        *("nod", "shake-head", "look-around", "shrug", "clap", "beckon-left-hand", "beckon-right-hand"),
        *("shake-hands-left-hand", "shake-hands-right-hand"),
    }
    squat = next(gesture for gesture in recipes() if gesture.kind == "squat")
    assert not is_rhythm(squat), "it moves the legs"


@pytest.mark.parametrize("kind", sorted(rhythm_kinds()))
def test_it_goes_on_from_the_motion_before_it_and_from_window_to_window(kind: str, human: Motion) -> None:
    joints = played(of(kind, human), human, 12).joints
    speed = np.diff(joints, axis=0) * human.fps
    assert np.abs(speed[BEFORE - 1]).max() < 0.6, "it begins from rest"
    # Strokes of minimum jerk: no join is harder than the strokes themselves.
    change = np.abs(np.diff(speed, axis=0)).max(axis=1)
    joins = BEFORE - 2 + WINDOW * np.arange(1, 12)
    assert change[joins].max() <= 1.05 * np.delete(change, joins)[WINDOW:].max()
    lowest, highest = joint_limits().T
    assert (joints >= lowest - 1e-9).all() and (joints <= highest + 1e-9).all()


@pytest.mark.parametrize("height", [1.5, 1.75, 2.0])
@pytest.mark.parametrize("kind", sorted(rhythm_kinds()))
def test_hands_stay_clear_of_the_body_at_every_height(kind: str, height: float) -> None:
    human = standing(6.0, Body(height, 70.0))
    for size in range(SIZES if height == 1.75 else 2):
        motion = played(of(kind, human, size), human, 2)
        assert clearance(motion) > (-TOUCH if kind == "clap" else min(0.0, clearance(human)) - 0.005)


def test_a_nod_moves_the_neck_alone_and_claps_bring_both_hands_together(human: Motion) -> None:
    nodded = played(of("nod", human), human, 6)
    others = np.delete(nodded.joints, NECK, axis=1)
    assert np.ptp(others, axis=0).max() < np.ptp(human.joints, axis=0).max() + 1e-9
    assert np.ptp(nodded.joints[:, NECK[0]]) > np.radians(13.0)
    hands = forward(played(of("clap", human), human, 6)).hand
    apart = np.linalg.norm(hands[:, 0] - hands[:, 1], axis=1)[2 * WINDOW :]
    assert apart.min() < 0.12 and apart.max() > 0.22


@pytest.mark.parametrize(("kind", "most"), [("clap", 34.0), ("shake-hands-right-hand", 14.0)])
def test_strokes_are_as_smooth_as_those_of_recorded_motion(kind: str, most: float, human: Motion) -> None:
    """Claps jerked by 35 m/s³, clips of the same recipe by 21: those are low-passed as all recorded motion is."""
    motion = played(of(kind, human), human, 6)
    assert jerk(motion).mean() < most
    hands = forward(motion[60:]).wrist
    assert np.ptp(hands, axis=0).max() > 0.05, "the strokes are as far as before"


def test_an_arm_that_was_elsewhere_comes_to_the_gesture_and_one_that_had_turned_over_does_not_turn_back(
    human: Motion,
) -> None:
    elbow, turn = JOINTS.index("elbow_flexion_r"), JOINTS.index("shoulder_rotation_r")
    joints = human.joints[:8].copy()
    joints[:, elbow] += 1.0
    joints[:, turn] += 2 * np.pi
    made = played(of("beckon-right-hand", human), human, 3, replace(human[:BEFORE], joints=joints)).joints
    usual = played(of("beckon-right-hand", human), human, 3).joints
    assert np.abs(np.diff(made, axis=0)).max() < 0.35, "no joint leaps"
    assert made[-1, elbow] == pytest.approx(usual[-1, elbow], abs=1e-3)
    assert made[-1, turn] - usual[-1, turn] == pytest.approx(2 * np.pi, abs=1e-3)


@given(st.sampled_from(sorted(rhythm_kinds())), st.integers(1, 3 * TURNS))
@settings(deadline=None, max_examples=40)
def test_the_time_of_some_repetitions_has_just_so_many(kind: str, times: int) -> None:
    human = standing(0.5)
    rhythm = of(kind, human)
    seconds = rhythm.seconds(times)
    assert rhythm.times(seconds) == times and rhythm.times(seconds - 1e-6) == times - 1
    assert rhythm.seconds(times + 1) > seconds
    first, later = (
        rhythm._angles(np.array([at])) for at in (seconds, seconds + rhythm.seconds(TURNS + 1) - rhythm.seconds(1))
    )
    assert np.allclose(first, later, atol=1e-9), "strokes come again as they were"


def test_it_is_done_slower_as_it_is_asked_and_faster_as_far_as_its_strokes_go(human: Motion) -> None:
    """Slow nods were as quick as any, and "slowly" was told as left out."""
    nod, clap = of("nod", human), of("clap", human)
    assert nod.paced(0.6).seconds(3) == pytest.approx(nod.seconds(3) / 0.6)
    assert 1.0 < nod.paced(1.4).speed <= 1.4
    assert clap.paced(3.0).speed < 1.1, "its strokes are as brief as the recipe allows"
    for factor in (0.3, 0.6, 2.0):
        assert min(stroke.end - stroke.start for stroke in nod.paced(factor).plan.strokes) >= nod.shortest - 1e-9
    slow, usual = (np.abs(np.diff(played(one, human, 8).joints[:, NECK[0]])).max() for one in (nod.paced(0.5), nod))
    assert slow == pytest.approx(0.5 * usual, rel=0.1)


def test_it_is_of_many_sizes_in_the_same_time(human: Motion) -> None:
    for kind in rhythm_kinds() - {"clap"}:  # its recipe leaves its speed open, and nothing else
        sizes = [of(kind, human, size) for size in range(SIZES)]
        assert len({one.seconds(3) for one in sizes}) == 1
        poses = np.array([played(one, human, 4).joints[BEFORE:] for one in sizes])
        assert (np.abs(poses[1:] - poses[0]).max(axis=(1, 2)) > 0.02).all(), f"{kind} is always the same"
