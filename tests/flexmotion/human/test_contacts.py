"""Foot contacts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.human.contacts import STATE_SIZE, ContactDetector
from flexmotion.human.kinematics import forward
from flexmotion.importers import load


def swings(flags: np.ndarray) -> list[tuple[int, int, int]]:
    """First frame, number of frames and foot of every swing, in order."""
    found = []
    for foot in (0, 1):
        edges = np.flatnonzero(np.diff(np.concatenate([[1], flags[:, foot].astype(int), [1]])))
        found += [(int(start), int(end - start), foot) for start, end in zip(edges[::2], edges[1::2], strict=True)]
    return sorted(found)


def lifted(human, frames: slice, foot: int, by: float):
    heel, toe = human.heel.copy(), human.toe.copy()
    for point in (heel, toe):
        point[frames, foot, 2] += by
    return replace(human, heel=heel, toe=toe)


@settings(max_examples=30)
@given(st.lists(st.integers(1, 359), max_size=12, unique=True))
def test_contacts_do_not_depend_on_chunks(clip_kinematics, cuts):
    detector = ContactDetector()
    whole_flags, whole_states = detector.detect(clip_kinematics, 30.0)
    state = None
    for start, end in pairwise([0, *sorted(cuts), len(clip_kinematics)]):
        flags, states = detector.detect(clip_kinematics[start:end], 30.0, state)
        np.testing.assert_array_equal(flags, whole_flags[start:end])
        np.testing.assert_array_equal(states, whole_states[start:end])
        state = states[-1]


def test_contacts_do_not_depend_on_later_frames(clip_kinematics):
    flags, _ = ContactDetector().detect(clip_kinematics, 30.0)
    other = lifted(clip_kinematics, slice(250, None), 0, 0.3)
    np.testing.assert_array_equal(ContactDetector().detect(other, 30.0)[0][:250], flags[:250])


def test_state_is_fixed_in_size_and_not_changed(clip_kinematics):
    detector = ContactDetector()
    start = detector.initial()
    flags, states = detector.detect(clip_kinematics[:7], 30.0, start)
    assert flags.shape == (7, 2)
    assert flags.dtype == np.bool_
    assert states.shape == (7, STATE_SIZE)
    assert states.dtype == np.float64
    np.testing.assert_array_equal(start, detector.initial())
    assert detector.detect(clip_kinematics[:0], 30.0)[0].shape == (0, 2)


def test_steps_of_the_default_clip(clip_kinematics):
    flags, _ = ContactDetector().detect(clip_kinematics, 30.0)
    found = swings(flags)
    assert [foot for _, _, foot in found] == [1, 0, 1, 0, 1]
    lift_off = np.array([8.06, 8.56, 9.06, 9.56, 10.06])
    # A foot counts as lifted after half of the lift and the delay of the detector.
    np.testing.assert_allclose([start / 30 for start, _, _ in found], lift_off + 0.13, atol=0.07)
    assert all(7 <= frames <= 12 for _, frames, _ in found)


@pytest.mark.parametrize("fps", [20.0, 30.0, 60.0])
def test_standing_with_noise_never_flickers(make_standing, fps):
    human = forward(make_standing(int(10 * fps)))
    noise = np.random.default_rng(0).normal(scale=0.003, size=(2, *human.heel.shape))
    flags, _ = ContactDetector().detect(replace(human, heel=human.heel + noise[0], toe=human.toe + noise[1]), fps)
    assert flags.all()


def test_a_foot_held_up_is_not_a_step(make_standing):
    human = lifted(forward(make_standing(150)), slice(30, 120), 0, 0.1)
    flags, _ = ContactDetector().detect(human, 30.0)
    assert flags[:, 1].all()
    assert swings(flags) == [(pytest.approx(31, abs=1), pytest.approx(90, abs=2), 0)]


def test_a_sliding_foot_is_lifted_and_a_rocking_one_is_not(make_standing):
    human = forward(make_standing(60))
    slide = np.zeros((60, 2, 3))
    slide[20:40, 0, 0] = np.linspace(0, 0.9, 20)
    slide[40:, 0, 0] = 0.9
    flags, _ = ContactDetector().detect(replace(human, heel=human.heel + slide, toe=human.toe + slide), 30.0)
    assert len(swings(flags)) == 1
    heel = human.heel.copy()
    heel[20:40, 0, 2] += 0.12
    flags, _ = ContactDetector().detect(replace(human, heel=heel), 30.0)
    assert flags.all()


@pytest.mark.parametrize("drift", [0.01, -0.01])
def test_a_drifting_floor_is_followed(clip, clip_kinematics, drift):
    flags, _ = ContactDetector().detect(clip_kinematics, 30.0)
    rise = np.zeros((len(clip), 1, 3))
    rise[:, 0, 2] = drift * np.arange(len(clip)) / 30.0
    moved = replace(clip_kinematics, heel=clip_kinematics.heel + rise, toe=clip_kinematics.toe + rise)
    found = swings(ContactDetector().detect(moved, 30.0)[0])
    assert [foot for *_, foot in found] == [foot for *_, foot in swings(flags)]


def test_a_stream_that_begins_in_mid_swing(clip_kinematics):
    start = swings(ContactDetector().detect(clip_kinematics, 30.0)[0])[0][0]
    # Low but fast: the second frame decides.
    flags, _ = ContactDetector().detect(clip_kinematics[start:], 30.0)
    assert not flags[1:4, 1].any()


WALKS = ("07_05", "07_09", "07_10", "08_02")
BANDAI_WALKS = ("dataset-2_walk_active_024", "dataset-1_walk-left_tired_001", "dataset-2_walk-turn-left_active_041")
GESTURES = ("dataset-2_raise-up-right-hand_active_033", "dataset-2_wave-right-hand_masculine_009")


@pytest.mark.parametrize(("collection", "names"), [("cmu", WALKS), ("bandai", BANDAI_WALKS)])
def test_recorded_walks_alternate(shared_clips, collection, names):
    for path in shared_clips(collection, *names):
        motion = load(path)
        flags, _ = ContactDetector().detect(forward(motion), motion.fps)
        found = swings(flags)
        # Swings cut off by the ends of the clip are incomplete.
        inner = [swing for swing in found if swing[0] > 8 and sum(swing[:2]) < len(motion) - 8]
        assert len(inner) >= 2, path.name
        assert all(a[2] != b[2] for a, b in pairwise(inner)), path.name
        assert all(8 <= frames <= 24 for _, frames, _ in inner), (path.name, inner)
        assert flags.any(axis=1).mean() > 0.95, path.name


def test_recorded_gestures_stand(shared_clips):
    for path in shared_clips("bandai", *GESTURES):
        motion = load(path)
        assert ContactDetector().detect(forward(motion), motion.fps)[0].all(), path.name


def test_known_forces_decide_with_hysteresis_and_delay(clip_kinematics):
    """A foot held low and slow carries no load, and force noise below a step's load is not a step."""
    human = clip_kinematics[:60]
    force = np.full((60, 2), 0.5)
    force[10:30, 0] = 0.02
    force[40, 1] = 0.0  # one frame is not a swing
    force[20, 0] = 0.3  # nor a step
    flags, states = ContactDetector().detect(human, 30.0, None, force)
    assert swings(flags) == [(11, 20, 0)]
    rest, _ = ContactDetector().detect(human[25:], 30.0, states[24], force[25:])
    np.testing.assert_array_equal(rest, flags[25:])
    little = np.tile([0.1, 0.8], (20, 1))
    between, _ = ContactDetector().detect(human[:20], 30.0, None, little)
    assert not between[:, 0].any()  # below the threshold of loading
    held, _ = ContactDetector().detect(human[20:40], 30.0, states[9], little)
    assert held.all()  # above the threshold of unloading


@pytest.mark.parametrize("total", [0.0, 0.29, 3.01, -1.0])
def test_heights_and_speeds_decide_where_forces_are_implausible(clip_kinematics, total):
    """Regression: with forces of zero both feet counted as lifted from the third frame on."""
    whole, _ = ContactDetector().detect(clip_kinematics, 30.0)
    found, _ = ContactDetector().detect(clip_kinematics, 30.0, None, np.full((len(clip_kinematics), 2), total / 2))
    np.testing.assert_array_equal(found, whole)


@pytest.mark.parametrize("total", [0.3, 3.0])
def test_forces_at_the_edge_of_the_plausible_decide(clip_kinematics, total):
    human = lifted(clip_kinematics[:60], slice(10, 40), 0, 0.3)
    force = np.tile([total, 0.0], (60, 1))
    flags, _ = ContactDetector().detect(human, 30.0, None, force)
    assert flags[:, 0].all() and not flags[:, 1].any()


def test_a_swinging_foot_is_never_loaded(clip, clip_kinematics):
    """Regression: forces that flickered in mid-swing split a stride, and the robot made two short steps or none."""
    swings, _ = ContactDetector().detect(clip_kinematics, clip.fps)
    speed = np.linalg.norm(np.diff(0.5 * (clip_kinematics.heel + clip_kinematics.toe), axis=0), axis=-1) * clip.fps
    force = np.full((len(swings), 2), 0.5)
    flags, _ = ContactDetector().detect(clip_kinematics, clip.fps, None, force)
    fast = np.concatenate([np.zeros((1, 2), bool), speed > 1.5])
    assert fast.sum() > 20
    # A foot counts as lifted shortly after it is.
    late = np.concatenate([np.zeros((2, 2), bool), fast[:-2]]) & fast
    assert not flags[late].any()


def test_heights_and_speeds_decide_after_the_forces_end(clip_kinematics):
    whole, _ = ContactDetector().detect(clip_kinematics, 30.0)
    _, states = ContactDetector().detect(clip_kinematics[:100], 30.0, None, np.full((100, 2), 0.5))
    after, _ = ContactDetector().detect(clip_kinematics[100:], 30.0, states[-1])
    np.testing.assert_array_equal(after[3:], whole[103:])
