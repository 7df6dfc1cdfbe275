from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.retarget import arm_loops
from flexmotion.retarget.arm_cost import ArmTargets
from flexmotion.retarget.arms import UpperBody
from flexmotion.retarget.legs import Leg
from flexmotion.retarget.smoothing import Follower


def cheapest(q: np.ndarray, cost: np.ndarray, travel: float) -> np.ndarray:
    zero = np.zeros(q.shape[2:])
    return arm_loops.cheapest(q, cost, zero, zero + 0.1, travel, 0.0, zero)


def test_the_cheapest_way_is_that_of_all_ways() -> None:
    rng = np.random.default_rng(0)
    q, cost = rng.uniform(-1.0, 1.0, (4, 3, 2, 2)), rng.uniform(0.0, 1.0, (4, 3, 2))
    found = cheapest(q, cost, 0.8)
    for side in range(2):
        ways = np.stack(np.meshgrid(*[np.arange(3)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
        poses = q[np.arange(4), ways, side]
        moves = np.abs(np.diff(poses, axis=1, prepend=np.zeros((len(ways), 1, 2)))) - 0.1
        total = cost[np.arange(4), ways, side].sum(axis=1) + 0.8 * np.maximum(moves.max(axis=2), 0.0).sum(axis=1)
        np.testing.assert_allclose(found[:, side], poses[total.argmin()])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_costs_that_are_no_numbers_lead_through_candidates(value: float) -> None:
    """Memory that was never written was used as an index: the process ended with SIGBUS."""
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (30, 8, 2, 3))
    found = cheapest(q, np.full((30, 8, 2), value), 4.0)
    assert (np.abs(found[:, None] - q).max(axis=-1).min(axis=1) == 0.0).all()


def test_targets_that_are_no_numbers_give_poses_that_are_none(op3: Robot) -> None:
    """A plan ended in a LinAlgError without a name, where it is to be refused as one that holds no numbers."""
    upper = UpperBody(op3)
    unit, cost = np.broadcast_to([1.0, 0.0, 0.0], (2, 2, 3)).copy(), upper._path.cost
    unit[1, 0] = np.nan
    targets = ArmTargets(unit, unit, np.zeros((2, 2)), np.zeros(2))
    found = cost.improved(targets, np.repeat(op3.stand_pose[upper.arms][None], 2, axis=0))
    assert np.isnan(found[1, 0]).all() and np.isfinite(found[0]).all() and np.isfinite(found[1, 1]).all()


def test_arrays_of_other_lengths_are_refused(op3: Robot) -> None:
    """Rows beyond the end of an array were read, and numbers came out: the loops check no bounds."""
    upper, eye = UpperBody(op3), np.eye(3)
    unit = np.broadcast_to([1.0, 0.0, 0.0], (2, 2, 3))
    targets = ArmTargets(unit, unit, np.zeros((2, 2)), np.zeros(2))
    for count in (0, 3):
        with pytest.raises(ValueError, match=f"{count} poses of 2 targets"):
            upper._path.cost.of(targets, np.zeros((count, *upper.arms.shape)))
    follower = Follower(np.full(3, 10.0), np.ones(3), np.ones(3), 0.008)
    with pytest.raises(ValueError, match="3 channels"):
        follower.follow(np.zeros((5, 3)), np.zeros(1), np.zeros(1))
    leg = Leg.of(op3, "left")
    rows = np.broadcast_to(eye, (4, 3, 3))
    with pytest.raises(ValueError, match="4 rows of 1 legs"):
        leg.solve(np.zeros((4, 3)), rows, np.zeros((1, 3)), rows[:1])
