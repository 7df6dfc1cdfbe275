"""The criterion of `model/variants`."""

from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from benchmarks.model.variants import FORCES, HELD_OUT, WITH, WITHOUT, ratio, table, verdict


def rows(better: float) -> dict[str, dict[str, list[dict[str, float]]]]:
    """Two seeds; with variants every error on recorded clips is `better` times that without, on others twice it."""
    recorded, others = HELD_OUT

    def seeds(scale: float) -> list[dict[str, float]]:
        return [{"points_mm": 20.0, **dict.fromkeys(FORCES, scale * error)} for error in (0.5, 1.5)]

    return {
        WITHOUT: {recorded: seeds(1.0), others: seeds(1.0)},
        WITH: {recorded: seeds(better), others: seeds(2.0)},
    }


@pytest.mark.parametrize(("better", "holds"), [(0.8, True), (1.1, False)])
def test_variants_are_judged_by_forces_on_recorded_clips(better: float, holds: bool) -> None:
    found = rows(better)
    assert ratio(found, "recorded", "torques") == pytest.approx(better)
    assert ratio(found, "recorded", "points_mm") == 1.0
    assert verdict(found).holds == holds and f"{better:.3f}" in verdict(found).sentence
    assert table(found).row_count == len(HELD_OUT) * (1 + len(FORCES))
