"""Index of a `FeatureStore`: a set's clips as a store describes them, and whether two sets are of the same motion."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexmotion.dataset.compact_set import MotionSet
from flexmotion.dataset.training_set import SetClip
from flexmotion.features.layout import Layout
from flexmotion.human.signals import resample_signal, same_rate

INDEX = "index.json"

CONTENT = 2
"""Increased when a store of the same set holds more; 2: with external loads and error estimates."""

MOTION = ("start", "frames", "body")
"""Parts of a clip's entry that belong to its features; the others describe it."""

WHOLE_S = 1.0
"""A caption that begins and ends this near to its clip's start and end is one of the whole clip [s]."""

Entry = dict[str, Any]


def clip_entries(source: MotionSet, layout: Layout) -> list[Entry]:
    """The clips of a set at the rate of a layout, as `StoredClip` has them."""
    entries, start = [], 0
    for clip in source.clips:
        count = stored_frames(clip, layout.fps)
        captions = clip.info["captions"]
        entries.append(
            {
                "name": clip.name,
                "start": start,
                "frames": count,
                "split": clip.split,
                "variant": clip.variant,
                "labels": clip.info["labels"],
                "captions": [caption["text"] for caption in captions],
                "spans": [_span(caption, count / layout.fps) for caption in captions],
                "body": clip.info["body"],
            }
        )
        start += count
    return entries


def licences_of(source: MotionSet) -> list[str]:
    """Licences of the clips of a set."""
    return sorted({clip.info["licence"] for clip in source.clips if clip.info["licence"]})


def key_of(source: MotionSet, layout: Layout, content: int = CONTENT) -> str:
    """What identifies the motion of a set, its layout and what a store holds of it."""
    found = json.dumps([source.hashes, layout.hash, content], sort_keys=True)
    return hashlib.sha256(found.encode()).hexdigest()


def is_of(index: dict[str, Any], source: MotionSet, layout: Layout, entries: Sequence[Entry]) -> bool:
    """Whether the features of a store are of the motion of a set, whatever the clips' splits and descriptions.

    Args:
        index: of the store.
        source: the set.
        layout: of the features that are asked for.
        entries: `clip_entries` of the set.
    """
    same_clips = _motion(index["clips"]) == _motion(entries)
    # Earlier versions wrote no name, and identified the motion of a compact file by all of the file and its name.
    return same_clips and ("set" not in index or index["key"] in _keys(source, layout))


def changes(before: Sequence[Entry], after: Sequence[Entry]) -> str:
    """In what the descriptions of clips differ, such as "split of 3 clips, labels of 1"; empty where in nothing."""
    names = [name for name in (after[0] if after else ()) if name not in MOTION]
    counts = {
        name: sum(_plain(one.get(name)) != _plain(other[name]) for one, other in zip(before, after, strict=True))
        for name in names
    }
    return ", ".join(f"{name} of {count} clip{'s' if count > 1 else ''}" for name, count in counts.items() if count)


def stored_frames(clip: SetClip, fps: float) -> int:
    """Number of frames of a clip at another rate, as `resample` gives."""
    if same_rate(clip.fps, fps):
        return clip.frames
    return len(resample_signal(np.zeros(clip.frames), clip.fps, fps))


def _keys(source: MotionSet, layout: Layout) -> list[str]:
    return [key_of(source, layout, content) for content in range(1, CONTENT + 1)]


def _motion(entries: Sequence[Entry]) -> str:
    return _plain([[entry[name] for name in MOTION] for entry in entries])


def _plain(value: object) -> str:
    """As JSON: an index that was read has lists for tuples."""
    return json.dumps(value, sort_keys=True)


def _span(caption: dict[str, Any], seconds: float) -> tuple[float, float]:
    """Start and end of a caption [s]; zeros where it is one of the whole clip."""
    start, end = float(caption["start"]), float(caption["end"])
    whole = not end or (start <= WHOLE_S and end >= seconds - WHOLE_S)
    return (0.0, 0.0) if whole else (start, end)
