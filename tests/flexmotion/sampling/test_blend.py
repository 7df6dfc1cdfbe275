from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.sampling.blend import take_over

CLIP = default_clip()[225:330]
FRAMES = 8


def turned(motion: Motion, angle: float) -> Motion:
    """The motion shifted by 5 cm, with its root rotated and every joint changed by .1 rad."""
    turn = Rotation.from_euler("z", angle)
    root = turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
    return replace(
        motion,
        root_position=motion.root_position + [0.0, 0.05, 0.0],
        root_quaternion=root.as_quat(scalar_first=True),
        joints=motion.joints + 0.1,
    )


@pytest.fixture
def old() -> Motion:
    return CLIP[10:42]


@pytest.fixture
def new() -> Motion:
    return turned(CLIP, 0.1)[17:49]


def test_it_starts_with_the_old_motion_and_ends_with_the_new_one(old: Motion, new: Motion) -> None:
    mixed = take_over(old, 10, new, 17, FRAMES)
    assert len(mixed) == len(new)
    for name in ("root_position", "root_quaternion", "joints"):
        got, was, will = getattr(mixed, name), getattr(old, name), getattr(new, name)
        np.testing.assert_allclose(got[:2], was[7:9], atol=1e-12)
        np.testing.assert_allclose(got[FRAMES + 1 :], will[FRAMES + 1 :], atol=1e-12)


def test_the_transition_is_linear(old: Motion, new: Motion) -> None:
    mixed = take_over(old, 10, new, 17, FRAMES)
    share = (mixed.joints - CLIP.joints[17:49]) / 0.1
    wanted = np.clip((np.arange(len(new)) - 1) / FRAMES, 0.0, 1.0)
    np.testing.assert_allclose(share, np.broadcast_to(wanted[:, None], share.shape), atol=1e-9)
    between = Rotation.from_quat(mixed.root_quaternion[5], scalar_first=True)
    turn = between * Rotation.from_quat(CLIP.root_quaternion[22], scalar_first=True).inv()
    np.testing.assert_allclose(turn.as_rotvec(), [0.0, 0.0, 0.05], atol=1e-4)


def test_quaternions_of_either_sign_are_the_same_rotation(old: Motion, new: Motion) -> None:
    flipped = replace(new, root_quaternion=-new.root_quaternion)
    mixed = take_over(old, 10, flipped, 17, FRAMES)
    np.testing.assert_allclose(mixed.root_quaternion, take_over(old, 10, new, 17, FRAMES).root_quaternion, atol=1e-12)
    assert (np.sum(mixed.root_quaternion[1:] * mixed.root_quaternion[:-1], axis=1) > 0).all()


def test_equal_motions_are_unchanged(old: Motion) -> None:
    mixed = take_over(old, 10, CLIP[17:49], 17, FRAMES)
    np.testing.assert_array_equal(mixed.joints, CLIP.joints[17:49])
    np.testing.assert_allclose(mixed.root_quaternion, CLIP.root_quaternion[17:49], atol=1e-15)


def test_frames_after_the_old_motion_are_the_new_one(old: Motion, new: Motion) -> None:
    """With five common frames the transition is shorter and complete."""
    mixed = take_over(old[:12], 10, new, 17, FRAMES)
    np.testing.assert_allclose(mixed.joints[:2], old.joints[7:9], atol=1e-12)
    np.testing.assert_allclose(mixed.joints[5:], new.joints[5:], atol=1e-12)


@pytest.mark.parametrize(("first", "frames"), [(200, FRAMES), (3, FRAMES), (17, 0)])
def test_without_common_frames_or_time_the_new_motion_takes_over_at_once(
    old: Motion, new: Motion, first: int, frames: int
) -> None:
    assert take_over(old, 10, new, first, frames) is new


def test_forces_of_the_new_motion_stay_where_the_old_one_has_none(old: Motion, new: Motion) -> None:
    """Regression: forces were dropped, and after one plan without forces all later ones had none."""
    loaded = replace(new, wrenches=np.ones((len(new), 2, 6)), contacts=np.ones((len(new), 2), np.bool_))
    mixed = take_over(old, 10, loaded, 17, FRAMES)
    assert mixed.wrenches is not None and mixed.contacts is not None
    np.testing.assert_array_equal(mixed.wrenches, loaded.wrenches)
    again = take_over(loaded, 17, new, 20, FRAMES)
    assert again.wrenches is None and again.contacts is None


def test_forces_are_mixed_where_both_have_them_and_contacts_are_those_of_the_nearer(old: Motion, new: Motion) -> None:
    def loaded(motion: Motion, force: float, contact: bool) -> Motion:
        wrenches = np.full((len(motion), 2, 6), force)
        return replace(motion, wrenches=wrenches, contacts=np.full((len(motion), 2), contact))

    mixed = take_over(loaded(old, 100.0, False), 10, loaded(new, 300.0, True), 17, FRAMES)
    share = np.clip((np.arange(len(new)) - 1) / FRAMES, 0.0, 1.0)
    assert mixed.wrenches is not None and mixed.contacts is not None
    np.testing.assert_allclose(mixed.wrenches[:, 1, 2], 100.0 + 200.0 * share)
    np.testing.assert_array_equal(mixed.contacts[:, 0], share >= 0.5)
