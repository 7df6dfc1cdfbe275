"""Logs say whether the windows of a model were balanced; earlier versions are replayed as they were sampled."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.log.source import pack, unpack
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.person_channel import PersonChannel
from flexmotion.streamer.motion.script import Item


def source(bundle: Path, *, balanced: bool) -> ModelSource:
    return ModelSource(Sampler(Bundle(bundle), balanced=balanced), [Item(0.0, Text("walk"))], "test", 3)


def played(source: ModelSource) -> list[Motion]:
    parts = [source.window(first, 32) for first in (0, 32, 64)]
    assert all(part is not None for part in parts)
    return [part for part in parts if part is not None]


def same(one: Motion, other: Motion) -> bool:
    return all(np.array_equal(getattr(one, item.name), getattr(other, item.name)) for item in fields(Motion))


@pytest.mark.parametrize("balanced", [True, False])
def test_a_log_is_replayed_as_it_was_sampled(bundle: Path, tmp_path: Path, balanced: bool) -> None:
    run = source(bundle, balanced=balanced)
    parts, files = pack(run)
    assert parts["balanced"] is balanced
    again = unpack(parts, files, tmp_path)
    assert isinstance(again, ModelSource) and again.sampler.balanced is balanced
    assert all(same(one, other) for one, other in zip(played(run), played(again), strict=True))


def test_a_log_of_an_earlier_version_is_replayed_without_balance(bundle: Path, tmp_path: Path) -> None:
    earlier = source(bundle, balanced=False)
    parts, files = pack(source(bundle, balanced=True))
    del parts["balanced"]
    again = unpack(parts, files, tmp_path)
    assert isinstance(again, ModelSource)
    found = played(again)
    assert all(same(one, other) for one, other in zip(played(earlier), found, strict=True))
    newer = played(source(bundle, balanced=True))
    assert np.abs(newer[-1].joints - found[-1].joints).max() > 1e-3


@pytest.mark.parametrize("balanced", [True, False])
def test_a_log_of_a_mirrored_person_says_whether_its_sampler_balanced(
    bundle: Path, tmp_path: Path, balanced: bool
) -> None:
    """It was replayed by a sampler that balances, whichever the run had."""
    sampler = Sampler(Bundle(bundle), balanced=balanced)
    parts, files = pack(MirrorSource(PersonChannel(), sampler))
    again = unpack(parts, files, tmp_path)
    assert isinstance(again, MirrorSource) and again.sampler is not None and again.sampler.balanced is balanced
    del parts["balanced"]
    earlier = unpack(parts, files, tmp_path)
    assert isinstance(earlier, MirrorSource) and earlier.sampler is not None and not earlier.sampler.balanced


def test_only_balanced_windows_change_with_the_next_one(bundle: Path) -> None:
    settled, sampler = source(bundle, balanced=False), Sampler(Bundle(bundle))
    first = settled.window(0, 32)
    assert first is not None and settled.sampler.unsettled == 0 and sampler.unsettled > 0
    assert settled.window(0, 64) is not None
    again = settled.window(0, 32)
    assert again is not None and same(first, again)


def test_without_balance_windows_are_as_planted(bundle: Path) -> None:
    sampler, condition = Sampler(Bundle(bundle), balanced=False), Condition("walk")
    history = sampler.standing()
    window = sampler.sample(history, condition, 3)
    assert same(window, sampler.planted(sampler.features(history, condition, 3), history, condition))
