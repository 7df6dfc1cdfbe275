from __future__ import annotations

import numpy as np
import pytest

from flexmotion.retarget.bend import TrunkBend
from flexmotion.retarget.retargeter import Retargeter


@pytest.fixture
def bend(retargeter: Retargeter) -> TrunkBend:
    return retargeter.bend


def bent(retargeter: Retargeter, height: float, pitch: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Torso (1, 7), joints (1, n) and distance of the centre of mass from the middle of the feet [m]."""
    body = retargeter.body
    channels = np.concatenate([[height, 0.0, pitch, 0.0], retargeter.robot.stand_pose[body.upper.joints]])
    base, q, _, _ = body.solve(body.home_feet[None], np.zeros((1, 2)), channels[None], np.zeros(2), 12)
    return base, q, float(np.linalg.norm(body.dynamics.centre_of_mass(base, q)[0, :2]))


@pytest.mark.parametrize("row", range(6))
def test_the_legs_can_stand_in_the_deepest_bend(retargeter: Retargeter, bend: TrunkBend, row: int) -> None:
    base, q, away = bent(retargeter, bend.heights[row], bend.balanced[row, 1])
    assert (q >= retargeter.robot.lower).all() and (q <= retargeter.robot.upper).all()
    assert away < 2e-3 and base[0, 0] < -0.01  # balanced, by hips that go back


def test_the_hips_end_the_bend_of_a_robot_that_stands(retargeter: Retargeter, bend: TrunkBend) -> None:
    robot = retargeter.robot
    _, q, _ = bent(retargeter, bend.heights[-1], bend.balanced[-1, 1] + 0.05)
    outside = np.flatnonzero(((q < robot.lower) | (q > robot.upper))[0])
    assert {robot.joint_names[joint] for joint in outside} == {"l_hip_pitch", "r_hip_pitch"}


def test_a_crouching_robot_bends_less_deep(bend: TrunkBend) -> None:
    assert (np.diff(bend.balanced[:, 1]) > 0).all()


def test_plans_bow_no_further_than_the_robot_file_says(retargeter: Retargeter, bend: TrunkBend) -> None:
    least, most = bend.bounds(np.linspace(0.1, 0.25, 7))
    tilt = retargeter.robot.safety.bow_tilt
    assert tilt is not None and (most <= tilt).all() and (least >= -tilt).all()
    assert (bend.balanced[-1, 1] > most[-1]).all()  # at standing height the file bounds it, not balance


def test_without_a_proof_plans_stay_away_from_what_counts_as_a_fall(retargeter: Retargeter, bend: TrunkBend) -> None:
    safety = retargeter.robot.safety.model_copy(update={"bow_tilt": None})
    assert safety.most_tilt == pytest.approx(safety.fall_tilt - 0.085)
