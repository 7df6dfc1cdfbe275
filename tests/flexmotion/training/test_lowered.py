"""Windows of raised hands in which a hand comes down."""

from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="the extra 'train' is not installed")

import torch

from flexmotion.features.layout import Layout
from flexmotion.training.lowered import LOWERED, lowers_hands


def test_a_hand_that_comes_down_is_not_raised() -> None:
    """Regression: asked for raised hands, a model lowered them every second: people in clips do so at once."""
    layout = Layout(30.0, muscles=False)
    kinds = ["raise-up-right-hand"] * 4 + ["raise-up-both-hands", "wave-right-hand", "raise-up-right-hand"]
    windows = torch.zeros(len(kinds), 32, layout.size)
    places = windows[..., layout.blocks["positions"]].unflatten(-1, (-1, 3))
    left, right = (layout.points.index(name) for name in ("hand_l", "hand_r"))
    up, down = torch.linspace(0.8, 2.0, 32), torch.linspace(2.0, 0.8, 32)
    places[0, :, right, 2] = up
    places[1, :, right, 2] = down
    places[2, :, right, 2] = torch.cat([up[::2], down[::2]])
    places[3, :, left, 2] = down  # the hand that was not asked for
    places[4, :, left, 2], places[4, :, right, 2] = up, down
    places[5, :, right, 2] = down  # a wave ends as people end it
    places[6, :, right, 2] = 1.5 + 0.45 * LOWERED * torch.sin(torch.arange(32.0))  # sways
    assert list(lowers_hands(kinds, windows, layout)) == [False, True, True, False, True, False, False]
