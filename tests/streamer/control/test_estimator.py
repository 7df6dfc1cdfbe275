from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator, roll_pitch
from flexmotion.streamer.control.reference import Reference

ROBOT = load_robot("op3")
RETARGETER = Retargeter(ROBOT, load_stream())
STAND = RETARGETER.plan(RETARGETER.standing(), None, 0, 0)
UP = np.array([0.0, 0.0, 9.81])


def measured(*, imu: bool = True, tilt: tuple[float, float] = (0.0, 0.0)) -> RobotState:
    """The stand pose at rest, its torso tilted by roll and pitch [rad]."""
    state = RobotState(ROBOT.n)
    state.position[:] = STAND.q[0]
    state.accel[:] = Rotation.from_euler("ZYX", [0.0, tilt[1], tilt[0]]).inv().apply(UP)
    state.imu_stale = 0 if imu else -1
    return state


def reference(shift: float = 0.0, yaw: float = 0.0) -> Reference:
    made = Reference(ROBOT.n)
    made.take(STAND, 0.0)
    turn = Rotation.from_euler("z", yaw).as_matrix()[:2, :2]
    made.feet[:, :2] = made.feet[:, :2] @ turn.T + [shift, 0.0]
    made.feet[:, 3] = yaw
    return made


def settled(state: RobotState, wanted: Reference, ticks: int = 250) -> Estimator:
    estimator = Estimator(ROBOT, RETARGETER.omega)
    for _ in range(ticks):
        estimator.update(state, wanted)
    return estimator


def test_a_robot_that_stands_as_planned_has_the_planned_centre_of_mass() -> None:
    estimator = settled(measured(), reference())
    np.testing.assert_allclose(estimator.com, STAND.com[0, :2], atol=1e-3)
    np.testing.assert_allclose(estimator.dcm, estimator.com, atol=1e-4)
    np.testing.assert_allclose(estimator.tilt, 0.0, atol=0.01)


def test_the_feet_are_where_the_plan_placed_them() -> None:
    here, there = settled(measured(), reference()), settled(measured(), reference(shift=0.7, yaw=1.1))
    turn = Rotation.from_euler("z", 1.1).as_matrix()
    np.testing.assert_allclose(there.com, (turn @ [*here.com, 0.0])[:2] + [0.7, 0.0], atol=1e-6)
    np.testing.assert_allclose(there.leg_axes, here.leg_axes @ turn.T, atol=1e-6)


@pytest.mark.parametrize("tilt", [(0.1, 0.0), (0.0, 0.15), (-0.1, -0.1)])
def test_tilt_comes_from_the_imu(tilt: tuple[float, float]) -> None:
    estimator = settled(measured(tilt=tilt), reference(), ticks=2000)
    np.testing.assert_allclose(estimator.tilt, tilt, atol=0.02)


def test_a_robot_that_lies_is_tilted_by_half_a_turn_at_most() -> None:
    """Roll and pitch as the sides of a triangle told an operator of a robot that was tilted by 191°."""
    estimator = settled(measured(), reference())
    for roll, pitch, angle in ((-3.0293, -1.3956, 1.7446), (0.3, 0.0, 0.3), (0.0, -0.4, 0.4), (np.pi, 0.0, np.pi)):
        estimator.tilt[:] = roll, pitch
        np.testing.assert_allclose(estimator.tilt_angle, angle, atol=1e-3)
        up = Rotation.from_euler("xyz", [roll, pitch, 0.0]).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(estimator.tilt_angle, np.arccos(up[2]), atol=1e-6)


def test_a_torso_that_leans_forward_moves_the_centre_of_mass_forward() -> None:
    upright = settled(measured(), reference())
    leaning = settled(measured(tilt=(0.0, 0.1)), reference(), ticks=2000)
    assert leaning.com[0] > upright.com[0] + 0.01


def test_without_an_imu_the_tilt_is_that_of_the_reference() -> None:
    wanted = reference()
    wanted.base[3:] = Rotation.from_euler("ZYX", [0.4, 0.2, -0.1]).as_quat(scalar_first=True)
    estimator = settled(measured(imu=False), wanted, ticks=1)
    assert not estimator.has_imu
    np.testing.assert_allclose(estimator.tilt, [-0.1, 0.2], atol=1e-9)
    assert not estimator.tilt_rate.any()


def test_an_imu_that_misses_a_few_reads_still_counts() -> None:
    estimator = settled(measured(), reference())
    late = measured()
    late.imu_stale = 3
    estimator.update(late, reference())
    assert estimator.has_imu


@pytest.mark.parametrize("missed", [3, 25])
def test_a_torso_that_turns_while_samples_are_missed_is_tilted_by_that_turn(missed: int) -> None:
    """A robot fell, its IMU was silent for 0.2 s, and its fall was detected 22 ticks late.

    The attitude had stood still meanwhile.
    """
    estimator, rate, angle = settled(measured(), reference()), 1.5, 0.0
    for tick in range(40):
        angle += rate / ROBOT.rate_hz
        state = measured(tilt=(angle, 0.0))
        state.gyro[0] = rate
        state.imu_stale = max(tick - 5, 0) if tick < 5 + missed else 0
        estimator.update(state, reference())
    assert estimator.has_imu
    np.testing.assert_allclose(estimator.tilt[0], angle, atol=0.02)


def test_a_silence_of_seconds_is_no_turn() -> None:
    estimator, state = settled(measured(), reference()), measured()
    state.gyro[0] = 1.0
    estimator.update(state, reference())
    state.imu_stale = 500
    for _ in range(500):
        estimator.update(state, reference())
    estimator.update(measured(), reference())
    assert estimator.tilt_angle < 0.02


def test_a_missed_sample_is_no_rotation_by_the_bias() -> None:
    """The bias was subtracted from the zeros of a lost sample too: the robot seemed to turn by minus the bias."""
    estimator = Estimator(ROBOT, RETARGETER.omega)
    state = measured()
    estimator.gyro_bias[:] = state.gyro[:] = [0.03, -0.02, 0.01]
    for _ in range(10):
        estimator.update(state, reference())
    state.gyro[:], state.imu_stale = 0.0, 1
    estimator.update(state, reference())
    assert estimator.has_imu
    np.testing.assert_allclose(estimator.tilt_rate, 0.0, atol=1e-12)


def test_moving_joints_move_the_divergent_component_ahead() -> None:
    state = measured()
    for side in ("left", "right"):
        leg = ROBOT.chain(f"{side}_leg")
        sign = 1.0 if side == "left" else -1.0
        state.velocity[leg["ankle_pitch"]] = -0.5 * sign
    moving = settled(state, reference())
    assert abs(moving.dcm[0] - moving.com[0]) > 0.003
    np.testing.assert_allclose(moving.dcm - moving.com, moving.com_velocity / RETARGETER.omega, atol=1e-12)


@given(yaw=st.floats(-3, 3), pitch=st.floats(-1.4, 1.4), roll=st.floats(-3, 3))
def test_roll_and_pitch_of_any_heading(yaw: float, pitch: float, roll: float) -> None:
    quaternion = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
    np.testing.assert_allclose(roll_pitch(quaternion), [roll, pitch], atol=1e-7)


def test_a_robot_that_turns_on_the_spot_has_turned_by_the_gyroscope_whole_turns_counted() -> None:
    """The attitude filter holds its heading at zero for 3 s: a robot that turned as soon as it stood was 12° off."""
    estimator, state = Estimator(ROBOT, RETARGETER.omega), measured()
    state.gyro[:] = [0.0, 0.0, 1.0]
    for _ in range(int(8.0 * ROBOT.rate_hz)):
        estimator.update(state, reference())
    assert estimator.odometry[2] == pytest.approx(8.0, abs=0.05)
    estimator.reset()
    np.testing.assert_array_equal(estimator.odometry, 0.0)


def test_a_leaning_torso_turns_about_the_vertical() -> None:
    """A torso that leans by 30° and turns at 1 rad/s measures part of it as roll."""
    state = measured(tilt=(0.0, np.radians(30.0)))
    estimator = Estimator(ROBOT, RETARGETER.omega)
    for _ in range(int(4.0 * ROBOT.rate_hz)):
        estimator.update(state, reference())
    state.gyro[:] = state.accel / np.linalg.norm(UP)
    for _ in range(int(2.0 * ROBOT.rate_hz)):
        estimator.update(state, reference())
    assert estimator.odometry[2] == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("imu", [True, False])
def test_legs_that_swing_back_carry_the_robot_ahead(imu: bool) -> None:
    """The odometry comes from the joints' speeds and the stance, with and without a gyroscope."""
    state = measured(imu=imu)
    hips = [ROBOT.chain(f"{side}_leg")["hip_pitch"] for side in ("left", "right")]
    still = settled(state, reference(), ticks=125)
    np.testing.assert_allclose(still.odometry, 0.0, atol=1e-6)
    ways = []
    for sign in (1.0, -1.0):
        moving = Estimator(ROBOT, RETARGETER.omega)
        signs = [sign * np.sign(ROBOT.model.jnt_axis[ROBOT.model.joint(ROBOT.joint_names[i]).id][1]) for i in hips]
        state.velocity[:] = 0.0
        state.velocity[hips] = 0.1 * np.array(signs)
        for _ in range(125):
            moving.update(state, reference())
        ways.append(moving.odometry.copy())
    # The legs are some .2 m long: .1 rad/s moves the hips by 2 cm in a second.
    assert ways[0][0] * ways[1][0] < 0.0 and 0.005 < abs(ways[0][0]) < 0.05
    assert max(abs(way[1]) for way in ways) < 2e-3 and max(abs(way[2]) for way in ways) < 2e-2
