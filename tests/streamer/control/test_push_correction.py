"""Joints leave their plan for a robot that is pushed, mirrored for the other foot, and come back to it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexmotion.configs.push_correction import Correction
from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.importers.default_clip import default_clip
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.push_correction import PushCorrection
from flexmotion.streamer.control.reference import Reference

ROBOT = load_robot("op3")
assert ROBOT.push_correction is not None
KNOWN: Correction = ROBOT.push_correction
RETARGETER = Retargeter(ROBOT, load_stream())
WALK: Plan = RETARGETER.plan(RETARGETER.standing(), default_clip()[225:300], 0, 0)
SPEED = 3.0
ANKLE_ROLL = [ROBOT.chain(f"{side}_leg")["ankle_roll"] for side in ("left", "right")]


def on_one_foot(side: int) -> tuple[Estimator, Reference]:
    """A robot that is where its plan has it, in the middle of a swing of the other foot."""
    step = next(step for step in WALK.steps if step.side == 1 - side)
    row = (step.lift + step.land) // 2
    reference, state = Reference(ROBOT.n), RobotState(ROBOT.n)
    reference.take(WALK, float(row))
    reference.feet[:, 3], reference.q[:] = 0.0, ROBOT.stand_pose
    state.position[:], state.imu_stale = WALK.q[row], 0
    estimator = Estimator(ROBOT, RETARGETER.omega)
    estimator.update(state, reference)
    return estimator, reference


def pushed(side: int, ahead: float, left: float, ticks: int = 60) -> PushCorrection:
    """What a robot does whose divergent component stays off its plan by this much [m]."""
    estimator, reference = on_one_foot(side)
    estimator.dcm[:] = reference.dcm + (ahead, left)
    correction = PushCorrection(ROBOT)
    for _ in range(ticks):
        correction.update(estimator, reference)
    return correction


@pytest.mark.parametrize(("ahead", "left"), [(0.0, 0.0), (0.99, 0.99), (-9.0, -0.99)])
def test_a_robot_that_sways_as_walks_do_follows_its_plan(ahead: float, left: float) -> None:
    correction = pushed(0, ahead * KNOWN.begins[0], left * KNOWN.begins[1])
    assert not correction.offset.any() and not correction.speed.any()


def test_the_ankle_presses_the_edge_to_which_the_robot_is_pushed() -> None:
    """Went wrong: balance feedback left half of the sole unused, and a robot pushed outward tipped over its edge."""
    turned = [pushed(0, 0.0, left).offset[ANKLE_ROLL[0]] for left in (0.05, -0.05)]
    axis = ROBOT.model.jnt_axis[ROBOT.model.joint(ROBOT.joint_names[ANKLE_ROLL[0]]).id][0]
    assert axis * turned[0] < 0.0 < axis * turned[1]


@pytest.mark.parametrize(("ahead", "left"), [(0.0, 0.04), (0.0, -0.05), (0.06, 0.0), (0.04, 0.03), (0.2, -0.3)])
def test_the_other_foot_answers_as_a_mirror_image(ahead: float, left: float) -> None:
    one, other = pushed(0, ahead, left).offset, pushed(1, ahead, -left).offset
    assert one.any()
    legs = [np.array(list(ROBOT.chain(f"{side}_leg").values())) for side in ("left", "right")]
    # Joint signs of OP3: a pose mirrored left to right has every angle of a side negated.
    np.testing.assert_allclose(one[legs[0]], -other[legs[1]], atol=1e-12)
    np.testing.assert_allclose(one[legs[1]], -other[legs[0]], atol=1e-12)


def test_joints_leave_the_plan_no_faster_and_no_further_than_they_may() -> None:
    estimator, reference = on_one_foot(0)
    correction, before = PushCorrection(ROBOT), np.zeros(ROBOT.n)
    for tick in range(40):
        estimator.dcm[:] = reference.dcm + (0.3 * (-1) ** (tick // 7), 0.4)
        correction.update(estimator, reference)
        np.testing.assert_allclose(correction.speed, (correction.offset - before) * ROBOT.rate_hz, atol=1e-9)
        assert np.abs(correction.speed).max() <= SPEED + 1e-9 and np.abs(correction.offset).max() <= KNOWN.most
        before = correction.offset.copy()


@pytest.mark.parametrize(("left", "falls"), [(0.1, False), (-0.2, True)])
def test_an_error_of_no_robot_that_stands_is_a_fall(left: float, falls: bool) -> None:
    """Went wrong: the leg of a falling robot was stopped in a tick, and its goal implied 1.04 of the stall torque."""
    assert pushed(0, 0.0, left).falls == falls


def test_a_joint_near_its_limit_is_brought_no_nearer() -> None:
    """Went wrong: a falling robot ran its hip past the limit, and its goal implied 1.03 of the stall torque."""
    estimator, reference = on_one_foot(0)
    moved = pushed(0, 0.0, -0.08).offset
    hip = ROBOT.chain("left_leg")["hip_roll"]
    reference.q[hip] = ROBOT.upper[hip] if moved[hip] > 0.0 else ROBOT.lower[hip]
    estimator.dcm[:] = reference.dcm + (0.0, -0.08)
    correction = PushCorrection(ROBOT)
    for _ in range(60):
        correction.update(estimator, reference)
    assert moved[hip] and not correction.offset[hip] and correction.offset.any()


def test_a_joint_on_its_way_back_keeps_room_to_a_limit_that_its_plan_comes_near() -> None:
    """Went wrong: only the answer was bounded, and a decaying offset ended at the limit."""
    estimator, reference = on_one_foot(0)
    estimator.dcm[:] = reference.dcm + (0.0, -0.08)
    correction, hip = PushCorrection(ROBOT), ROBOT.chain("left_leg")["hip_roll"]
    for _ in range(40):
        correction.update(estimator, reference)
    away = correction.offset[hip]
    assert abs(away) > 0.1
    reference.q[hip] = ROBOT.upper[hip] - 0.16 if away > 0.0 else ROBOT.lower[hip] + 0.16
    estimator.dcm[:] = reference.dcm
    for _ in range(12):  # faster than it decays
        correction.update(estimator, reference)
    assert abs(correction.offset[hip]) <= 0.01 + 1e-9


def test_what_is_not_believed_is_not_answered() -> None:
    """Went wrong: a robot whose bus was silent answered the sway of joints that were only assumed."""
    estimator, reference = on_one_foot(0)
    estimator.dcm[:] = reference.dcm + (0.05, 0.05)
    correction = PushCorrection(ROBOT)
    assert not any(correction.update(estimator, reference, measured=False) for _ in range(20))
    # Nor a single reading between good ones.
    for tick in range(20):
        estimator.dcm[:] = reference.dcm + (0.05, 0.05) if tick % 2 else reference.dcm
        assert not correction.update(estimator, reference)


def test_the_joints_come_back_to_their_plan_to_the_last_bit() -> None:
    estimator, reference = on_one_foot(1)
    estimator.dcm[:] = reference.dcm + (0.05, 0.05)
    correction = PushCorrection(ROBOT)
    assert not correction.update(estimator, reference)  # one reading alone may be wrong
    assert all(correction.update(estimator, reference) for _ in range(20))
    estimator.dcm[:] = reference.dcm
    ticks = next(tick for tick in range(1000) if not correction.update(estimator, reference))
    assert 0.1 < ticks / ROBOT.rate_hz < 1.0
    assert not correction.offset.any() and not correction.speed.any()


@pytest.mark.parametrize("why", ["switched off", "no balance", "no imu", "in the air", "no number", "no file"])
def test_without_its_conditions_it_does_nothing(why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if why == "no file":
        monkeypatch.setattr(ROBOT, "push_correction", None)
    estimator, reference = on_one_foot(0)
    estimator.dcm[:] = reference.dcm + (0.05, math.nan if why == "no number" else 0.05)
    reference.balanced, estimator.has_imu = why != "no balance", why != "no imu"
    correction = PushCorrection(ROBOT, enabled=why != "switched off")
    assert not correction.update(estimator, reference, hung=why == "in the air")
    assert not correction.offset.any()
