"""Windows without the stroke of their kind."""

from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="the extra 'train' is not installed")

import torch

from flexmotion.features.layout import Layout
from flexmotion.training.strokes import without_stroke


def test_a_guard_is_neither_a_kick_nor_a_punch() -> None:
    """Regression: asked for a kick or a punch, a model did the same: most windows of both clips were a guard."""
    layout = Layout(30.0, muscles=False)
    kinds = ["kick", "kick", "punch", "punch", "slash", "walk", "kick", "punch"]
    windows = torch.zeros(len(kinds), 32, layout.size)
    places = windows[..., layout.blocks["positions"]].unflatten(-1, (-1, 3))
    speeds = windows[..., layout.blocks["velocities"]].unflatten(-1, (-1, 3))
    toe, hand, shoulder = (layout.points.index(name) for name in ("toe_r", "hand_l", "shoulder_l"))
    places[1, 20, toe, 2] = 0.8  # kicks
    speeds[3, 10, hand, 0] = 4.0  # strikes
    speeds[4, :, [hand, shoulder], 0] = 4.0  # steps ahead with its whole body
    speeds[6, 10, hand, 0] = 4.0  # strikes, and is no kick
    places[7, 20, toe, 2] = 0.8  # kicks, and is no punch
    assert list(without_stroke(kinds, windows, layout)) == [True, False, True, False, True, False, True, True]
