"""Clips of a training set, for comparison with generated motion."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

from flexmotion.dataset.compact_set import MotionSet
from flexmotion.dataset.training_set import SetClip
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.text.sides import mirrored


def kind_of(clip: SetClip) -> str:
    """Kind of motion of a clip, by its labels; of a mirror image, the mirrored kind."""
    labels = clip.info["labels"]
    label: str = labels.get("content") or labels.get("action") or ""
    return mirrored(label) if clip.variant == "mirror" else label


def real_clips(
    found: MotionSet, split: str, fps: float, *, variant: str | None = "original", kinds: Collection[str] | None = None
) -> Iterator[tuple[SetClip, Motion]]:
    """Clips of a split at a frame rate, without their muscles.

    Args:
        found: the set.
        split: `train` or `validation`.
        fps: frames per second.
        variant: `original`, `mirror`, `varied`; None for all.
        kinds: of motion; None for all.
    """
    for clip in found.select(split, variant):
        if kinds is None or kind_of(clip) in kinds:
            yield clip, resample(replace(found.motion(clip), activations=None), fps)
