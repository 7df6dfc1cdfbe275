"""Conditions that no model can be asked for."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import FlexMotionError
from flexmotion.features.constraints import Constraints
from flexmotion.human.body import Body
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
        ({"tempo": nan}, "tempo is nan, expected a finite number, 0 or more"),
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


def test_errors_of_a_sampler_are_those_of_the_library(bundle: Path) -> None:
    """A negative seed, or an empty history, was a plain ValueError, which `except fm.FlexMotionError` let go."""
    sampler = Sampler(Bundle(bundle), balanced=False)
    history, walk = sampler.standing(), Condition("walk")
    other = Constraints.none(sampler.layout, Body(height=1.5), sampler.future).mean_heading(0.1)
    for past, asked, seed, told in (
        (history, walk, -1, "seed is -1, expected a whole number, 0 or more"),
        (history, walk, 0.5, "seed is 0.5"),
        (history[:0], walk, 0, "the history has no frames"),
        (replace(history, body=Body(height=1.5)), walk, 0, "the bundle's human is"),
        (replace(history, fps=60.0), walk, 0, "motion has 60 fps"),
        (history, replace(walk, constraints=other), 0, "of another layout or body"),
    ):
        for kind in (FlexMotionError, ValueError):
            with pytest.raises(kind, match=told):
                sampler.sample(past, asked, seed)  # type: ignore[arg-type]
    assert len(sampler.sample(history, walk, np.int64(3))) == sampler.future
