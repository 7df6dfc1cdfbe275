"""The judge of onsets: what is beyond people fails, kind by kind and change by change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.model.onsets import FIGURES, figures, outcome
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS


def _row(kind: str, **over: float) -> dict[str, object]:
    return {"before": "stand", "kind": kind} | {f"{name}_over": over.get(name, 0.5) for name in FIGURES}


def _change(hand: float) -> dict[str, object]:
    return {"before": "wave", "kind": "bow", "hand": hand}


@pytest.mark.parametrize("figure", FIGURES)
def test_a_kind_beyond_people_fails(figure: str) -> None:
    changes = [_change(1.0)] * 10
    fine = outcome([_row("walk"), _row("bow")], changes, 3.0)
    beyond = outcome([_row("walk"), _row("bow", **{figure: 1.01})], changes, 3.0)
    assert all(verdict.holds for verdict in fine.verdicts)
    failed = [verdict.sentence for verdict in beyond.verdicts if not verdict.holds]
    assert len(failed) == 1 and figure in failed[0] and "bow" in failed[0]


def test_hands_that_are_fast_between_kinds_fail() -> None:
    rows = [_row("walk")]
    assert not all(verdict.holds for verdict in outcome(rows, [_change(1.0)] * 9 + [_change(3.1)], 3.0).verdicts)
    assert not all(verdict.holds for verdict in outcome(rows, [_change(1.0)] * 99 + [_change(6.1)], 3.0).verdicts)
    assert all(verdict.holds for verdict in outcome(rows, [_change(1.0)] * 99 + [_change(3.1)], 3.0).verdicts)


def test_who_leans_from_the_first_frame_does_not_bend(circling: Callable[..., Motion]) -> None:
    """Went wrong: one person's stance, 18° off upright, was the limit of nods."""
    still = circling(2)
    leaning = replace(still, joints=still.joints.copy())
    leaning.joints[:, JOINTS.index("lumbar_extension")] -= 0.3
    upright, leant = (figures(motion)["bend"] for motion in (still, leaning))
    np.testing.assert_allclose(leant, upright, atol=0.5)
