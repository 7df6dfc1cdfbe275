"""The OP3 model: masses, mirror symmetry, and poses without self-contact."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from flexmotion.configs.robot import Robot

MIRROR = np.diag([1.0, -1.0, 1.0])
SIDES = tuple(
    (f"l_{part}_link", f"r_{part}_link")
    for part in (
        *("sho_pitch", "sho_roll", "el"),
        *("hip_yaw", "hip_roll", "hip_pitch", "knee", "ank_pitch", "ank_roll"),
    )
)


def at_pose(robot: Robot, pose: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(robot.model)
    data.qpos[:] = 0.0
    data.qpos[3] = 1.0
    data.qpos[robot.qpos_address] = pose
    mujoco.mj_forward(robot.model, data)
    return data


def inertia(robot: Robot, data: mujoco.MjData, body: str) -> np.ndarray:
    """Inertia tensor in the world, (3, 3)."""
    axes = data.body(body).ximat.reshape(3, 3)
    return axes @ np.diag(robot.model.body(body).inertia) @ axes.T


def mirrored(robot: Robot, pose: np.ndarray) -> np.ndarray:
    """The pose with left and right exchanged: in this model all angles of a side and the pan change sign."""
    other = np.empty_like(pose)
    for index, name in enumerate(robot.joint_names):
        twin = {"l": "r" + name[1:], "r": "l" + name[1:]}.get(name[0], name) if name[1] == "_" else name
        other[robot.index(twin)] = pose[index] if name == "head_tilt" else -pose[index]
    return other


def test_mass(op3: Robot) -> None:
    assert op3.mass == pytest.approx(3.147, abs=1e-3)


def test_a_servo_accepts_goals_wherever_its_limp_joint_can_rest(op3: Robot) -> None:
    """The stops, with some play, are within the margin of the servos' own limits."""
    stops = np.array([op3.model.joint(name).range for name in op3.joint_names])
    assert (stops[:, 0] < op3.lower).all() and (stops[:, 1] > op3.upper).all()
    beyond = np.maximum(op3.lower - stops[:, 0], stops[:, 1] - op3.upper)
    assert (beyond < op3.safety.standing_margin - 0.03).all()


def test_the_right_side_mirrors_the_left(op3: Robot) -> None:
    data = at_pose(op3, np.zeros(op3.n))
    for left, right in SIDES:
        assert op3.model.body(left).mass == op3.model.body(right).mass
        np.testing.assert_allclose(MIRROR @ data.body(left).xipos, data.body(right).xipos, atol=1e-12)
        np.testing.assert_allclose(MIRROR @ inertia(op3, data, left) @ MIRROR, inertia(op3, data, right), atol=1e-12)


def test_a_mirrored_pose_mirrors_every_body_and_shape(op3: Robot) -> None:
    rng = np.random.default_rng(0)
    pose = rng.uniform(op3.lower, op3.upper)
    one, other = at_pose(op3, pose), at_pose(op3, mirrored(op3, pose))
    for left, right in SIDES:
        np.testing.assert_allclose(MIRROR @ one.body(left).xpos, other.body(right).xpos, atol=1e-12)
    for name in ("thigh", "shin", "upper_arm", "forearm", "foot_wide", "foot_long"):
        np.testing.assert_allclose(MIRROR @ one.geom(f"l_{name}").xpos, other.geom(f"r_{name}").xpos, atol=1e-12)


def test_limits_and_poses_are_symmetric(op3: Robot) -> None:
    for pose in (op3.stand_pose, op3.rest_pose):
        np.testing.assert_array_equal(mirrored(op3, pose), pose)
    lower = mirrored(op3, op3.upper)
    sides = [index for index, name in enumerate(op3.joint_names) if name != "head_tilt"]
    np.testing.assert_array_equal(lower[sides], op3.lower[sides])


def test_limits_stay_inside_the_stops(op3: Robot) -> None:
    for index, name in enumerate(op3.joint_names):
        low, high = op3.model.joint(name).range
        assert low < op3.lower[index] and op3.upper[index] < high


@pytest.mark.parametrize("pose", ["zero", "stand", "rest"])
def test_poses_do_not_touch_themselves(op3: Robot, pose: str) -> None:
    angles = {"zero": np.zeros(op3.n), "stand": op3.stand_pose, "rest": op3.rest_pose}[pose]
    assert at_pose(op3, angles).ncon == 0


def test_limbs_that_meet_do_touch(op3: Robot) -> None:
    pose = op3.stand_pose.copy()
    pose[op3.index("l_hip_roll")] = 0.3  # left leg into the right one
    contacts = at_pose(op3, pose).contact.geom
    names = {frozenset(op3.model.geom(g).name for g in pair) for pair in contacts}
    assert any({"l_foot_wide", "r_foot_wide"} <= pair for pair in names)


@pytest.mark.parametrize(("pose", "ahead"), [("stand", 0.0), ("rest", 0.011)])
def test_in_both_poses_soles_are_flat_and_carry_the_centre_of_mass(op3: Robot, pose: str, ahead: float) -> None:
    data = at_pose(op3, getattr(op3, f"{pose}_pose"))
    feet = list(op3.foot_ids)
    rotations = data.xmat[feet].reshape(2, 3, 3)
    np.testing.assert_allclose(rotations[0], rotations[1], atol=1e-9)
    soles = data.xpos[feet] + np.einsum("fij,fj->fi", rotations, op3.soles)
    offset = rotations[0].T @ (data.subtree_com[op3.torso_id] - soles.mean(axis=0))
    assert offset[0] == pytest.approx(ahead, abs=1e-3)
    assert offset[1] == pytest.approx(0.0, abs=1e-3)


def test_the_stand_pose_is_upright_with_bent_knees(op3: Robot) -> None:
    data = at_pose(op3, op3.stand_pose)
    hip, ankle = data.body("l_hip_pitch_link").xpos, data.body("l_ank_pitch_link").xpos
    assert hip[2] - ankle[2] == pytest.approx(op3.gait.stand_hip_height, abs=5e-4)
    assert data.body("l_ank_roll_link").xmat[8] == pytest.approx(1.0, abs=1e-6)


def test_sites_lie_where_the_robot_file_says(op3: Robot) -> None:
    data = at_pose(op3, op3.stand_pose)
    for side, foot in enumerate(op3.foot_ids):
        sole = data.xpos[foot] + data.xmat[foot].reshape(3, 3) @ op3.soles[side]
        np.testing.assert_allclose(data.site(("l_sole", "r_sole")[side]).xpos, sole, atol=1e-12)
    hands = op3.config.hands
    assert hands is not None
    for hand, site in ((hands.left, "l_hand"), (hands.right, "r_hand")):
        body = data.body(hand.body)
        np.testing.assert_allclose(data.site(site).xpos, body.xpos + body.xmat.reshape(3, 3) @ hand.point, atol=1e-12)
