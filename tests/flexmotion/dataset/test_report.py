"""Summaries of sets."""

from __future__ import annotations

from typing import Any

import pytest

from flexmotion.dataset.report import summary
from flexmotion.dataset.settings import BuildSettings


def entry(variant: str, frames: int, flagged: float, **more: Any) -> dict[str, Any]:
    return {
        "variant": variant,
        "frames": frames,
        "fps": 30.0,
        "split": "train",
        "collection": "any",
        "labels": {"content": "walk"},
        "good_share": 1.0,
        "residual_median": [0.01, 0.01],
        "force_error_mean": 0.05,
        "flagged_share": flagged,
    } | more


def test_variants_do_not_count_as_recorded_clips() -> None:
    """Regression: simulations that fell were lost frames of a kind, and simulated frames diluted the flagged ones."""
    kept = [entry("original", 100, 0.2), entry("mirror", 100, 0.2), entry("perturbed", 600, 0.0)]
    dropped = [
        entry("perturbed", 400, 0.0, reason="perturbed: the simulated human lost the motion at 1.0 s"),
        entry("original", 50, 0.0, reason="residual: 10 % of its frames are explained by ground forces"),
        {"labels": {"content": "walk"}, "reason": "unreadable: no frames"},
    ]
    found = summary(kept, dropped, BuildSettings())
    assert found["flagged_share"] == pytest.approx(0.2)
    walk, simulated = found["by_kind"]["walk"], found["by_variant"]["perturbed"]
    assert (walk["clips"], walk["frames"], walk["frames_dropped"]) == (2, 200, 50)
    assert walk["kept_share"] == pytest.approx(200 / 250)
    assert walk["flagged_share"] == pytest.approx(0.2)
    assert (simulated["clips"], simulated["frames"], simulated["frames_dropped"]) == (1, 600, 400)
    assert found["clips_kept"] == 3
    assert set(found["by_kind"]) == {"walk"} and set(found["by_variant"]) == {"perturbed"}
