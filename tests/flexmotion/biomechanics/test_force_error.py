"""Estimated error of the ground force, and the cut-off at landings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.biomechanics import force_error as benchmark
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.biomechanics.floor_drift import on_level_floor
from flexmotion.biomechanics.force_error import (
    BOTH,
    FLAGGED,
    FORCE,
    SMALLEST,
    STEPPING,
    error_sources,
    force_error,
    removed_content,
)
from flexmotion.biomechanics.landing import CUTOFF as LANDING_CUTOFF
from flexmotion.biomechanics.landing import landing_cutoff
from flexmotion.biomechanics.smoothing import CUTOFF, smooth, smoothing_spline
from flexmotion.human.motion import Motion
from flexmotion.spatial.gravity import GRAVITY

FPS = 30.0


def estimate(left: float, right: float, alike: float = 0.0, removed: float = 0.0, residual: float = 0.0) -> np.ndarray:
    """Standard error in the middle of a clip of constant vertical forces [body weights]."""
    forces = np.zeros((31, 2, 3))
    forces[:, :, 2] = left, right
    every = np.ones(31)
    return force_error(error_sources(forces, alike * every, removed * every, residual * every, FPS))[15]


def test_the_share_is_uncertain_in_double_support_only() -> None:
    single, double = estimate(1.0, 0.0), estimate(0.5, 0.5)
    assert single[0] == pytest.approx(FORCE, rel=0.1)
    assert single[1] < 0.01
    assert double == pytest.approx(np.hypot(STEPPING, 0.5 * FORCE), rel=0.05)
    assert estimate(0.5, 0.5, alike=1.0) == pytest.approx(np.hypot(BOTH, 0.5 * FORCE), rel=0.05)


def test_every_source_raises_the_error() -> None:
    assert estimate(1.0, 0.0, removed=1.0)[0] > FLAGGED > estimate(1.0, 0.0)[0]
    assert estimate(1.0, 0.0, residual=0.5)[0] > FLAGGED


def test_no_force_has_the_smallest_error() -> None:
    """A flight's residual is no force of the ground: it ranked airborne feet above walking ones."""
    assert estimate(0.0, 0.0, removed=1.0, residual=0.3) == pytest.approx(SMALLEST)


def test_the_ends_of_a_clip_are_less_certain(make_standing) -> None:
    found = dynamics(make_standing(frames=40)).force_error
    assert (found[[0, -1]] > found[20] * 1.02).all()
    assert found.shape == (40, 2)


def test_content_above_the_cutoff(make_standing) -> None:
    motion = make_standing(frames=120)
    assert removed_content(motion, CUTOFF).max() < 1e-6
    path = motion.root_position.copy()
    path[:, 2] += 0.002 * np.sin(2 * np.pi * 10.0 * np.arange(120) / FPS)
    shaken = removed_content(replace(motion, root_position=path), CUTOFF)[20:-20]
    whole = 0.002 * (2 * np.pi * 10.0) ** 2 / GRAVITY / np.sqrt(2)
    assert (shaken > 0.4 * whole).all() and (shaken < 1.1 * whole).all()


def jump(standing: Motion, height: float) -> Motion:
    """A stand, a jump of that height [m] and a landing on both feet."""
    speed = np.sqrt(2 * GRAVITY * height)
    times = np.arange(len(standing)) / FPS - 1.0
    path = standing.root_position.copy()
    path[:, 2] += np.where((times > 0) & (times < 2 * speed / GRAVITY), speed * times - GRAVITY * times**2 / 2, 0.0)
    return replace(standing, root_position=path)


def test_a_jump_raises_the_cutoff_at_its_landing(make_standing) -> None:
    """At 6 Hz a landing was spread over .15 s: the feet carried half a body weight before they touched the floor."""
    standing = make_standing(frames=75)
    level = on_level_floor(smooth(jump(standing, 0.3), CUTOFF))
    found = landing_cutoff(level, CUTOFF)
    assert found is not None
    assert found.max() > 0.95 * LANDING_CUTOFF
    assert found[:15] == pytest.approx(CUTOFF) and found[-10:] == pytest.approx(CUTOFF)
    assert dynamics(jump(standing, 0.3)).force_error.max() > FLAGGED


def test_walking_and_small_hops_keep_their_cutoff(make_standing, clip: Motion) -> None:
    for motion in (clip, jump(make_standing(frames=75), 0.03)):
        assert landing_cutoff(on_level_floor(smooth(motion, CUTOFF)), CUTOFF) is None


def test_a_cutoff_of_every_frame() -> None:
    signal = np.random.default_rng(1).normal(size=(80, 2))
    same = smoothing_spline(signal, FPS, np.full(80, 6.0))
    assert same == pytest.approx(smoothing_spline(signal, FPS, 6.0), abs=1e-12)
    mixed = smoothing_spline(signal, FPS, np.where(np.arange(80) < 40, 3.0, 12.0))
    rough = np.std(np.diff(mixed, axis=0), axis=-1)
    assert rough[5:30].mean() < 0.5 * rough[50:75].mean()


def test_estimates_tell_errors_of_force_plates(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`good` did not tell: its correlation with the error was -.2 to .2."""
    monkeypatch.setenv("FLEXMOTION_SHARED", str(shared_data.parent))
    assert benchmark.main().passed
