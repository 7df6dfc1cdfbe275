"""`SetSummary`: what a bundle and a release need of the training set, without its clips."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexmotion.configs.model import Window
from flexmotion.dataset.meaning import clip_manner
from flexmotion.features.layout import POINTS, Layout
from flexmotion.features.statistics import Statistics
from flexmotion.human.body import Body, Segments
from flexmotion.human.skeleton import SIDES
from flexmotion.text.phrases import ALIASES, STAND, WALK, kinds
from flexmotion.training.conditions import STILL, clip_kind
from flexmotion.training.feature_store import FeatureStore, StoredClip
from flexmotion.training.window_set import WindowSet

SUMMARY = "summary.npz"

_LISTS = ("licences", "kinds", "manners")


@dataclass(frozen=True)
class SetSummary:
    """Figures of the training split of a set.

    Attributes:
        statistics: mean and standard deviation by which features are normalised.
        rest: features of a human who stands still, not normalised, (frames, F).
        segments: median proportions of the humans: lengths over leg length; angles [rad].
        licences: of the collections.
        kinds: of motion that its clips show, in the order of `flexmotion.text.phrases.kinds`.
        manners: that its clips show.
        hours, clips: size, mirror images and variants included.
    """

    statistics: Statistics
    rest: np.ndarray
    segments: dict[str, float]
    licences: tuple[str, ...]
    kinds: tuple[str, ...]
    manners: tuple[str, ...]
    hours: float
    clips: int

    def with_proportions(self, body: Body) -> Body:
        """A human of this size with the proportions of the set.

        With other proportions the same joint angles would put the feet above or below the floor.
        """
        scaled = {
            name: round(value * (body.leg if _is_length(name) else 1.0), 5) for name, value in self.segments.items()
        }
        return replace(body, fitted=Segments(**scaled))

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays: `mean`, `spread` and `rest`."""
        return {"mean": self.statistics.mean, "spread": self.statistics.spread, "rest": self.rest}

    def figures(self) -> dict[str, Any]:
        """The rest, for JSON."""
        lists = {name: list(getattr(self, name)) for name in _LISTS}
        return {"segments": self.segments, **lists, "hours": self.hours, "clips": self.clips}

    @classmethod
    def of(cls, arrays: dict[str, np.ndarray], figures: dict[str, Any]) -> SetSummary:
        """The summary of `arrays()` and `figures()`."""
        statistics = Statistics(arrays["mean"], arrays["spread"])
        return cls(statistics, arrays["rest"], **{**figures, **{name: tuple(figures[name]) for name in _LISTS}})

    def write(self, folder: Path) -> None:
        """Write the file `SUMMARY` in a folder."""
        figures = np.array(json.dumps(self.figures()))
        np.savez_compressed(folder / SUMMARY, figures=figures, **self.arrays())  # type: ignore[arg-type]

    @classmethod
    def read(cls, folder: Path) -> SetSummary:
        """Read the file `SUMMARY` in a folder."""
        with np.load(folder / SUMMARY) as found:
            arrays = {name: found[name] for name in ("mean", "spread", "rest")}
            return cls.of(arrays, json.loads(str(found["figures"])))


def summarise(store: FeatureStore, window: Window, seed: int) -> SetSummary:
    """The summary of a store.

    Args:
        store: features of a set.
        window: of the model.
        seed: of the windows among which the standing human is looked for.
    """
    training = [clip for clip in store.clips if clip.split == "train"]
    return SetSummary(
        statistics=store.statistics,
        rest=standing_features(store, window, seed),
        segments=_proportions(store),
        licences=store.licences,
        kinds=_shown_kinds(training),
        manners=_shown_manners(training),
        hours=sum(clip.frames for clip in training) / window.fps / 3600,
        clips=len(training),
    )


def _proportions(store: FeatureStore) -> dict[str, float]:
    """Median proportions of a store's humans, weighted by their frames."""
    # Variants have bodies that nobody recorded.
    clips = [clip for clip in store.clips if clip.split == "train" and clip.recorded]
    seconds = np.maximum(np.array([clip.frames for clip in clips]) // round(store.layout.fps), 1)
    found = {}
    for name in (item.name for item in fields(Segments)):
        values = [getattr(clip.body.segments, name) / (clip.body.leg if _is_length(name) else 1.0) for clip in clips]
        found[name] = float(np.median(np.repeat(values, seconds)))
    return found


def _shown_kinds(clips: Sequence[StoredClip]) -> tuple[str, ...]:
    """Kinds of motion with wordings that clips show; standing is in every set."""
    found = {clip_kind(clip) for clip in clips}
    # Straight windows of turning clips are trained as walking.
    straight = {WALK for kind in found if kind.startswith("walk-turn")}
    own = {ALIASES.get(kind, kind) for kind in found} | straight | {STAND}
    return tuple(kind for kind in kinds() if kind in own)


def _shown_manners(clips: Sequence[StoredClip]) -> tuple[str, ...]:
    found = {clip_manner(clip.labels, clip.captions) for clip in clips}
    return tuple(sorted(name for name in found if name is not None))


def _is_length(name: str) -> bool:
    return name != "toe_out"


def standing_features(store: FeatureStore, window: Window, seed: int) -> np.ndarray:
    """Features of a human who stands still, arms hanging, not normalised, (H, F): the stretch nearest to the median."""
    window = window.model_copy(update={"history": 0, "future": max(window.history, 1)})
    windows = WindowSet(store, window, "train", variants=False).draw((seed, 41), 4096)
    features = store.statistics.restore(windows.future.numpy())
    speed = features[..., layout_columns(store.layout, ("velocities",))]
    still = np.abs(speed).mean(axis=(1, 2)) < STILL / 4
    upright = features[..., store.layout.blocks["root"]][..., -1, 3] > 1.0
    places = features[..., store.layout.blocks["positions"]].reshape(*features.shape[:2], len(POINTS), 3)
    hands, hips = (places[:, -1, [POINTS.index(f"{name}_{side}") for side in SIDES], 2] for name in ("hand", "hip"))
    resting = still & upright & (hands < hips).all(axis=1)
    chosen = features[resting] if resting.any() else features
    poses = chosen[:, -1, layout_columns(store.layout, ("rotations",))]
    nearest = np.linalg.norm(poses - np.median(poses, axis=0), axis=1).argmin()
    rest: np.ndarray = chosen[nearest].astype(np.float32)
    return rest


def layout_columns(layout: Layout, names: Sequence[str]) -> list[int]:
    """Columns of some blocks."""
    return [at for name in names for at in range(layout.blocks[name].start, layout.blocks[name].stop)]
