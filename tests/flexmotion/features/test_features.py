"""Motion to features and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.dynamics import dynamics
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import LEAD, encode, encode_loads
from flexmotion.features.joint_groups import BALL_COLUMNS, BALL_SIGNS, BALLS, ball_angles, ball_matrices, matrix, six
from flexmotion.features.layout import JOINT_CONTACT, Layout
from flexmotion.features.statistics import Statistics
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, JOINTS
from flexmotion.spatial.gravity import GRAVITY


@pytest.fixture(scope="module")
def layout(clip: Motion) -> Layout:
    return Layout(clip.fps)


def test_round_trip(clip: Motion, layout: Layout) -> None:
    features = encode(clip, layout)
    back = decode(features[1:], layout, clip.body, Anchor.after(clip[:1]))
    assert back.root_position == pytest.approx(clip.root_position[1:], abs=2e-4)
    assert back.joints == pytest.approx(clip.joints[1:], abs=1e-4)
    turn = Rotation.from_quat(back.root_quaternion, scalar_first=True)
    error = turn * Rotation.from_quat(clip.root_quaternion[1:], scalar_first=True).inv()
    assert error.magnitude().max() < 1e-3


def test_round_trip_of_dynamics(clip: Motion) -> None:
    found = dynamics(clip[240:330])
    motion = found.motion
    layout = Layout(motion.fps)
    back = decode(encode(motion, layout, found.centres)[1:], layout, motion.body, Anchor.after(motion[:1]))
    assert back.torques is not None and back.wrenches is not None
    assert motion.torques is not None and motion.wrenches is not None
    assert back.torques[:, 6:] == pytest.approx(motion.torques[1:, 6:], abs=1e-2)
    assert back.wrenches[..., :3] == pytest.approx(motion.wrenches[1:, :, :3], abs=1e-1)
    # About the centre of pressure the moment is vertical.
    loaded = motion.wrenches[1:, :, 2] > 0.1 * motion.body.mass * 9.81
    assert back.wrenches[loaded][:, 3:5] == pytest.approx(0.0, abs=1e-6)
    assert back.wrenches[loaded][:, 5] == pytest.approx(motion.wrenches[1:][loaded][:, 5], abs=0.5)
    np.testing.assert_array_equal(back.contacts, motion.contacts[1:])
    assert back.pressure_centres is not None
    assert back.pressure_centres[loaded] == pytest.approx(found.centres[1:][loaded], abs=1e-3)


def test_round_trip_of_joint_contact(clip: Motion) -> None:
    forces = np.random.default_rng(0).normal(0.0, 1500.0, (len(clip), len(CONTACT_JOINTS), 3))
    motion = replace(clip, joint_contact=forces)
    layout = Layout(clip.fps, joint_contact=True)
    features = encode(motion, layout)
    first = features[:, layout.blocks[JOINT_CONTACT]].reshape(forces.shape)
    assert first == pytest.approx(forces / (clip.body.mass * GRAVITY), rel=1e-5)
    back = decode(features[1:], layout, clip.body, Anchor.after(clip[:1]))
    assert back.joint_contact == pytest.approx(forces[1:], rel=1e-4)
    # Other blocks are the same as without them.
    plain = Layout(clip.fps)
    assert decode(encode(motion, plain), plain, clip.body, Anchor.origin()).joint_contact is None
    for name, columns in plain.blocks.items():
        assert np.array_equal(encode(motion, plain)[:, columns], features[:, layout.blocks[name]])


def test_loads_turn_with_the_heading(clip: Motion) -> None:
    loads = np.random.default_rng(1).normal(0.0, 30.0, (len(clip), 3, 3))
    turn = Rotation.from_euler("z", 2.0)
    moved = replace(
        clip,
        root_quaternion=(turn * Rotation.from_quat(clip.root_quaternion, scalar_first=True)).as_quat(scalar_first=True),
    )
    turned = turn.apply(loads.reshape(-1, 3)).reshape(loads.shape)
    assert encode_loads(turned, moved) == pytest.approx(encode_loads(loads, clip), abs=1e-3)
    weight = clip.body.mass * GRAVITY
    assert encode_loads(loads, clip)[..., 2] == pytest.approx(loads[..., 2] / weight, abs=1e-3)


def test_features_do_not_depend_on_position_and_heading(clip: Motion, layout: Layout) -> None:
    turn = Rotation.from_euler("z", 2.0)
    moved = replace(
        clip,
        root_position=turn.apply(clip.root_position) + [3.0, -2.0, 0.0],
        root_quaternion=(turn * Rotation.from_quat(clip.root_quaternion, scalar_first=True)).as_quat(scalar_first=True),
    )
    assert encode(moved, layout) == pytest.approx(encode(clip, layout), abs=1e-3)


def test_features_are_causal(clip: Motion, layout: Layout) -> None:
    whole = encode(clip, layout)
    part = encode(clip[100:120], layout)
    assert part[LEAD:] == pytest.approx(whole[100 + LEAD : 120], abs=1e-4)


def test_features_do_not_depend_on_the_size_of_the_human(layout: Layout, make_standing) -> None:
    small, large = make_standing(3, Body(height=1.5)), make_standing(3, Body(height=1.9))
    assert encode(small, layout) == pytest.approx(encode(large, layout), abs=1e-6)


def test_positions_are_those_of_the_kinematics(clip: Motion, layout: Layout) -> None:
    human = forward(clip)
    positions = encode(clip, layout)[:, layout.blocks["positions"]].reshape(len(clip), -1, 3)
    toe = positions[:, layout.points.index("toe_r"), 2] * clip.body.leg
    assert toe == pytest.approx(human.toe[:, 1, 2], abs=1e-6)


@settings(max_examples=30)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.integers(0, len(BALLS) - 1))
def test_ball_angles_follow_whole_turns(end: list[float], ball: int) -> None:
    joints = np.zeros((60, len(JOINTS)))
    joints[:, BALL_COLUMNS[ball]] = np.linspace(0, 1, 60)[:, None] * end
    matrices = ball_matrices(joints)
    angles = ball_angles(matrix(six(matrices)), joints[0][BALL_COLUMNS])
    again = joints.copy()
    again[:, BALL_COLUMNS] = angles
    assert ball_matrices(again) == pytest.approx(matrices, abs=1e-6)
    assert np.abs(np.diff(angles, axis=0)).max() < np.pi + 0.5


def test_ball_angles_take_the_solution_that_is_nearer_to_the_frame_before() -> None:
    """Rotations that jump: the solution depends on the one before, on a whole chain of them where both are as near."""
    rng = np.random.default_rng(5)
    joints = rng.uniform(-3.0, 3.0, (400, len(JOINTS)))
    joints[100:200] = joints[100] + 0.3 * rng.normal(size=(100, len(JOINTS)))
    start = rng.uniform(-9.0, 9.0, (6, 3))
    before, rotations = start, ball_matrices(joints)
    for frame, angles in enumerate(ball_angles(rotations, start)):
        own = joints[frame, BALL_COLUMNS] * BALL_SIGNS
        two = np.stack([own, np.stack([own[:, 0] + np.pi, np.pi - own[:, 1], own[:, 2] + np.pi], axis=1)]) * BALL_SIGNS
        two += 2 * np.pi * np.round((before - two) / (2 * np.pi))
        nearer = np.linalg.norm(two - before, axis=-1).argmin(axis=0)
        np.testing.assert_allclose(angles, two[nearer, np.arange(6)], atol=1e-9)
        before = angles
    balls = [4, 1]
    some = ball_angles(ball_matrices(joints, balls), start[balls], balls)
    np.testing.assert_array_equal(some, ball_angles(rotations, start)[:, balls])


def test_wrong_frame_rate_is_refused(clip: Motion) -> None:
    with pytest.raises(ValueError, match="fps"):
        encode(clip, Layout(20.0))


def test_layouts_have_different_hashes() -> None:
    assert Layout(30.0).hash == Layout(30.0).hash
    others = (Layout(20.0), Layout(30.0, muscles=290), Layout(30.0, joint_contact=True))
    assert len({Layout(30.0).hash, *(layout.hash for layout in others)}) == 4


def test_statistics(clip: Motion, layout: Layout) -> None:
    features = encode(clip, layout)
    statistics = Statistics.of(features, layout)
    assert statistics.restore(statistics.normalise(features)) == pytest.approx(features, abs=1e-4)
    assert (statistics.spread > 0).all()
