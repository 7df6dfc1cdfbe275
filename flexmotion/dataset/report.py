"""Summary of a set: hours, kept and dropped clips, ranges of every field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from flexmotion.dataset.fields import Field
from flexmotion.dataset.settings import BuildSettings

SAMPLE = 16
"""Stride of the frames over which quantiles are computed."""

RECORDED = ("original", "mirror")
"""Variants of a clip with the motion as recorded; all others are made from it."""

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
    """Hours by split and collection, kept frames, dropped clips by reason; residuals and force errors by kind.

    `by_kind` and `flagged_share` are of recorded clips and their mirror images, `by_variant` of all other variants.
    """
    hours: Counter[str] = Counter()
    for clip in kept:
        spell = clip["frames"] / clip["fps"] / 3600
        for key in ("all", f"split {clip['split']}", f"collection {clip['collection']}", f"variant {clip['variant']}"):
            hours[key] += spell
    recorded = [clip for clip in kept if _recorded(clip)]
    return {
        "hours": {key: round(value, 4) for key, value in sorted(hours.items())},
        "clips_kept": len(kept),
        "clips_dropped": dict(sorted(Counter(clip["reason"].partition(":")[0] for clip in dropped).items())),
        "flagged_share": round(_mean(recorded, "flagged_share"), 4) if recorded else 0.0,
        "by_kind": _rows(recorded, [clip for clip in dropped if _recorded(clip)], _content),
        "by_variant": _rows(
            [clip for clip in kept if not _recorded(clip)],
            [clip for clip in dropped if not _recorded(clip)],
            lambda clip: str(clip["variant"]),
        ),
    }


def _recorded(clip: dict[str, Any]) -> bool:
    """Whether a clip is recorded; one that could not be read has no variant."""
    return clip.get("variant", RECORDED[0]) in RECORDED


def _content(clip: dict[str, Any]) -> str:
    labels = clip.get("labels", {})
    return labels.get("content") or labels.get("action") or "unlabelled"


def _rows(
    kept: list[dict[str, Any]], dropped: list[dict[str, Any]], group: Callable[[dict[str, Any]], str]
) -> dict[str, dict[str, Any]]:
    """Figures of every group of clips."""
    found: dict[str, list[dict[str, Any]]] = {}
    lost: Counter[str] = Counter()
    for clip in kept:
        found.setdefault(group(clip), []).append(clip)
    for clip in dropped:
        found.setdefault(group(clip), [])
        lost[group(clip)] += clip.get("frames", 0)
    return {name: _kind(clips, lost[name]) for name, clips in sorted(found.items())}


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
