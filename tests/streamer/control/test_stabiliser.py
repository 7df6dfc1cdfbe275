from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.stabiliser import DCM_GAIN, Stabiliser

ROBOT = load_robot("op3")
ZMP_SHIFT = np.array(ROBOT.gait.zmp_feedback)
RETARGETER = Retargeter(ROBOT, load_stream())
STAND = RETARGETER.plan(RETARGETER.standing(), None, 0, 0)


@pytest.fixture
def standing() -> tuple[Estimator, Reference]:
    return facing(0.0)


def facing(yaw: float) -> tuple[Estimator, Reference]:
    """A robot that stands with heading `yaw` [rad]."""
    reference, state = Reference(ROBOT.n), RobotState(ROBOT.n)
    reference.take(STAND, 0.0)
    reference.feet[:, 3] = yaw
    state.position[:], state.imu_stale = STAND.q[0], 0
    estimator = Estimator(ROBOT, RETARGETER.omega)
    estimator.update(state, reference)
    return estimator, reference


def act(estimator: Estimator, reference: Reference, error: tuple[float, float], *, enabled: bool = True) -> Stabiliser:
    estimator.dcm[:] = reference.dcm + error
    stabiliser = Stabiliser(ROBOT, enabled=enabled)
    stabiliser.update(estimator, reference)
    return stabiliser


def test_no_error_no_torque(standing: tuple[Estimator, Reference]) -> None:
    assert not act(*standing, (0.0, 0.0)).torque.any()


@pytest.mark.parametrize("error", [(0.01, 0.0), (-0.02, 0.01), (0.0, -0.01)])
def test_the_zero_moment_point_shifts_with_the_error(
    standing: tuple[Estimator, Reference], error: tuple[float, float]
) -> None:
    np.testing.assert_allclose(act(*standing, error).zmp_shift, DCM_GAIN * np.array(error))


def test_the_shift_is_bounded_along_and_across_the_feet(standing: tuple[Estimator, Reference]) -> None:
    np.testing.assert_allclose(act(*standing, (9.0, -9.0)).zmp_shift, ZMP_SHIFT * [1, -1])
    estimator, reference = standing
    reference.feet[:, 3] = np.pi / 2
    np.testing.assert_allclose(act(estimator, reference, (9.0, -9.0)).zmp_shift, ZMP_SHIFT[::-1] * [1, -1])


@pytest.mark.parametrize("yaw", [0.0, 0.5 * np.pi, -2.0])
@pytest.mark.parametrize(("part", "leans", "turns"), [(4, (1.0, 0.0), 1.0), (5, (0.0, 1.0), -1.0)])
def test_the_ankles_push_down_the_edge_of_the_feet_to_which_the_robot_leans(
    part: int, leans: tuple[float, float], turns: float, yaw: float
) -> None:
    """Weight times shift is the moment that both ankles make together: pitch forward, roll to the left."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    error = 0.01 * np.array([cos * leans[0] - sin * leans[1], sin * leans[0] + cos * leans[1]])
    torque = act(*facing(yaw), (error[0], error[1])).torque
    left, right = (RETARGETER.body.legs[side] for side in (0, 1))
    ankles = [torque[leg.indices[part]] * leg.signs[part] for leg in (left, right)]
    assert sum(ankles) == pytest.approx(turns * ROBOT.mass * 9.81 * DCM_GAIN * 0.01, rel=0.01)
    assert ankles[0] == pytest.approx(ankles[1], rel=0.01)


def test_a_foot_without_load_makes_no_torque(standing: tuple[Estimator, Reference]) -> None:
    estimator, reference = standing
    reference.share = 1.0
    torque = act(estimator, reference, (0.02, 0.01)).torque
    assert not torque[RETARGETER.body.legs[0].indices].any()
    assert torque[RETARGETER.body.legs[1].indices].any()
    assert not np.delete(torque, np.concatenate([leg.indices for leg in RETARGETER.body.legs])).any()


@pytest.mark.parametrize("why", ["switched off", "no balance", "no imu"])
def test_without_its_conditions_it_does_nothing(standing: tuple[Estimator, Reference], why: str) -> None:
    estimator, reference = standing
    reference.balanced = why != "no balance"
    estimator.has_imu = why != "no imu"
    assert not act(estimator, reference, (0.02, 0.01), enabled=why != "switched off").torque.any()
