"""A base without recordings."""

from __future__ import annotations

import pytest

from flexmotion.dataset.gestures.bases import Base

from ....standing_human import clip, standing


@pytest.fixture
def stand() -> Base:
    """Twelve seconds of standing."""
    return Base(clip("07_stand"), standing(12.0), "stand")
