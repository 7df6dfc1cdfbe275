"""Feet of a body that stays where it is do not slide over the floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import foot_points, forward
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.kept_feet import FARTHEST, kept, resting
from flexmotion.streamer.api import open_sampler

from .standing_feet import FPS, FRAMES, LOADED, standing


def moves(feet: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """How far the feet are moved, (W, 2, 2) [m]."""
    return kept(feet, resting(feet, contacts, FPS), FPS)


def ramp(start: int, stop: int) -> np.ndarray:
    """0 up to a frame, 1 from another one on, (1 + W, 1)."""
    return np.clip((np.arange(1 + FRAMES) - start) / (stop - start), 0.0, 1.0)[:, None]


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-0.2, 0.2) for _ in range(4)]), st.integers(4, 24))
def test_a_loaded_foot_stays_whatever_its_speed(slides: tuple[float, ...], frames: int) -> None:
    # Bows slid loaded feet apart by .3 m at .9 m/s, and the robot stepped after them.
    feet = standing()
    feet[..., :2] += ramp(2, 2 + frames)[..., None, None] * np.array(slides).reshape(2, 1, 2)
    moved = moves(feet, LOADED)
    away = feet[1:, :, 0, :2] + moved - feet[0, :, 0, :2]
    within = np.linalg.norm(feet[1:, :, 0, :2] - feet[0, :, 0, :2], axis=-1) < FARTHEST
    # A slide that begins at full speed is smoothed over a frame.
    assert np.abs(away[within]).max() <= 0.3 * np.abs(slides).max() / frames + 1e-9


def test_a_foot_that_steps_lands_where_it_is_then_and_stays() -> None:
    feet = standing()
    step = ramp(4, 12)
    feet[:, 0, :, 0] += 0.4 * step
    feet[:, 0, :, 2] = 0.1 * np.sin(np.pi * step)
    feet[:, 0, :, 0] += 0.1 * ramp(14, 32)  # and slides on
    loaded = LOADED.copy()
    loaded[3:12, 0] = False
    moved = moves(feet, loaded)
    place = feet[1:, 0, 0, 0] + moved[:, 0, 0]
    assert np.ptp(place[13:]) < 0.01
    assert place[-1] == pytest.approx(0.4, abs=0.06)  # the way of a frame
    assert not moved[:, 1].any()


def test_a_foot_that_lifts_returns_to_its_path() -> None:
    feet = standing()
    feet[:, 1, :, 0] += 0.15 * ramp(1, 12)
    lifts = ramp(14, 18)
    feet[:, 1, :, 2] = 0.2 * lifts
    loaded = LOADED.copy()
    loaded[14:, 1] = False
    moved = moves(feet, loaded)
    assert moved[12, 1, 0] == pytest.approx(-0.15, abs=0.01)
    assert abs(moved[-1, 1, 0]) < 0.02
    assert np.abs(np.diff(moved[:, 1, 0])).max() < 0.05


def test_a_foot_near_the_floor_that_carries_nothing_stays_unless_it_swings() -> None:
    # A bow was said to lift a foot, and slid it along the floor instead.
    idle = LOADED & [False, True]
    slow, fast = standing(), standing()
    slow[:, 0, :, 0] += 0.1 * ramp(4, 12)
    fast[:, 0, :, 0] += 0.4 * ramp(4, 10)
    assert moves(slow, idle)[-1, 0, 0] == pytest.approx(-0.1, abs=1e-6)
    assert abs(moves(fast, idle)[-1, 0, 0]) < 0.2


@pytest.mark.skipif(shipped_bundle() is None, reason="needs the shipped bundle")
@pytest.mark.parametrize(("text", "most"), [("take a bow", 0.06), ("say goodbye", 0.06), ("squat", 0.02)])
def test_people_who_stay_do_not_slide(text: str, most: float) -> None:
    # Feet of a bow and of a goodbye moved by .19 m, those of a squat by .04: it is not the stance of the model.
    sampler = open_sampler()
    motion = sampler.standing()
    begin = len(motion)
    for window in range(4):
        motion = concatenate([motion, sampler.sample(motion, Condition(text), window)])
    place = foot_points(motion[begin - 1 :])[..., :2].mean(axis=2)
    assert np.linalg.norm(place - place[0], axis=-1).max() < most


@pytest.mark.skipif(shipped_bundle() is None, reason="needs the shipped bundle")
@pytest.mark.parametrize("text", ["stand still", "wave with the right hand"])
def test_a_foot_that_is_asked_elsewhere_goes_there(text: str) -> None:
    """Legs that kept a foot undid what the solver had moved it by: it ended 32 cm from where it was asked to be."""
    sampler = open_sampler()
    history = sampler.standing()
    asked = Constraints.none(sampler.layout, sampler.body, sampler.future)
    asked = asked.place("ankle_l", range(24, 32), (0.35, 0.1, np.nan))
    found = sampler.sample(history, Condition(text, constraints=asked), 1)
    ankle = Anchor.after(history).local(forward(found).ankle[24:, 0])
    assert np.linalg.norm(ankle[:, :2] - (0.35, 0.1), axis=-1).max() < 0.05
