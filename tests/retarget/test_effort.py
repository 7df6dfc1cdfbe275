from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.envelope import Envelope
from flexmotion.configs.robot import load_robot
from flexmotion.retarget.effort import REACTION_S, SETTLING_S, Judged, changeable, effort
from flexmotion.retarget.steps import Step

ROBOT = load_robot("op3")
ENVELOPE = Envelope.of(ROBOT)
KNEE, ELBOW = ROBOT.index("l_knee"), ROBOT.index("r_el")
LEGS = np.array([*ROBOT.chain("left_leg").values(), *ROBOT.chain("right_leg").values()])
JUDGED = Judged(ENVELOPE, 1.0, LEGS)
ROWS = 100


def flat() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((ROWS, ROBOT.n)), np.zeros((ROWS, ROBOT.n))


def test_hardest_moment_of_a_plan() -> None:
    torque, speed = flat()
    torque[40, KNEE], speed[40, KNEE] = -3.0, -1.0
    torque[60, ELBOW] = 3.0  # it stands, where 4.1 N·m are there
    found = effort(JUDGED, torque, speed, (0, 0), ROWS)
    assert (found.joint, found.row) == (KNEE, 40)
    assert (found.load, found.torque, found.limit) == pytest.approx((3.0 / 2.5, 3.0, 2.5))


@pytest.mark.parametrize(("begins", "ends", "joint"), [((0, 50), ROWS, ELBOW), ((0, 0), 50, KNEE)])
def test_rows_that_no_other_draft_could_change_do_not_count(begins: tuple[int, int], ends: int, joint: int) -> None:
    torque, speed = flat()
    torque[40, KNEE], torque[60, ELBOW] = 3.5, 3.0
    assert effort(JUDGED, torque, speed, begins, ends).joint == joint


def test_a_plan_without_rows_that_count_needs_nothing() -> None:
    torque, speed = flat()
    torque[:] = 3.5
    assert effort(JUDGED, torque, speed, (ROWS, ROWS), ROWS).load == 0.0
    assert effort(JUDGED, torque, speed, (0, 0), 0).load == 0.0


def test_settled_steps_are_carried_out_as_they_are() -> None:
    nothing = np.zeros(4)
    step = Step(side=0, lift=1010, land=1050, start=nothing, target=nothing, consumed_s=0.0)
    arms, legs = changeable([step], 1000, 125.0)
    assert arms == round(REACTION_S * 125)
    assert legs == 50 + round(SETTLING_S * 125)
    assert changeable([], 1000, 125.0) == (arms, arms)
