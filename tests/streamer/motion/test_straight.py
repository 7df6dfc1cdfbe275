"""What is asked without a turn keeps heading and place, with a model; logs say whether it did."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.concatenate import concatenate
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.log.source import pack, unpack
from flexmotion.streamer.motion.intents import Intent, Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


def played(source: ModelSource, seconds: float) -> Motion:
    parts = [source.window(first, 32) for first in range(0, round(30 * seconds), 32)]
    return concatenate([part for part in parts if part is not None])


def headings(
    sampler: Sampler, intents: Sequence[tuple[float, Intent]], seconds: float, *, straight: bool
) -> np.ndarray:
    """Headings, means over one second [degrees]."""
    items = [Item(at, intent) for at, intent in intents]
    motion = played(ModelSource(sampler, items, "test", 7, straight=straight), seconds)
    yaw: np.ndarray = np.degrees(continuous_heading(motion.root_quaternion))
    return np.convolve(yaw, np.ones(30) / 30, "valid")


def test_standing_does_not_turn(sampler: Sampler) -> None:
    """Regression: who stood turned by 50° in two minutes. Feet that rest keep the heading, course or not."""
    kept, alone = (headings(sampler, [(0.0, Text("stand still"))], 90.0, straight=on) for on in (True, False))
    assert np.abs(kept[150:]).max() < 1.0 and np.abs(alone[150:]).max() < 1.0


def test_a_walk_goes_straight(sampler: Sampler) -> None:
    kept, before = (headings(sampler, [(0.0, Velocity(0.5, 0.0, 0.0))], 60.0, straight=on) for on in (True, False))
    assert np.sqrt(np.mean(kept**2)) < 0.5 * np.sqrt(np.mean(before**2))
    assert abs(kept[-150:].mean()) < 8.0


def test_a_walk_after_a_turn_keeps_the_new_heading(sampler: Sampler) -> None:
    script = [(0.0, Velocity(0.0, 0.0, 0.5)), (4.0, Velocity(0.5, 0.0, 0.0))]
    yaw = headings(sampler, script, 30.0, straight=True)
    assert yaw[210] > 60.0 and abs(yaw[-150:].mean() - yaw[210]) < 15.0


def test_a_log_says_whether_the_course_was_kept(sampler: Sampler, tmp_path: Path) -> None:
    """Runs of earlier versions kept none, and are replayed without."""
    items = [Item(0.0, Text("walk"))]
    for straight in (True, False):
        parts, files = pack(ModelSource(sampler, items, "test", straight=straight))
        assert parts["straight"] is straight
        found = unpack(parts, files, tmp_path)
        assert isinstance(found, ModelSource) and found.straight is straight
    del parts["straight"]
    older = unpack(parts, files, tmp_path)
    assert isinstance(older, ModelSource) and not older.straight
