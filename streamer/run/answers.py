"""`Answers`: what a run has heard so far, of its script or prompt and of targets."""

from __future__ import annotations

from flexmotion.streamer.motion.heard import Heard, HeardChannel, heard_since, merged
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import Source

_KEPT = 1000
"""Answers to targets that are kept."""


class Answers:
    """Collects answers from the channel; `listen` often enough that none is lost.

    Args:
        channel: of the planner.
        source: of the human, which answers the items of its script itself.
    """

    def __init__(self, channel: HeardChannel, source: Source) -> None:
        found = source.source if isinstance(source, NoisySource) else source
        self._items = list(found.heard_items) if isinstance(found, ModelSource) else []
        self._reader = channel.reader()
        self._targets: list[Heard] = []

    def listen(self) -> None:
        """Take the answers that have arrived."""
        new = heard_since(self._reader)
        if new:
            self._targets = merged([*self._targets, *new])[-_KEPT:]

    def newest(self) -> list[Heard]:
        """The answers so far, each in its newest version: those to the items, then those to targets."""
        self.listen()
        return merged([*self._items, *self._targets])
