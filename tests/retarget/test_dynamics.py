from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.retarget.dynamics import RobotDynamics
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.spatial.gravity import GRAVITY


@pytest.fixture
def dynamics(retargeter: Retargeter) -> RobotDynamics:
    return retargeter.body.dynamics


def standing(retargeter: Retargeter) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Torso pose (1, 7), joints (1, n) and feet (1, 2, 4) at rest."""
    state = retargeter.layout.view(retargeter.standing())
    return state.base[:1].copy(), state.q[:1].copy(), state.feet[None].copy()


def solve(
    dynamics: RobotDynamics, base: np.ndarray, q: np.ndarray, feet: np.ndarray, share: float, **moving: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    still, rest = np.zeros((1, 6)), np.zeros_like(q)
    return dynamics.inverse(
        base,
        moving.get("base_velocity", still),
        moving.get("base_acceleration", still),
        q,
        moving.get("qd", rest),
        moving.get("qdd", rest),
        feet,
        np.array([share]),
    )


def test_at_rest_the_zmp_is_under_the_centre_of_mass(retargeter: Retargeter, dynamics: RobotDynamics) -> None:
    base, q, feet = standing(retargeter)
    _, zmp = solve(dynamics, base, q, feet, 0.5)
    np.testing.assert_allclose(zmp[0], dynamics.centre_of_mass(base, q)[0, :2], atol=1e-6)
    np.testing.assert_allclose(zmp[0], feet[0, :, :2].mean(axis=0), atol=1e-3)
    assert dynamics.mass == pytest.approx(retargeter.robot.mass)


@pytest.mark.parametrize("share", [0.5, 0.4])
def test_joint_torques_and_ground_forces_balance_the_robot(
    retargeter: Retargeter, dynamics: RobotDynamics, share: float
) -> None:
    """Under the joint torques and the ground forces at the feet, MuJoCo finds no acceleration."""
    base, q, feet = standing(retargeter)
    feet_at, weights = feet[0, :, :3], np.array([1.0 - share, share])
    torque, _ = solve(dynamics, base, q, feet, share)
    model, data = dynamics.model, mujoco.MjData(dynamics.model)
    data.qpos[:7], data.qpos[retargeter.robot.qpos_address] = base[0], q[0]
    data.qfrc_applied[retargeter.robot.dof_address] = torque[0]
    mujoco.mj_forward(model, data)
    total = np.array([0.0, 0.0, retargeter.robot.mass * GRAVITY])
    com = data.subtree_com[retargeter.robot.torso_id]
    left_over = np.cross(com, total) - sum(np.cross(p, w * total) for p, w in zip(feet_at, weights, strict=True))
    for foot, point, weight in zip(retargeter.robot.foot_ids, feet_at, weights, strict=True):
        wrench = data.qfrc_applied
        mujoco.mj_applyFT(model, data, weight * total, weight * left_over, point, foot, wrench)
    mujoco.mj_forward(model, data)
    assert np.abs(data.qacc).max() < 0.02


def test_torques_mirror_with_the_robot(retargeter: Retargeter, dynamics: RobotDynamics) -> None:
    base, q, feet = standing(retargeter)
    torque, _ = solve(dynamics, base, q, feet, 0.5)
    left, right = (torque[0, leg.indices] * leg.signs for leg in retargeter.body.legs)
    np.testing.assert_allclose(left, right * [-1, -1, 1, 1, 1, -1], atol=5e-3)


def test_the_stance_leg_carries_the_robot_and_the_other_only_itself(
    retargeter: Retargeter, dynamics: RobotDynamics
) -> None:
    base, q, feet = standing(retargeter)
    base[0, 1] -= 0.048  # over the right foot: the moment about its sole is small
    q = q.copy()
    torque, _ = solve(dynamics, base, q, feet - [0.0, 0.048, 0.0, 0.0], 1.0)
    left, right = (np.abs(torque[0, leg.indices[3]]) for leg in retargeter.body.legs)
    assert right > 4 * left


def test_an_acceleration_shifts_the_zmp(retargeter: Retargeter, dynamics: RobotDynamics) -> None:
    """The zero-moment point is h a / g behind the centre of mass when the robot accelerates forward."""
    base, q, feet = standing(retargeter)
    pushed = np.array([[0.4, 0.0, 0.0, 0.0, 0.0, 0.0]])
    _, zmp = solve(dynamics, base, q, feet, 0.5, base_acceleration=pushed)
    com = dynamics.centre_of_mass(base, q)[0]
    assert zmp[0, 0] - com[0] == pytest.approx(-com[2] * 0.4 / GRAVITY, rel=1e-3)


def test_free_fall_needs_no_torque(retargeter: Retargeter, dynamics: RobotDynamics) -> None:
    base, q, feet = standing(retargeter)
    torque, _ = solve(dynamics, base, q, feet, 0.5, base_acceleration=np.array([[0, 0, -GRAVITY, 0, 0, 0.0]]))
    np.testing.assert_allclose(torque, 0.0, atol=1e-8)


def test_torques_do_not_depend_on_position_and_heading(retargeter: Retargeter, dynamics: RobotDynamics) -> None:
    base, q, feet = standing(retargeter)
    torque, zmp = solve(dynamics, base, q, feet, 0.3)
    turn, shift = Rotation.from_euler("z", 1.1), np.array([0.7, -0.3, 0.0])
    moved, placed = base.copy(), feet.copy()
    moved[0, :3] = turn.apply(base[0, :3]) + shift
    moved[0, 3:] = (turn * Rotation.from_quat(base[0, 3:], scalar_first=True)).as_quat(scalar_first=True)
    placed[0, :, :3], placed[0, :, 3] = turn.apply(feet[0, :, :3]) + shift, feet[0, :, 3] + 1.1
    again, zmp_again = solve(dynamics, moved, q, placed, 0.3)
    np.testing.assert_allclose(again, torque, atol=1e-6)
    np.testing.assert_allclose(zmp_again[0], turn.apply([*zmp[0], 0.0])[:2] + shift[:2], atol=1e-6)


def test_the_centre_of_pressure_stays_on_the_sole(retargeter: Retargeter, dynamics: RobotDynamics) -> None:
    """For a zero-moment point ahead of the toes, the ankle torque is limited by the lever of the toes."""
    base, q, feet = standing(retargeter)
    ankles = [leg.indices[4] for leg in retargeter.body.legs]
    back = np.array([[-3.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    torque, zmp = solve(dynamics, base, q, feet, 0.5, base_acceleration=back)
    half = retargeter.robot.sole_half_size[0, 0]
    assert zmp[0, 0] > half  # in front of the toes
    toe_lever = half + abs(retargeter.body.legs[0].sole[0])
    assert np.abs(torque[0, ankles]).max() < 0.6 * retargeter.robot.mass * GRAVITY * toe_lever


@pytest.mark.parametrize("tendon", [False, True])
def test_torques_are_those_of_mujoco_with_armature_springs_dampers_and_tendons(
    retargeter: Retargeter, monkeypatch: pytest.MonkeyPatch, tendon: bool
) -> None:
    """Of arms and head of a robot that moves at random; a leg's torques carry planned ground forces as well."""
    robot = retargeter.robot

    def edit(spec: mujoco.MjSpec) -> None:
        for joint in spec.joints[1:]:
            joint.damping, joint.stiffness, joint.armature = [0.3, 0.0, 0.0], [0.7, 0.0, 0.0], 0.01
        if tendon:
            wire = spec.add_tendon(name="wire", stiffness=[40.0, 0.0, 0.0], damping=[3.0, 0.0, 0.0], armature=0.01)
            for name in ("l_sho_pitch", "r_sho_pitch"):
                wire.wrap_joint(name, 0.5)

    model = robot.compile(edit)
    monkeypatch.setattr(robot, "compile", lambda: copy.copy(model))
    own, random = RobotDynamics(robot, retargeter.body.legs), np.random.default_rng(0)
    base = np.hstack([random.normal(size=(4, 3)), Rotation.random(4, rng=0).as_quat(scalar_first=True)])
    q, qd, qdd = random.normal(size=(3, 4, robot.n)) * np.array([0.3, 1.0, 5.0])[:, None, None]
    twist, change = random.normal(size=(2, 4, 6))
    torque, _ = own.inverse(base, twist, change, q, qd, qdd, np.zeros((4, 2, 4)), np.full(4, 0.5))
    upper = ~np.isin(np.arange(robot.n), [leg.indices for leg in retargeter.body.legs])
    data, joints = mujoco.MjData(own.model), robot.dof_address[upper]
    for row in range(4):
        data.qpos[:7], data.qpos[robot.qpos_address] = base[row], q[row]
        data.qvel[:6], data.qvel[robot.dof_address] = twist[row], qd[row]
        data.qacc[:6], data.qacc[robot.dof_address] = change[row], qdd[row]
        mujoco.mj_inverse(own.model, data)
        np.testing.assert_allclose(torque[row, upper], data.qfrc_inverse[joints], atol=1e-9)
    assert bool(own.model.ntendon) == tendon
