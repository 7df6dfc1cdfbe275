"""Restrictions of plans: feet that are to stay where they are, names of joints, and torques that are capped."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot
from flexmotion.human.motion import Motion
from flexmotion.retarget.effort import Judged, effort
from flexmotion.retarget.joint_names import joints_named
from flexmotion.retarget.restrictions import Restrictions
from flexmotion.retarget.retargeter import Retargeter

ROBOT = load_robot("op3")
KNEE, ELBOW = ROBOT.index("l_knee"), ROBOT.index("r_el")
LEGS = np.array([*ROBOT.chain("left_leg").values(), *ROBOT.chain("right_leg").values()])


@pytest.mark.parametrize("planted", [{0}, {1}, {0, 1}])
def test_a_walk_is_made_on_the_spot_and_says_so(retargeter: Retargeter, walk: Motion, planted: set[int]) -> None:
    free = retargeter.plan(retargeter.standing(), walk, 0, 0)
    assert free.withheld == 0 and free.steps
    plan = retargeter.plan(retargeter.standing(), walk, 0, 0, restrictions=Restrictions(frozenset(planted)))
    assert plan.withheld > 0 and not plan.steps and plan.contacts.all()


@pytest.mark.parametrize(("planted", "moves"), [(set(), 1), ({0}, 1), ({1}, 0), ({0, 1}, None)])
def test_a_stop_ends_with_the_feet_side_by_side_by_a_foot_that_may_move(
    retargeter: Retargeter, planted: set[int], moves: int | None
) -> None:
    state = retargeter.standing()
    view = retargeter.layout.view(state)
    feet, view.landed[...], view.stance[...] = view.feet, -1.0, 1.0  # the left foot has landed
    feet[0, 0] += 0.06
    held = feet.copy()
    plan = retargeter.plan(state, None, 0, 0, restrictions=Restrictions(frozenset(planted)))
    assert [step.side for step in plan.steps] == ([] if moves is None else [moves])
    for side in planted:
        assert np.allclose(plan.feet[:, side], held[side], atol=1e-9)
    if moves is not None:
        left, right = plan.feet[-1]
        assert np.hypot(*(left - right)[:2]) == pytest.approx(retargeter.body.stand_width, abs=1e-6)
        assert left[1] > right[1]


def test_caps_of_arms_bind_the_goals_of_the_loop_and_caps_of_legs_do_not(retargeter: Retargeter) -> None:
    caps = {KNEE: 1.0, ELBOW: 0.5}
    plan = retargeter.plan(retargeter.standing(), None, 0, 0, restrictions=Restrictions(caps=caps))
    assert plan.torque_cap[ELBOW] == 0.5 and np.isinf(np.delete(plan.torque_cap, ELBOW)).all()
    assert (plan.asked_cap[KNEE], plan.asked_cap[ELBOW]) == (1.0, 0.5)
    assert np.isinf(np.delete(plan.asked_cap, [KNEE, ELBOW])).all()


def test_a_capped_plan_needs_no_more_or_comes_to_a_stop(retargeter: Retargeter, walk: Motion) -> None:
    """Without an effort limit in the settings plans are judged by caps alone."""
    steps = walk[30:]
    plan = retargeter.plan(retargeter.standing(), steps, 0, 0, restrictions=Restrictions(caps={KNEE: 1.0}))
    assert plan.eased is not None and (plan.eased.refused or plan.eased.effort.load <= 1.0)
    assert plan.eased.first.cap == 1.0 and plan.eased.first.torque > 1.0
    assert np.abs(plan.torque[: plan.stop_row, KNEE]).max(initial=0.0) <= 1.0


def test_the_load_of_a_cap_is_the_allowed_one_at_the_cap() -> None:
    torque, speed = np.zeros((50, ROBOT.n)), np.zeros((50, ROBOT.n))
    torque[20, ELBOW] = -0.6
    cap = np.full(ROBOT.n, np.inf)
    cap[ELBOW] = 0.5
    for envelope, allowed in ((None, 1.0), (Envelope.of(ROBOT), 0.8)):
        found = effort(Judged(envelope, allowed, LEGS), torque, speed, (0, 0), 50, cap)
        assert (found.joint, found.row, found.cap) == (ELBOW, 20, 0.5)
        assert found.load == pytest.approx(allowed * 1.2)
    alone = effort(Judged(None, 1.0, LEGS), torque, speed, (0, 0), 50)
    assert (alone.load, alone.cap) == (0.0, None)


@pytest.mark.parametrize(
    ("name", "joints"),
    [
        ("l_knee", {"l_knee"}),
        ("knee", {"l_knee", "r_knee"}),
        ("right elbow", {"r_el"}),
        ("left shoulder", {"l_sho_pitch", "l_sho_roll"}),
        ("hip", {f"{side}_hip_{axis}" for side in "lr" for axis in ("yaw", "roll", "pitch")}),
        ("left ankle", {"l_ank_pitch", "l_ank_roll"}),
        ("neck", {"head_pan", "head_tilt"}),
    ],
)
def test_a_name_of_the_body_means_the_joints_of_the_robot(name: str, joints: set[str]) -> None:
    assert set(joints_named(ROBOT, name)) == joints


@pytest.mark.parametrize("name", ["nose", "left neck", "upper knee", "wrist", "knee left"])
def test_a_joint_that_the_robot_lacks_is_refused_with_those_that_it_has(name: str) -> None:
    with pytest.raises(ConfigError, match="is not known; expected hip, knee, ankle, .*, or head_pan, head_tilt"):
        joints_named(ROBOT, name)


def test_only_joints_that_the_robot_has_are_offered() -> None:
    """A cap of the left wrist, of a robot without one, was refused with an offer of the wrist."""
    with pytest.raises(ConfigError, match="expected hip, knee, ankle, shoulder, elbow, neck, one of them on the left"):
        joints_named(ROBOT, "left wrist")
