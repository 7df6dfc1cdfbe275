"""Joins of windows: jumps decay, continuous features are unchanged."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.features.inertialise import inertialised
from flexmotion.features.layout import Layout

LAYOUT = Layout(30.0)
HEIGHT = LAYOUT.blocks["root"].start + 3
TURNING = LAYOUT.blocks["root"].start + 2
ROTATIONS = LAYOUT.blocks["rotations"]


def _even(first: int, count: int, slope: float = 0.01, level: float = 0.0) -> np.ndarray:
    """Features that all increase linearly over frames."""
    return np.repeat(level + slope * np.arange(first, first + count)[:, None], LAYOUT.size, axis=1).astype(np.float32)


def test_a_continuous_window_is_unchanged() -> None:
    history, frames = _even(0, 8), _even(8, 32)
    travel = slice(LAYOUT.blocks["root"].start, HEIGHT)
    frames[:, travel] = history[-1, travel]
    np.testing.assert_allclose(inertialised(frames, history, LAYOUT), frames, atol=1e-6)


def test_a_jump_decays_smoothly() -> None:
    history, frames = _even(0, 8, slope=0.02), _even(8, 32, slope=-0.01, level=0.5)
    moved = inertialised(frames, history, LAYOUT)
    whole = np.concatenate([history, moved])[:, [HEIGHT, ROTATIONS.start]]
    raw = np.concatenate([history, frames])[:, [HEIGHT, ROTATIONS.start]]
    bend, before = (np.abs(np.diff(values, n=2, axis=0)).max() for values in (whole, raw))
    assert bend < 0.1 * before
    np.testing.assert_allclose(moved[-1], frames[-1], atol=0.01)
    # Only the velocity of the path jumps; torques and forces are not changed.
    assert moved[0, TURNING] == pytest.approx(history[-1, TURNING])
    for name in ("velocities", "torques", "wrenches", "contacts"):
        np.testing.assert_array_equal(moved[:, LAYOUT.blocks[name]], frames[:, LAYOUT.blocks[name]])


@pytest.mark.parametrize("known", [0, 1])
def test_without_a_history_the_window_is_unchanged(known: int) -> None:
    frames = _even(8, 32, level=1.0)
    assert inertialised(frames, _even(0, known), LAYOUT) is frames
