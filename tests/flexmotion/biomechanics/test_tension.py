"""Tension of a human's limbs: what a pose needs against gravity is no tension, torque beyond it and speed are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.biomechanics.inverse_dynamics import joint_torques
from flexmotion.biomechanics.segment_motion import AT_REST, segment_motion
from flexmotion.biomechanics.strength import STRENGTH
from flexmotion.biomechanics.tension import FULL_EFFORT, LIMBS, limb_tension
from flexmotion.human.body import Body
from flexmotion.human.kinematics import named_arrays
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS

FPS, FRAMES = 30.0, 60
LEFT, RIGHT, HEAD = (LIMBS.index(limb) for limb in ("left_arm", "right_arm", "head"))


def moved(**joints: np.ndarray | float) -> Motion:
    """A human in the air with these joint angles [rad] and the torques of its motion."""
    angles = np.zeros((FRAMES, len(JOINTS)))
    for name, angle in joints.items():
        angles[:, JOINTS.index(name)] = angle
    still = np.zeros((FRAMES, 4))
    still[:, 0] = 1.0
    motion = Motion(fps=FPS, root_position=np.zeros((FRAMES, 3)), root_quaternion=still, joints=angles, body=Body())
    wrenches = np.zeros((FRAMES, 2, 6))
    return replace(motion, torques=joint_torques(motion.body, segment_motion(motion), wrenches, wrenches[..., :3]))


def tension(motion: Motion) -> np.ndarray:
    found = limb_tension(motion)
    assert found is not None
    return found


def pulled(motion: Motion, joint: str, share: float) -> Motion:
    """The motion with more torque at a joint, by a share of its strength."""
    assert motion.torques is not None
    torques = motion.torques.copy()
    torques[:, DOF_COUNT - len(JOINTS) + JOINTS.index(joint)] += (
        share * STRENGTH[joint.partition("_")[0]] * motion.body.mass
    )
    return replace(motion, torques=torques)


def test_arms_that_are_held_out_are_not_tense() -> None:
    """It takes 10 N·m at each shoulder, all of it against gravity."""
    held = moved(shoulder_flexion_l=1.5, shoulder_flexion_r=1.5, neck_extension=-0.5)
    assert held.torques is not None and np.abs(held.torques[:, 6:]).max() > 8.0
    np.testing.assert_allclose(tension(held), 0.0, atol=1e-9)


def test_torque_beyond_gravity_is_tension_of_its_own_limb() -> None:
    found = tension(pulled(moved(shoulder_flexion_r=1.0), "elbow_flexion_r", 0.5 * FULL_EFFORT))
    np.testing.assert_allclose(found[:, RIGHT], 0.5)
    np.testing.assert_allclose(found[:, [LEFT, HEAD]], 0.0, atol=1e-9)


@pytest.mark.parametrize("joint", ["hip_flexion_l", "lumbar_extension"])
def test_legs_and_trunk_are_no_limb_of_it(joint: str) -> None:
    np.testing.assert_allclose(tension(pulled(moved(), joint, 0.5)), 0.0, atol=1e-9)


def test_poses_that_are_known_are_not_laid_out_again() -> None:
    """A plan's window knows them already."""
    motion = pulled(moved(shoulder_flexion_r=np.linspace(0.0, 1.0, FRAMES)), "elbow_flexion_l", 0.2 * FULL_EFFORT)
    known = named_arrays(motion, AT_REST)
    np.testing.assert_array_equal(limb_tension(motion, known), tension(motion))
    hanging = named_arrays(moved(), AT_REST)
    assert np.abs(limb_tension(motion, hanging) - tension(motion)).max() > 0.1


def test_the_faster_an_arm_swings_the_tenser_it_is() -> None:
    times = np.arange(FRAMES) / FPS
    slow, fast, fastest = (
        tension(moved(shoulder_flexion_l=0.5 * np.sin(2 * np.pi * hz * times)))[10:-10, LEFT].mean()
        for hz in (0.3, 0.8, 2.0)
    )
    assert 0.0 < slow < 0.5 * fast < fast < fastest <= 1.0


def test_a_head_that_turns_is_tense_though_its_axis_carries_no_weight() -> None:
    turning = tension(moved(neck_rotation=np.linspace(0.0, 2.5, FRAMES)))
    assert (turning[10:-10, HEAD] > 0.2).all() and (turning[:, [LEFT, RIGHT]] < 0.05).all()


def test_nothing_is_known_of_a_motion_without_torques() -> None:
    assert limb_tension(replace(moved(), torques=None)) is None


@given(share=st.floats(-50.0, 50.0), joint=st.sampled_from(JOINTS), angle=st.floats(-2.0, 2.0))
def test_tension_is_bounded_for_any_torque(share: float, joint: str, angle: float) -> None:
    found = tension(pulled(moved(shoulder_flexion_l=angle)[:5], joint, share))
    assert found.shape == (5, 3) and (found >= 0.0).all() and (found <= 1.0).all()
