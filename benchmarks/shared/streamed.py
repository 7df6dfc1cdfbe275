"""`streamed`: motion by words alone from standing, as the live source hands it on."""

from __future__ import annotations

from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item


def streamed(sampler: Sampler, text: str, seconds: float, seed: int) -> Motion:
    """Motion from standing; words with an amount ("a few steps") go on, since no robot says when they are done.

    Args:
        sampler: of a model.
        text: what to do.
        seconds: length of the motion [s].
        seed: of all noise.
    """
    source = ModelSource(sampler, [Item(0.0, Text(text))], text, seed)
    made = source.window(0, round(seconds * sampler.fps))
    assert made is not None
    return made
