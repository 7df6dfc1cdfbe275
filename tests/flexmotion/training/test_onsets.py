"""When clips begin to show their motion."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.training.onsets import onset


def body(moved: np.ndarray) -> np.ndarray:
    """Four points of which each is moved ahead by a distance in every frame, (T, 4, 3) [leg]."""
    return np.repeat(moved[:, None], 4, axis=1)[..., None] * [1.0, 0.0, 0.0]


@pytest.mark.parametrize("waits", [0, 12, 50])
def test_a_bow_begins_when_the_body_leaves_its_first_pose(waits: int) -> None:
    """Regression: people stand before they bow. Those windows were taught as bows, so that the model stood too."""
    bow = 0.4 * np.sin(np.linspace(0.0, np.pi, 40)) ** 2
    swaying = 0.01 * np.sin(np.arange(waits))
    found = onset(body(np.concatenate([swaying, bow])))
    assert waits <= found <= waits + 8


def test_a_stand_has_no_onset() -> None:
    assert onset(body(0.03 * np.sin(np.arange(100) / 10.0))) == 0


def test_a_clip_that_begins_in_its_motion_begins_at_once() -> None:
    assert onset(body(np.linspace(0.0, 1.0, 60))) <= 6
