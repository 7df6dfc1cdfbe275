"""Conditions that no model can be asked for."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import FlexMotionError
from flexmotion.sampling.condition import GREATEST_VELOCITY, Condition
from flexmotion.sampling.request import Requests
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import FASTEST


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"velocity": (nan, 0.0, 0.0)}, r"velocity is \(nan, 0.0, 0.0\), expected three numbers within \[±6, ±3, ±6\]"),
        ({"velocity": (0.0, inf, 0.0)}, "velocity is"),
        ({"velocity": (1e6, 0.0, 0.0)}, "velocity is"),
        ({"velocity": (0.0, 0.0, -6.1)}, "velocity is"),
        ({"velocity": (0.5, 0.0)}, "velocity is"),
        ({"velocity": ("fast", 0.0, 0.0)}, "velocity is"),
        ({"asked": (0.0, nan, 0.0)}, "asked is .*, expected three numbers that are finite"),
        ({"guidance": nan}, "guidance is nan, expected a finite number$"),
        ({"manner_guidance": inf}, "manner_guidance is inf"),
        ({"noise": nan}, "noise is nan, expected a finite number, 0 or more"),
        ({"noise": -1.0}, "noise is -1.0"),
    ],
)
def test_what_is_no_velocity_is_not_sampled(asked: dict[str, Any], told: str) -> None:
    """1e6 m/s was sampled, and infinity raised a LinAlgError: a condition took any number."""
    for kind in (FlexMotionError, ValueError):
        with pytest.raises(kind, match=told):
            Condition(**asked)


def test_live_targets_and_words_of_every_kind_are_conditions(bundle: Path) -> None:
    """A bound below what words mean would end a run at "dash"."""
    assert np.less_equal(FASTEST, GREATEST_VELOCITY).all()
    opened = Bundle(bundle)
    requests = Requests(opened, unjudged=True)
    for kind, speed in opened.manifest.corrections.speeds.items():
        assert requests.meant(Condition(velocity=speed)).velocity in (speed, None), kind
    assert Condition(velocity=(np.float32(0.5), np.float64(0.0), 0)).velocity == (0.5, 0.0, 0.0)


def test_one_number_that_is_not_finite_does_not_stay_in_a_sampler(bundle: Path) -> None:
    """One NaN velocity broke a sampler for good: it stayed in the network's inputs, where 0 times it is NaN."""
    sampler, fresh = (Sampler(Bundle(bundle)) for _ in range(2))
    for name in ("sentence", "velocity", "present"):
        sampler._inputs[name][:] = nan
    history, asked = sampler.standing(), Condition("wave")
    for condition in (asked, Condition(wordless=True), Condition(velocity=(0.5, 0.0, 0.0))):
        found, expected = (each.features(history, condition, seed=1) for each in (sampler, fresh))
        np.testing.assert_array_equal(found, expected)
        assert np.isfinite(found).all()
