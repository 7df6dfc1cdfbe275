from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.streamer.control.load_estimator import LoadEstimator

ROBOT = load_robot("op3")
TICKS = int(8 * ROBOT.rate_hz)
LOAD = 0.6 * ROBOT.usable_torque * np.sign(np.arange(ROBOT.n) % 2 - 0.5)


def settle(scale: float, load: np.ndarray = LOAD, ticks: int = TICKS) -> LoadEstimator:
    """An estimator whose robot needs `scale` times its planned torque, and gets `factor` times."""
    estimator = LoadEstimator(ROBOT)
    reference = ROBOT.stand_pose
    for _ in range(ticks):
        # The joints sag by the torque that the factor does not supply.
        sag = (scale - estimator.factor) * load / ROBOT.kp
        estimator.update(reference, reference - sag, load)
    return estimator


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.12, 1.3])
def test_the_factor_converges_to_the_true_load(scale: float) -> None:
    assert settle(scale).factor == pytest.approx(scale, abs=0.01)


@pytest.mark.parametrize(("scale", "bound"), [(3.0, 1.35), (0.1, 0.8)])
def test_it_stays_within_its_bounds(scale: float, bound: float) -> None:
    assert settle(scale).factor == bound


def test_without_load_nothing_is_learned() -> None:
    estimator = LoadEstimator(ROBOT)
    for _ in range(TICKS):
        estimator.update(ROBOT.stand_pose, ROBOT.stand_pose - 0.05, np.zeros(ROBOT.n))
    assert estimator.factor == 1.0


def test_arms_and_head_have_no_influence() -> None:
    estimator = LoadEstimator(ROBOT)
    others = np.setdiff1d(np.arange(ROBOT.n), estimator.legs)
    measured = ROBOT.stand_pose.copy()
    measured[others] += 1.0
    estimator.update(ROBOT.stand_pose, measured, LOAD)
    assert estimator.factor == 1.0


def test_a_step_long_error_moves_it_little() -> None:
    assert settle(1.3, ticks=int(0.1 * ROBOT.rate_hz)).factor < 1.05
