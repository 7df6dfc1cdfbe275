"""A gesture is measured by what is seen of it: hands, head, trunk, legs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.retarget.arms import UpperBody
from flexmotion.streamer.planning.gesture_way import GestureWay

Float = NDArray[np.float64]
LEVEL = np.zeros(2)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


@pytest.fixture(scope="module")
def measure(robot: Robot) -> GestureWay:
    return GestureWay(robot, UpperBody(robot))


def posed(robot: Robot, **angles: float) -> Float:
    q = robot.stand_pose.copy()
    for name, angle in angles.items():
        q[robot.joint_names.index(name)] = angle
    return q


def test_an_arm_that_hangs_from_a_shoulder_turned_over_is_not_raised(robot: Robot, measure: GestureWay) -> None:
    """After a bow the shoulders stood at 2.8 rad and the hands hung; the planner waited for them to come down."""
    stand = posed(robot)
    chain = UpperBody(robot).chain
    raised = posed(robot, r_sho_pitch=stand[robot.joint_names.index("r_sho_pitch")] + 2.4)
    assert measure("wave-right-hand", raised, LEVEL, stand) > 3.0
    # Of all configurations whose hand is where it hangs, one with the shoulder turned over.
    pitch, roll, elbow = np.meshgrid(np.linspace(2.2, 2.9, 15), np.linspace(-1.5, 1.5, 61), np.linspace(-1.5, 1.5, 31))
    names = [robot.joint_names.index(f"r_{joint}") for joint in ("sho_pitch", "sho_roll", "el")]
    q = np.tile(stand, (pitch.size, 1))
    q[:, names] = np.column_stack([pitch.ravel(), roll.ravel(), elbow.ravel()])
    hands = chain.poses(q[:, chain.joints]).hand[:, 1]
    nearest = int(np.linalg.norm(hands - chain.poses(stand[chain.joints]).hand[1], axis=1).argmin())
    assert abs(q[nearest] - stand).max() > 2.0
    assert measure("wave-right-hand", q[nearest], LEVEL, stand) < 1.0


def test_the_hand_of_the_named_side_is_looked_at(robot: Robot, measure: GestureWay) -> None:
    stand = posed(robot)
    left = posed(robot, l_sho_pitch=stand[robot.joint_names.index("l_sho_pitch")] - 2.0)
    assert measure("wave-left-hand", left, LEVEL, stand) > 3.0
    assert measure("wave-right-hand", left, LEVEL, stand) == 0.0
    assert measure("wave-both-hands", left, LEVEL, stand) > 3.0


def test_a_bow_is_seen_at_the_trunk_alone(robot: Robot, measure: GestureWay) -> None:
    """A head that stayed down and legs that stood more bent hid that the trunk had come up: the model bowed on."""
    stand = posed(robot)
    other = posed(robot, head_tilt=0.6, l_knee=1.5, r_sho_pitch=1.0)
    assert measure("bow", other, LEVEL, stand) == 0.0
    assert measure("bow", stand, np.array([0.0, np.radians(30.0)]), stand) == pytest.approx(1.2)
    # A lean of 18° before the bow was taken for it, and the bow never came.
    assert measure("bow", stand, np.array([0.0, np.radians(18.0)]), stand) < 1.0


def test_legs_count_from_where_they_began_and_heads_from_the_stand(robot: Robot, measure: GestureWay) -> None:
    stand, bent = posed(robot), posed(robot, l_knee=1.5)
    assert measure("kick", bent, LEVEL, stand) > 1.0 > measure("kick", bent, LEVEL, bent)
    turned = posed(robot, head_pan=stand[robot.joint_names.index("head_pan")] + np.radians(20.0))
    assert measure("look-left", turned, LEVEL, turned) == pytest.approx(2.0)


def test_many_rows_are_measured_as_one_by_one(robot: Robot, measure: GestureWay) -> None:
    rng = np.random.default_rng(1)
    q, tilt = rng.uniform(-1.0, 1.0, (5, robot.n)), rng.uniform(-0.5, 0.5, (5, 2))
    for kind in ("wave-right-hand", "bow", "squat", "unheard of"):
        each = [float(measure(kind, one, lean, q[0])) for one, lean in zip(q, tilt, strict=True)]
        np.testing.assert_allclose(measure(kind, q, tilt, q[0]), each)
