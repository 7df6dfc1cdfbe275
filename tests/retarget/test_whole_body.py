from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.whole_body import POSTURE, WholeBody
from flexmotion.spatial.rotations import yaw_matrices

ROWS = 40


@pytest.fixture
def body(retargeter: Retargeter) -> WholeBody:
    return retargeter.body


def reach(body: WholeBody, height: float, tilt: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feet (T, 2, 4), centre of mass (T, 2) and channels (T, 4 + U) of a robot that sways and turns on planted feet."""
    rng = np.random.default_rng(5)
    feet = np.broadcast_to(body.home_feet, (ROWS, 2, 4)).copy()
    com = np.column_stack([0.01 * np.sin(np.linspace(0, 6, ROWS)), 0.02 * np.cos(np.linspace(0, 6, ROWS))])
    channels = np.zeros((ROWS, len(POSTURE) + len(body.upper.joints)))
    channels[:, 0] = height
    channels[:, 1:4] = tilt * np.sin(np.linspace(0, 4, ROWS)[:, None] + rng.uniform(-3, 3, 3))
    channels[:, 4:] = body.robot.stand_pose[body.upper.joints] + 0.2 * np.sin(np.linspace(0, 3, ROWS))[:, None]
    return feet, com, channels


@pytest.mark.parametrize(("height", "tilt"), [(0.19, 0.0), (0.175, 0.15), (0.13, 0.1)])
def test_feet_torso_and_centre_of_mass_are_at_their_targets(body: WholeBody, height: float, tilt: float) -> None:
    feet, com, channels = reach(body, height, tilt)
    base, q, offset, short = body.solve(feet, com, channels, np.zeros(2), 4)
    assert short.max() == 0.0
    np.testing.assert_allclose(body.dynamics.centre_of_mass(base, q)[:, :2], com, atol=2e-4)
    np.testing.assert_allclose(base[:, :2] + offset, com, atol=1e-12)
    angles = Rotation.from_quat(base[:, 3:], scalar_first=True).as_euler("ZYX")
    np.testing.assert_allclose(angles, channels[:, [3, 2, 1]], atol=1e-9)
    np.testing.assert_array_equal(q[:, body.upper.joints], channels[:, 4:])
    model, data, robot = body.robot.model, mujoco.MjData(body.robot.model), body.robot
    for k in range(0, ROWS, 7):
        data.qpos[:7], data.qpos[robot.qpos_address] = base[k], q[k]
        mujoco.mj_kinematics(model, data)
        for side, foot in enumerate(robot.foot_ids):
            rotation = data.xmat[foot].reshape(3, 3)
            np.testing.assert_allclose(data.xpos[foot] + rotation @ robot.soles[side], feet[k, side, :3], atol=3e-4)
            np.testing.assert_allclose(rotation, np.eye(3), atol=1e-6)


def test_the_missing_length_of_the_legs_is_returned(body: WholeBody) -> None:
    feet, com, channels = reach(body, body.leg_length + 0.03)
    _, q, _, short = body.solve(feet, com, channels, np.zeros(2))
    assert (short > 0.02).all()
    assert np.isfinite(q).all()


def test_two_passes_from_the_last_offset_converge(body: WholeBody) -> None:
    feet, com, channels = reach(body, 0.18, 0.1)
    _, _, exact, _ = body.solve(feet, com, channels, np.zeros(2), 8)
    base, q, _, _ = body.solve(feet, com, channels, exact[0])
    np.testing.assert_allclose(body.dynamics.centre_of_mass(base, q)[:, :2], com, atol=2e-4)


def test_home_feet_are_mirror_images_around_the_origin(body: WholeBody) -> None:
    np.testing.assert_allclose(body.home_feet[0], body.home_feet[1] * [1, -1, 1, 1], atol=1e-9)
    assert body.stand_width == pytest.approx(2 * body.home_feet[0, 1])


def test_yaw_matrices_turns_left() -> None:
    np.testing.assert_allclose(yaw_matrices(np.array([np.pi / 2]))[0] @ [1, 0, 0], [0, 1, 0], atol=1e-12)
