"""Augmented motions obey the equations of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.biomechanics.augmentation import Ranges, time_warped, varied
from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.joint_contact import joint_contact_forces
from flexmotion.biomechanics.mirror import mirror, mirrored_loads
from flexmotion.biomechanics.static_optimisation import static_optimisation
from flexmotion.human.angles import rotation_about, three_angle_rotation, three_angles
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, JOINTS
from flexmotion.spatial.gravity import GRAVITY

FLIP = [1.0, -1.0, 1.0]


def test_mirror_twice_is_the_motion(clip: Motion) -> None:
    twice = mirror(mirror(clip))
    assert np.array_equal(twice.joints, clip.joints)
    assert np.array_equal(twice.root_position, clip.root_position)
    assert np.array_equal(twice.root_quaternion, clip.root_quaternion)


def test_mirror_swaps_the_sides_of_every_point(clip: Motion, clip_kinematics: HumanKinematics) -> None:
    image = forward(mirror(clip))
    for point in ("knee", "ankle", "heel", "elbow", "hand"):
        assert getattr(image, point)[:, 0] == pytest.approx(getattr(clip_kinematics, point)[:, 1] * FLIP, abs=1e-9)


def test_mirrored_forces_are_the_mirror_image(clip: Motion) -> None:
    found, image = dynamics(clip).motion, dynamics(mirror(clip)).motion
    expected = mirror(found)
    assert image.wrenches == pytest.approx(expected.wrenches, abs=0.5)
    assert image.torques == pytest.approx(expected.torques, abs=0.5)


def test_mirrored_joint_contact_is_that_of_the_mirrored_motion(clip: Motion) -> None:
    """In the legs exactly; at the lumbar joint as far as the trunk's muscle paths are symmetrical."""
    pytest.importorskip("myo_sim", reason="extra 'biomech' is not installed")
    found, image = dynamics(clip[240:264]), dynamics(mirror(clip[240:264]))
    muscles = static_optimisation(found.motion)
    assert muscles.crossings == CONTACT_JOINTS
    expected = mirror(replace(found.motion, joint_contact=joint_contact_forces(found, muscles))).joint_contact
    computed = joint_contact_forces(image, static_optimisation(image.motion))
    assert expected is not None
    error = np.linalg.norm(expected - computed, axis=-1).mean(axis=0) / (clip.body.mass * GRAVITY)
    assert error[:-1].max() < 1e-3 and error[-1] < 0.1
    size = np.linalg.norm(computed, axis=-1).mean(axis=0) / (clip.body.mass * GRAVITY)
    assert size.min() > 0.5


def test_mirrored_loads_swap_hands_and_sides() -> None:
    loads = np.arange(18.0).reshape(2, 3, 3)
    image = mirrored_loads(loads)
    assert np.array_equal(image[:, 1], loads[:, 2] * FLIP) and np.array_equal(image[:, 0], loads[:, 0] * FLIP)
    assert np.array_equal(mirrored_loads(image), loads)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_dynamics_of_a_variant_have_small_residuals(clip: Motion, seed: int) -> None:
    motion, loads = varied(clip, seed)
    again, _ = varied(clip, seed)
    assert np.array_equal(motion.joints, again.joints)
    lower, upper = joint_limits().T
    assert (motion.joints >= np.minimum(lower, clip.joints.min(axis=0)) - 1e-6).all()
    assert (motion.joints <= np.maximum(upper, clip.joints.max(axis=0)) + 1e-6).all()
    found = dynamics(motion, loads=loads)
    assert np.median(found.residual[:, 0]) < 0.02
    assert np.median(found.residual[:, 1]) < 0.02


def test_tempo_keeps_the_path_and_its_ends(clip: Motion) -> None:
    warped = time_warped(clip, np.random.default_rng(3), Ranges(tempo=0.2))
    assert len(warped) == pytest.approx(len(clip), rel=0.25)
    assert len(warped) != len(clip)
    assert warped.root_position[0] == pytest.approx(clip.root_position[0])
    assert warped.root_position[-1] == pytest.approx(clip.root_position[-1], abs=0.05)


def test_a_carried_mass_adds_to_the_ground_force(make_standing) -> None:
    motion = make_standing(frames=30)
    burden = ExternalLoad("hand_l", np.tile([0.0, 0.0, -50.0], (30, 1)))
    found = dynamics(motion, loads=[burden])
    assert found.motion.wrenches is not None
    total = found.motion.wrenches[:, :, 2].sum(axis=1)
    assert total == pytest.approx(np.full(30, motion.body.mass * GRAVITY + 50.0), rel=0.01)
    # The mass is on the left: that foot carries more.
    assert (found.motion.wrenches[:, 0, 2] > found.motion.wrenches[:, 1, 2] + 20).all()


def test_a_change_of_tempo_keeps_the_path_of_an_arm_near_gimbal_lock(make_standing) -> None:
    """Regression: shoulder angles reach 48 rad/s there, and splines of angles moved the arm off its path."""
    names = ("shoulder_flexion", "shoulder_adduction", "shoulder_rotation")
    columns = [JOINTS.index(f"{name}_l") for name in names]
    aside = rotation_about("y", 0.02) @ rotation_about("z", 0.02)
    motion = make_standing(40)
    lifted = aside @ rotation_about("x", np.pi / 2 + np.linspace(-0.8, 0.8, 40))
    motion.joints[:, columns] = three_angles(lifted, names, "l")
    warped = time_warped(motion, np.random.default_rng(0))
    arm = three_angle_rotation(warped.joints[:, columns], names, "l").as_matrix()[:, :, 2]
    # The upper arm swings in a plane.
    assert arm @ aside[:, 0] == pytest.approx(0.0, abs=1e-4)
