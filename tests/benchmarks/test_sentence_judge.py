"""How sentences at the robot are judged: gestures as often as they are seen, looks by where the head looks."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.shared.gaze import LOOKS, gaze_faults, true_gaze
from benchmarks.shared.sentence_judge import Seen
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import TickRow, blank

RATE = 25.0
SHOULDER = 2.7
"""Turn of the right shoulder that raises a hanging arm overhead [rad]."""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


def seen(robot: Robot, joint: str, shares: list[float], reach: float) -> Seen:
    """A robot that stands and moves one joint from its stand pose through shares of a reach, .5 s each."""
    moved = np.interp(np.arange(0.0, 0.5 * (len(shares) - 1), 1.0 / RATE), 0.5 * np.arange(len(shares)), shares)
    rows = blank(TickRow.dtype(joints=robot.n), len(moved))
    rows["true_q"] = robot.stand_pose
    rows["true_q"][:, robot.joint_names.index(joint)] += reach * moved
    rows["true_base"] = [0, 0, 0.26, 1, 0, 0, 0]
    record = RunTrace(RATE, robot.joint_names)
    record._rows, record._used = rows, len(rows)
    return Seen(robot, record, 0, len(rows))


def test_dips_of_a_raised_hand_are_not_waves(robot: Robot) -> None:
    """The planner and the eye saw two waves, and the judge three: it counted peaks of a joint's angle."""
    twice = [0, 1, 1, 0.7, 1, 1, 0, 0, 1, 0.6, 1, 0, 0]
    waves = seen(robot, "r_sho_pitch", twice, SHOULDER)
    assert waves.faults("wave-right-hand", "2 times") == []
    assert waves.faults("wave-right-hand", "3 times") == ["2 of 3 times"]
    assert waves.faults("wave-left-hand", "2 times") == ["0 of 2 times"]


def test_a_hand_that_stays_up_has_not_waved(robot: Robot) -> None:
    held = seen(robot, "r_sho_pitch", [0, 1, 1, 1, 1], SHOULDER)
    assert held.faults("wave-right-hand", "1 times") == ["did not come back"]
    assert held.faults("raise-up-right-hand", None) == []
    assert seen(robot, "r_sho_pitch", [0, 0, 0], SHOULDER).faults("wave-right-hand", None) == ["nothing of it was seen"]


def test_a_look_is_judged_by_where_the_head_looks(robot: Robot) -> None:
    """A look to the left was wrong because of the word it was heard as; where the head looked was not seen."""
    left = seen(robot, "head_pan", [0, 1, 1, 0], np.radians(40.0))
    assert left.faults("look-left", None) == []
    assert left.faults("look-right", None) != [] and left.faults("look-up", None) != []
    assert left.faults("head", None) == []
    little = seen(robot, "head_pan", [0, 1, 1, 0], np.radians(20.0))
    assert little.faults("look-left", None) == ["looked 20° left at most, 25° held is a look"]
    assert little.faults("head", None) == ["looked nowhere"]


def test_a_glance_that_is_not_held_is_no_look() -> None:
    assert LOOKS["look-left"] == {"turn": 25} and LOOKS["look-down"] == {"up": -15}
    glance = np.zeros((50, 2))
    glance[20:25, 0] = 60.0
    assert gaze_faults(glance, "look-left", RATE) != []
    glance[20:40, 0] = 60.0
    assert gaze_faults(glance, "look-left", RATE) == []


def test_a_body_that_turns_does_not_turn_the_head(robot: Robot) -> None:
    turns = np.zeros((3, 7))
    turns[:, 3], turns[:, 6] = np.cos([0.0, 0.4, 0.8]), np.sin([0.0, 0.4, 0.8])
    gaze = true_gaze(robot, turns, np.tile(robot.stand_pose, (3, 1)))
    np.testing.assert_allclose(gaze, gaze[:1].repeat(3, axis=0), atol=1e-6)
