from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.reference import Reference


@pytest.fixture(scope="module")
def plan() -> Plan:
    retargeter = Retargeter(load_robot("op3"), load_stream())
    return retargeter.plan(retargeter.standing(), default_clip()[:32], 0, 100)


def test_a_row_is_copied(plan: Plan) -> None:
    reference = Reference(plan.q.shape[1])
    assert not reference.balanced
    reference.take(plan, 90.0)
    for name in ("q", "qd", "torque", "feet", "base", "dcm", "zmp", "contacts"):
        np.testing.assert_array_equal(getattr(reference, name), getattr(plan, name)[90], name)
    np.testing.assert_array_equal(reference.com, plan.com[90, :2])
    assert reference.share == plan.load_share[90] and reference.balanced


def test_between_two_rows_joints_are_interpolated(plan: Plan) -> None:
    reference = Reference(plan.q.shape[1])
    reference.take(plan, 90.25)
    for name in ("q", "qd", "torque"):
        rows = getattr(plan, name)
        np.testing.assert_allclose(getattr(reference, name), 0.75 * rows[90] + 0.25 * rows[91])


def test_past_the_end_the_last_row_is_held_at_rest(plan: Plan) -> None:
    reference = Reference(plan.q.shape[1])
    reference.take(plan, len(plan) + 40.5)
    np.testing.assert_array_equal(reference.q, plan.q[-1])
    assert not reference.qd.any()
    reference.take(plan, -3.0)
    np.testing.assert_array_equal(reference.q, plan.q[0])


def test_reading_leaves_the_plan_as_it_was(plan: Plan) -> None:
    before = plan.q.copy(), plan.feet.copy()
    reference = Reference(plan.q.shape[1])
    reference.take(plan, 10.5)
    reference.q[:] = reference.feet[:] = 9.0
    np.testing.assert_array_equal(plan.q, before[0])
    np.testing.assert_array_equal(plan.feet, before[1])


def test_a_copy_has_memory_of_its_own(plan: Plan) -> None:
    one, other = Reference(plan.q.shape[1]), Reference(plan.q.shape[1])
    one.take(plan, 5.0)
    other.copy(one)
    one.q[:] = 0.0
    np.testing.assert_array_equal(other.q, plan.q[5])
    assert other.balanced
