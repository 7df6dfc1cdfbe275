"""Summary of a set: hours, kept and dropped clips, ranges of every field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from flexmotion.dataset.fields import Field
from flexmotion.dataset.settings import BuildSettings

SAMPLE = 16
"""Stride of the frames over which quantiles are computed."""

QUANTILES = {"p01": 0.01, "median": 0.5, "p99": 0.99}


class Ranges:
    """Minimum, maximum and quantiles of every field, accumulated clip by clip."""

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self._samples: dict[str, list[np.ndarray]] = {name: [] for name, field in fields.items()}
        self._bounds: dict[str, tuple[float, float]] = {}

    def add(self, name: str, values: np.ndarray) -> None:
        """Add a clip's values of one field."""
        low, high = self._bounds.get(name, (np.inf, -np.inf))
        self._bounds[name] = min(low, float(values.min())), max(high, float(values.max()))
        self._samples[name].append(values[::SAMPLE].ravel())

    def table(self) -> dict[str, dict[str, float]]:
        """Field -> min, p01, median, p99, max."""
        table = {}
        for name, (low, high) in self._bounds.items():
            values = np.concatenate(self._samples[name]).astype(np.float64)
            row = {"min": low, **{key: float(np.quantile(values, share)) for key, share in QUANTILES.items()}}
            table[name] = {key: float(f"{value:.6g}") for key, value in (row | {"max": high}).items()}
        return table


def summary(kept: list[dict[str, Any]], dropped: list[dict[str, Any]], settings: BuildSettings) -> dict[str, Any]:
    """Hours by split and collection, kept frames, dropped clips by reason; residuals and force errors by kind."""
    hours: Counter[str] = Counter()
    kinds: dict[str, list[dict[str, Any]]] = {}
    for clip in kept:
        spell = clip["frames"] / clip["fps"] / 3600
        for key in ("all", f"split {clip['split']}", f"collection {clip['collection']}", f"variant {clip['variant']}"):
            hours[key] += spell
        labels = clip["labels"]
        kinds.setdefault(labels.get("content") or labels.get("action") or "unlabelled", []).append(clip)
    for clip in dropped:
        labels = clip.get("labels", {})
        kinds.setdefault(labels.get("content") or labels.get("action") or "unlabelled", [])
    lost: Counter[str] = Counter()
    for clip in dropped:
        labels = clip.get("labels", {})
        lost[labels.get("content") or labels.get("action") or "unlabelled"] += clip.get("frames", 0)
    return {
        "hours": {key: round(value, 4) for key, value in sorted(hours.items())},
        "clips_kept": len(kept),
        "clips_dropped": dict(sorted(Counter(clip["reason"].partition(":")[0] for clip in dropped).items())),
        "flagged_share": round(_mean(kept, "flagged_share"), 4) if kept else 0.0,
        "by_kind": {kind: _kind(clips, lost[kind]) for kind, clips in sorted(kinds.items())},
    }


def _kind(clips: list[dict[str, Any]], lost: int) -> dict[str, Any]:
    frames = sum(clip["frames"] for clip in clips)
    good = sum(clip["frames"] * clip["good_share"] for clip in clips)
    row: dict[str, Any] = {"clips": len(clips), "frames": frames, "frames_dropped": lost}
    if clips:
        row["kept_share"] = round(good / (frames + lost), 4)
        medians = np.median([clip["residual_median"] for clip in clips], axis=0)
        row["residual_median"] = [round(float(value), 5) for value in medians]
        row["force_error_mean"] = round(_mean(clips, "force_error_mean"), 5)
        row["flagged_share"] = round(_mean(clips, "flagged_share"), 4)
    return row


def _mean(clips: list[dict[str, Any]], key: str) -> float:
    """Mean over frames of what clips say of theirs."""
    return float(np.average([clip[key] for clip in clips], weights=[clip["frames"] for clip in clips]))
