"""Feet that rest on the floor stay there while a standing body is balanced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import foot_points
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.resting_feet import RestingFeet
from flexmotion.sampling.sampler import Sampler

from .standing_feet import FPS, FRAMES, LOADED, standing


def test_a_foot_that_slips_is_brought_back_to_where_it_stood() -> None:
    feet = standing()
    feet[1:, 1, :, 0] += np.linspace(0.0, 0.03, FRAMES)[:, None]
    found = RestingFeet.of(feet, LOADED, FPS)
    assert found.rests.all() and found.stands.all()
    assert found.shift[-1, 1] == pytest.approx([-0.03, 0.0])
    assert not found.shift[:, 0].any()


def test_a_foot_that_lands_stays_where_it_comes_to_rest() -> None:
    feet = standing()
    step = np.clip((np.arange(1 + FRAMES) - 4) / 12.0, 0.0, 1.0)
    feet[:, 0, :, 0] += 0.4 * step[:, None]
    feet[:, 0, :, 2] = 0.1 * np.sin(np.pi * step)[:, None]
    found = RestingFeet.of(feet, LOADED, FPS)
    swings, lands = slice(7, 13), slice(20, FRAMES)
    assert not found.rests[swings, 0].any() and found.rests[lands, 0].all() and found.rests[:, 1].all()
    places = found.places[..., :2] + found.away
    assert np.ptp(places[lands, 0, 0, 0]) == pytest.approx(0.0, abs=1e-9)
    assert places[-1, 0, 0, 0] == pytest.approx(0.4, abs=0.01)


def test_a_foot_that_is_low_rests_though_it_is_said_to_carry_nothing() -> None:
    # A body that stood on both feet was said to stand on one, and fell away from it.
    idle = LOADED & [False, True]
    assert RestingFeet.of(standing(), idle, FPS).rests.all()
    hovering = standing()
    hovering[:, 0, :, 2] = 0.03
    assert not RestingFeet.of(hovering, idle, FPS).rests[:, 0].any()
    assert RestingFeet.of(hovering, LOADED, FPS).rests.all(), "a loaded foot is only decoded too high"


def test_a_place_that_is_asked_of_a_foot_comes_first() -> None:
    nothing = Constraints.none(Layout(fps=FPS), Body(), FRAMES)
    asked = nothing.place("toe_l", 20, [0.3, 0.1, 0.0])
    found = RestingFeet.of(standing(), LOADED, FPS).beside(asked)
    assert not found.rests[:, 0].any() and found.rests[:, 1].all()
    both = found.asked(asked, Anchor.origin())
    first = both.layout.blocks["places"].start
    told = both.mask[:, first : first + 3 * len(POINTS)].reshape(FRAMES, -1, 3).any(axis=2)
    assert told[:, POINTS.index("toe_l")].sum() == 1
    assert told[:, POINTS.index("toe_r")].all() and told[:, POINTS.index("heel_r")].all()


def test_feet_that_legs_do_not_reach_move_along() -> None:
    feet = standing()
    feet[1:, 1, :, 0] += np.linspace(0.0, 0.2, FRAMES)[:, None]
    slipping = RestingFeet.of(feet, LOADED, FPS)
    left = slipping.reached(slipping.places)
    assert left.rests[:4, 1].all() and not left.rests[-4:, 1].any() and not left.away[-4:, 1].any()
    back = slipping.places.copy()
    back[..., :2] += slipping.away
    assert slipping.reached(back).rests.all() and not slipping.reached(back).away.any()


@pytest.mark.parametrize("prompt", ["bow", "point to your left", "wave with the right hand"])
def test_who_is_asked_for_a_gesture_stays_where_they_stand(bundle: Path, prompt: str) -> None:
    # The shift of one window was the motion that the next one went on from: after 20 s a bow was 8 m away.
    sampler = Sampler(Bundle(bundle))
    motion = sampler.standing()
    start = motion.root_position[0, :2]
    for window in range(20):
        found = sampler.extend(motion, Condition(prompt), seed=window)
        motion = concatenate([motion[: len(motion) - len(found.before)], found.before, found.window])
    assert np.linalg.norm(motion.root_position[:, :2] - start, axis=1).max() < 0.6
    feet = foot_points(motion)
    still = (feet[1:, ..., 2] < 0.01) & (feet[:-1, ..., 2] < 0.01)
    speed = np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=-1) * FPS
    assert np.median(speed[still]) < 0.02
