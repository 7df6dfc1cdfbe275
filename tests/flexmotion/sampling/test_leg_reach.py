"""Legs that bring their ankles and soles to places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.evaluation.motions import jerk
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import encode
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.kinematics import foot_points
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.leg_length import STRAIGHT
from flexmotion.sampling.leg_reach import shifted, smoothly_shifted
from flexmotion.sampling.placed_legs import placed

from .bent_knees import KNEES, bent_walk

LAYOUT = Layout(30.0)


@pytest.fixture(scope="module")
def walking() -> Motion:
    """Some steps with knees bent enough to be stretched."""
    return bent_walk(0.6)


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-0.12, 0.12) for _ in range(4)]), st.floats(0.0, 0.05))
def test_soles_are_moved_where_they_are_wanted_and_keep_their_pitch(ways: tuple[float, ...], up: float) -> None:
    motion = bent_walk(0.9)
    by = np.zeros((len(motion), 2, 3))
    by[..., :2], by[..., 2] = np.array(ways).reshape(2, 2), up
    found = shifted(motion, by, motion.joints[0])
    before, after = foot_points(motion), foot_points(found)
    np.testing.assert_allclose((after - before).mean(axis=2), by, atol=0.003)
    # The foot tilts with its leg, as the ankle has one axis; its pitch stays.
    np.testing.assert_allclose(np.diff(after, axis=2)[..., 2], np.diff(before, axis=2)[..., 2], atol=0.01)
    others = [at for at, name in enumerate(JOINTS) if not name.startswith(("hip", "knee", "ankle"))]
    np.testing.assert_array_equal(found.joints[:, others], motion.joints[:, others])


def test_a_foot_that_is_not_moved_keeps_its_leg(walking: Motion) -> None:
    by = np.zeros((len(walking), 2, 3))
    by[10:, 1, 0] = 0.05
    found = shifted(walking, by, walking.joints[0])
    left = [at for at, name in enumerate(JOINTS) if not name.endswith("_r")]
    np.testing.assert_allclose(found.joints[:, left], walking.joints[:, left], atol=1e-9)
    np.testing.assert_allclose(found.joints[:10], walking.joints[:10], atol=1e-9)


def test_a_leg_that_is_nearly_straight_follows_smoothly() -> None:
    """Knees of a walk that were bent frame by frame for millimetres jerked the body: its residual tripled."""
    motion = bent_walk(STRAIGHT)
    time = np.arange(len(motion)) / motion.fps
    by = np.zeros((len(motion), 2, 3))
    by[..., 0] = 0.02 * (1.0 - np.cos(2 * np.pi * time))[:, None]
    rough, smooth = (move(motion, by, motion.joints[0]) for move in (shifted, smoothly_shifted))
    assert jerk(smooth).mean() < jerk(rough).mean()
    off = (foot_points(smooth) - foot_points(rough)).mean(axis=2)
    assert np.linalg.norm(off, axis=-1).max() < 0.004
    np.testing.assert_allclose(smoothly_shifted(motion, 0 * by, motion.joints[0]).joints, motion.joints, atol=1e-9)


def test_a_place_out_of_reach_is_approached_by_a_straight_leg(walking: Motion) -> None:
    by = np.broadcast_to([0.0, 0.0, -1.0], (len(walking), 2, 3))
    found = shifted(walking, by, walking.joints[0])
    np.testing.assert_allclose(found.joints[:, KNEES], STRAIGHT, atol=1e-6)
    assert np.isfinite(found.joints).all()


def ankles_of(features: np.ndarray, body: Body) -> np.ndarray:
    """Ankles of decoded features by their joints, in the axes of the places that are decoded, (T, 2, 3) [m]."""
    motion = decode(features, LAYOUT, body, Anchor.origin())
    encoded = encode(motion.kinematics, LAYOUT)[:, LAYOUT.blocks["positions"]].reshape(len(motion), -1, 3)
    return np.asarray(encoded[:, [POINTS.index(f"ankle_{side}") for side in SIDES]] * body.leg)


@settings(max_examples=15, deadline=None)
@given(st.tuples(*[st.floats(-0.03, 0.03) for _ in range(4)]), st.floats(0.0, 0.03))
def test_decoded_ankles_are_where_they_were_decoded_to_be(ways: tuple[float, ...], up: float) -> None:
    """Sampled walks were 3 cm narrower than people's: ankles of the joints were not where the decoder had them."""
    motion = bent_walk(0.6).kinematics
    features = encode(motion, LAYOUT)
    places = features[:, LAYOUT.blocks["positions"]].reshape(len(features), -1, 3)
    ankles = [POINTS.index(f"ankle_{side}") for side in SIDES]
    places[:, ankles] += np.pad(np.array(ways).reshape(2, 2), [(0, 0), (0, 1)], constant_values=up) / motion.body.leg
    features[:, LAYOUT.blocks["positions"]] = places.reshape(len(features), -1)
    found = placed(features.astype(np.float32), LAYOUT, motion.body)
    np.testing.assert_allclose(ankles_of(found, motion.body), places[:, ankles] * motion.body.leg, atol=2e-3)
    others = [name for name in LAYOUT.blocks if name != "rotations"]
    for name in others:
        np.testing.assert_array_equal(
            found[:, LAYOUT.blocks[name]], features[:, LAYOUT.blocks[name]].astype(np.float32)
        )


def test_legs_that_end_at_their_places_stay_as_they_are(walking: Motion) -> None:
    features = encode(walking.kinematics, LAYOUT).astype(np.float32)
    np.testing.assert_allclose(placed(features, LAYOUT, walking.body), features, atol=2e-3)


def test_an_ankle_does_not_turn_round_in_a_deep_knee() -> None:
    """An ankle of -46° at a knee of 135° became one of 313°: the pitch of its foot passed half a turn."""
    motion = default_clip()[225:227]
    joints = motion.joints.copy()
    ankles = [JOINTS.index(f"ankle_dorsiflexion_{side}") for side in SIDES]
    joints[:, KNEES], joints[:, ankles] = np.radians(135.0), np.radians(-46.0)
    motion = replace(motion, joints=joints)
    found = shifted(motion, np.full((2, 2, 3), 0.01), joints[0])
    assert np.abs(found.joints[:, ankles] - joints[:, ankles]).max() < 0.2
