"""Stretches of recordings that gestures are laid over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.dataset.gestures.bases import ARMS, Base, draw_base, extended, stretches
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS

from ....standing_human import FPS, clip, standing


def found(motion: Motion, *, walks: bool = False) -> list[Base]:
    return list(stretches(clip("07_01"), motion, walks))


def test_quiet_standing_is_a_base_with_hanging_arms() -> None:
    """A wave is no gesture's base; the legs that stand below it are."""
    motion = standing(6.0)
    joints = motion.joints.copy()
    waving = slice(60, 180)
    joints[waving, JOINTS.index("shoulder_adduction_r")] = np.radians(-150.0)
    joints[waving, JOINTS.index("elbow_flexion_r")] += np.radians(40.0) * np.sin(np.arange(120) / FPS * 2 * np.pi * 2)
    (base,) = found(replace(motion, joints=joints))
    assert base.ground == "stand" and base.motion.duration > 5.0
    human = forward(base.motion)
    assert (human.hand[..., 2] < human.pelvis_position[:, None, 2] + 0.1).all()
    np.testing.assert_allclose(
        base.motion.joints[:, ARMS], np.tile(motion.joints[0, ARMS], (len(base.motion), 1)), atol=1e-6
    )


@pytest.mark.parametrize("change", ["sits", "straddles", "bows", "turns", "slides", "short"])
def test_who_does_not_stand_upright_and_quietly_is_no_base(change: str) -> None:
    motion = standing(1.5 if change == "short" else 4.0)
    joints, place, quaternions = motion.joints.copy(), motion.root_position.copy(), motion.root_quaternion.copy()
    passed = np.arange(len(motion)) / FPS
    if change == "sits":
        place[:, 2] -= 0.4
    elif change == "straddles":
        for side in "lr":
            joints[:, JOINTS.index(f"hip_adduction_{side}")] = np.radians(-12.0)
    elif change == "bows":
        joints[:, JOINTS.index("lumbar_extension")] = np.radians(-40.0)
    elif change == "turns":
        quaternions = np.stack([np.cos(passed / 2), 0 * passed, 0 * passed, np.sin(passed / 2)], axis=1)
    elif change == "slides":
        place[:, 0] += 0.3 * passed
    assert not found(replace(motion, joints=joints, root_position=place, root_quaternion=quaternions))


def test_walking_is_a_base_where_the_label_says_so(clip_of_walking: Motion) -> None:
    assert not [base for base in found(clip_of_walking) if base.ground == "walk"]
    (walk,) = [base for base in found(clip_of_walking, walks=True) if base.ground == "walk"]
    assert walk.motion.duration > 2.6
    assert extended(walk, len(walk.motion) + 1, np.random.default_rng(0)) is None, "a walk goes nowhere in reverse"


@pytest.fixture
def clip_of_walking() -> Motion:
    """Gliding at 1.2 m/s for four seconds: what the search for walks sees."""
    motion = standing(4.0)
    return replace(motion, root_position=motion.root_position + np.arange(120)[:, None] / FPS * [1.2, 0.0, 0.0])


def test_a_stand_that_is_too_short_sways_on() -> None:
    """It goes to and fro in time, without a jump of its speed."""
    base = Base(clip("07_01"), standing(2.5), "stand")
    long = extended(base, 600, np.random.default_rng(3))
    assert long is not None and len(long) == 600
    place = long.root_position
    assert np.abs(np.diff(place, 2, axis=0)).max() * FPS**2 < 0.3
    assert np.ptp(place, axis=0).max() <= np.ptp(base.motion.root_position, axis=0).max() + 1e-9
    np.testing.assert_allclose(np.linalg.norm(long.root_quaternion, axis=1), 1.0, atol=1e-9)


def test_people_with_few_recordings_are_drawn_too() -> None:
    motion = standing(2.5)
    bases = [Base(clip(f"07_{number:02d}"), motion, "stand") for number in range(99)]
    bases.append(Base(clip("08_01"), motion, "stand"))
    rng = np.random.default_rng(0)
    share = np.mean([draw_base(bases, rng).person == "ours 08" for _ in range(2000)])
    assert share == pytest.approx(1 / (1 + 99**0.5), abs=0.03)


def test_a_clip_of_standing_and_walking_has_both() -> None:
    glide = standing(4.0)
    glide = replace(glide, root_position=glide.root_position + np.arange(120)[:, None] / FPS * [1.2, 0.0, 0.0])
    both = found(concatenate([standing(4.0), glide]), walks=True)
    assert {base.ground for base in both} == {"stand", "walk"}
