"""Metrics on cases with a known result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.evaluation.embeddings import (
    diversity,
    frechet_distance,
    matching_distance,
    multimodality,
    r_precision,
)
from flexmotion.evaluation.interval import Interval, repeated
from flexmotion.evaluation.motions import foot_metrics, jerk
from flexmotion.evaluation.physics import beyond_muscles, physics_metrics
from flexmotion.human.motion import Motion


def test_frechet_distance_of_normal_distributions() -> None:
    rng = np.random.default_rng(0)
    first = rng.normal(size=(20_000, 3))
    assert frechet_distance(first, first) == pytest.approx(0.0, abs=1e-6)
    assert frechet_distance(first, first + [2.0, 0, 0]) == pytest.approx(4.0, abs=1e-6)
    # Independent axes: the squared difference of the standard deviations, summed over axes.
    assert frechet_distance(first, 3 * first) == pytest.approx(3 * (3 - 1) ** 2, rel=0.05)


def test_frechet_distance_of_degenerate_sets() -> None:
    flat = np.zeros((50, 4))
    assert frechet_distance(flat, flat + 1.0) == pytest.approx(4.0, abs=1e-2)


def test_r_precision() -> None:
    rng = np.random.default_rng(0)
    motions = np.eye(64)
    assert r_precision(motions, motions, rng) == (1.0, 1.0, 1.0)
    noise = rng.normal(size=(640, 8))
    top1, top2, top3 = r_precision(noise, rng.normal(size=(640, 8)), rng)
    assert top1 < top2 < top3 < 0.2


def test_distances() -> None:
    points = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert matching_distance(points, points[::-1]) == 5.0
    assert multimodality(points[None]) == 5.0
    assert 0.0 < diversity(points, np.random.default_rng(0)) < 5.0
    assert str(Interval.of([1.0, 3.0])) == "2 ± 1.4"
    interval = repeated(lambda rng: float(rng.normal()), seed=0)
    assert abs(interval.mean) < 1.0 and 0.0 < interval.half_width < 1.0


def test_feet_of_standing_and_sliding(make_standing) -> None:
    still = make_standing(30)
    assert foot_metrics(still) == pytest.approx(
        {"skate_ratio": 0.0, "skate_mm": 0.0, "float_mm": 0.0, "penetrate_mm": 0.0}, abs=1e-9
    )
    slide = np.linspace(0, 29 / 30, 30)[:, None] * [1.0, 0.0, 0.0]
    sliding = replace(still, root_position=still.root_position + slide)
    figures = foot_metrics(sliding)
    assert figures["skate_ratio"] == 1.0
    assert figures["skate_mm"] == pytest.approx(1000 / 30)
    high = replace(still, root_position=still.root_position + [0, 0, 0.105])
    assert foot_metrics(high)["float_mm"] == pytest.approx(100.0)
    low = replace(still, root_position=still.root_position - [0, 0, 0.105])
    assert foot_metrics(low)["penetrate_mm"] == pytest.approx(100.0)
    assert jerk(sliding) == pytest.approx(np.zeros(27), abs=1e-6)


def test_physics_of_a_motion_with_its_own_dynamics(clip: Motion) -> None:
    found = dynamics(clip[240:330])
    figures = physics_metrics(found.motion, found.centres)
    assert figures["actuation"] == pytest.approx(0.0, abs=1e-6)
    # Forces change little by a second smoothing and residual reduction.
    assert figures["contact_force"] < 10.0
    assert found.motion.torques is not None
    wrong = replace(found.motion, torques=found.motion.torques + found.motion.body.mass)
    assert physics_metrics(wrong, found.centres)["actuation"] == pytest.approx(1.0, abs=1e-6)
    with pytest.raises(ValueError, match="torques"):
        physics_metrics(replace(found.motion, torques=None), found.centres)


def test_physics_excludes_frames_with_extrapolated_accelerations(clip: Motion) -> None:
    found = dynamics(clip[240:330])
    assert found.motion.torques is not None
    spoilt = found.motion.torques.copy()
    spoilt[:EDGE] = spoilt[-EDGE:] = 1e3
    figures = physics_metrics(found.motion, found.centres)
    assert physics_metrics(replace(found.motion, torques=spoilt), found.centres) == figures
    short = dynamics(clip[240 : 240 + 2 * EDGE])
    with pytest.raises(ValueError, match="more than 12 frames"):
        physics_metrics(short.motion, short.centres)


def test_muscle_limits(clip: Motion) -> None:
    found = dynamics(clip[240:270])
    activations = np.full((len(found.motion), 4), 0.5)
    activations[:, 0] = 1.5
    motion = replace(found.motion, activations=activations)
    assert physics_metrics(motion, found.centres)["muscle_limit"] == pytest.approx(25.0)
    # Rounding to half precision is tolerated.
    rounded = replace(found.motion, activations=np.full((len(found.motion), 4), -1e-4))
    assert physics_metrics(rounded, found.centres)["muscle_limit"] == 0.0


def test_torques_that_muscles_cannot_produce(clip: Motion) -> None:
    pytest.importorskip("myo_sim", reason="extra 'biomech' is not installed")
    found = dynamics(clip[240:270]).motion
    assert found.torques is not None
    usual = beyond_muscles(found)
    assert usual < 50.0
    assert beyond_muscles(replace(found, torques=20 * found.torques)) == 100.0
    with pytest.raises(ValueError, match="torques"):
        beyond_muscles(replace(found, torques=None))
