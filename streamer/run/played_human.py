"""What the human did in a run, as far as it was played."""

from __future__ import annotations

import numpy as np

from flexmotion.human.motion import Motion
from flexmotion.streamer.control.run_trace import KEPT_S, RunTrace
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.sources import LiveSource, Performance, Source


def human_motion(source: Source, record: RunTrace) -> Motion | None:
    """What the human did in a run, as far as it was played.

    Returns:
        None where that is not known: the source followed targets, or steps that end when the robot has done them, or
        the run is longer than a record keeps.
    """
    if isinstance(source, NoisySource):
        return human_motion(source.source, record)
    if not isinstance(source, Performance):
        return None
    if not isinstance(source, LiveSource):
        return source.human()
    if isinstance(source, ModelSource) and source.is_measured:
        return None  # the robot's progress decided when each step ended
    played = record.source_s[record.source_s >= 0.0]
    if not len(played) or played[-1] > KEPT_S or record.ticks.target.any():
        return None
    return source.cut(min(float(played[-1]) + 1.0 / source.fps, source.seconds or np.inf)).human()
