"""Known collections of motion: licence, and whether weights trained on them may be used commercially."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import MotionSet
from flexmotion.dataset.training_set import SetClip
from flexmotion.human.motion import Motion

COMMERCIAL = frozenset({"cmu"})
"""Collections whose terms allow products: mocap.cs.cmu.edu: "may be used in commercial products"; the data themselves
may not be sold. A collection that is not named here is taken for one that does not."""

FREE = "commercial"
"""Name of the selection of all collections in `COMMERCIAL`, with captions of `FREE_CAPTIONS` alone."""

FREE_CAPTIONS = frozenset({"cmu_index", "gesture"})
"""Sources of captions whose terms allow products: descriptions of the database itself, and of made gestures. Those of
motion-language sets are for research."""


@dataclass(frozen=True)
class SelectedSet:
    """The clips of some collections of a set, as a set; see `MotionSet`.

    A clip that was made over another one is of that one's collection, and so under its licence.

    Args:
        source: the whole set.
        names: of the collections.
        captions: sources of the captions that are kept; None: all of them.
    """

    source: MotionSet
    names: frozenset[str]
    captions: frozenset[str] | None = None

    @cached_property
    def clips(self) -> tuple[SetClip, ...]:
        """Every clip of these collections."""
        return tuple(self._described(clip) for clip in self.source.clips if clip.info.get("collection") in self.names)

    def _described(self, clip: SetClip) -> SetClip:
        if self.captions is None:
            return clip
        kept = [caption for caption in clip.info["captions"] if caption["source"] in self.captions]
        return replace(clip, info=clip.info | {"captions": kept})

    @property
    def name(self) -> str:
        """See `MotionSet`."""
        return f"{self.source.name} --only {','.join(sorted(self.names))}"

    @property
    def hashes(self) -> dict[str, str]:
        """Hash of the whole set, and the selection."""
        captions = {} if self.captions is None else {"captions": ", ".join(sorted(self.captions))}
        return self.source.hashes | {"only": ", ".join(sorted(self.names))} | captions

    def select(self, split: str | None = None, variant: str | None = None) -> Iterator[SetClip]:
        """See `MotionSet`."""
        for clip in self.clips:
            if split in (None, clip.split) and variant in (None, clip.variant):
                yield clip

    def motion(self, clip: SetClip) -> Motion:
        """See `MotionSet`."""
        return self.source.motion(clip)

    def centres(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        return self.source.centres(clip)

    def good(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        return self.source.good(clip)

    def loads(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        return self.source.loads(clip)

    def force_error(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        return self.source.force_error(clip)


def only(source: MotionSet, names: Iterable[str]) -> MotionSet:
    """The clips of some collections of a set.

    Args:
        source: the whole set.
        names: of collections, or `FREE`; none: the whole set.

    Raises:
        ConfigError: the set has no clip of one of them, or no clip for training.
    """
    asked = {name.strip() for name in names if name.strip()}
    if not asked:
        return source
    there = {str(clip.info.get("collection")) for clip in source.clips}
    chosen = frozenset(COMMERCIAL & there if FREE in asked else ()) | (asked - {FREE})
    if unknown := sorted(chosen - there):
        raise ConfigError(f"--only {unknown[0]}: the set has no such collection, expected {', '.join(sorted(there))}")
    selected = SelectedSet(source, chosen, FREE_CAPTIONS if FREE in asked and chosen <= COMMERCIAL else None)
    if not any(clip.split == "train" for clip in selected.clips):
        raise ConfigError(f"--only {', '.join(sorted(asked))}: the set has no clip for training of it")
    return selected
