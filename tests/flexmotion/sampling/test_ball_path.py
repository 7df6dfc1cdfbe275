from __future__ import annotations

import numpy as np
import pytest

from flexmotion.features.joint_groups import BALL_COLUMNS, BALLS, ball_matrices
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.ball_path import settled_joints

FPS = 30.0
UP, HIPS, SIDE = (np.radians(angles) for angles in ([170.0, -5.0, 60.0], [-52.0, -59.0, 23.0], [5.0, -80.0, 10.0]))
"""Flexion, adduction and rotation of a shoulder: pointing up, with the hand on the hip, held out to the side [rad]."""


def path(side: str, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of an upper arm, (T, 3), and its angles, (T, 3) [rad], from rest in one pose to another."""
    ball = next(number for number, names in enumerate(BALLS) if names[0] == f"shoulder_flexion_{side}")
    columns = BALL_COLUMNS[ball]
    known, pose = np.zeros((4, len(JOINTS))), np.zeros(len(JOINTS))
    known[:, columns], pose[columns] = start, goal
    found = settled_joints(known, pose, columns.tolist(), 120, FPS, 0.3)
    return -ball_matrices(found, [ball])[:, 0, :, 2], found[:, columns]


@pytest.mark.parametrize("side", ["l", "r"])
@pytest.mark.parametrize(("start", "goal"), [(UP, HIPS), (HIPS, UP)])
def test_an_arm_goes_past_the_front_and_not_over_the_shoulder(side: str, start: np.ndarray, goal: np.ndarray) -> None:
    """From "point up" to "hands on your hips" it swung back over the head, and its angle stayed at 308° for -52°."""
    arm, angles = path(side, start, goal)
    assert not ((arm[:, 0] < -0.5) & (arm[:, 2] > 0.2)).any()
    np.testing.assert_allclose(angles[-1], goal, atol=0.02)
    turns = np.arccos(np.clip(np.sum(arm[1:] * arm[:-1], axis=1), -1.0, 1.0))
    assert turns.max() * FPS < 6.0


@pytest.mark.parametrize(("start", "goal"), [(UP, SIDE), (SIDE, HIPS), (SIDE, UP)])
def test_other_ways_are_the_shortest(start: np.ndarray, goal: np.ndarray) -> None:
    arm, _ = path("r", start, goal)
    turned = np.arccos(np.clip(np.sum(arm[1:] * arm[:-1], axis=1), -1.0, 1.0)).sum()
    assert turned < np.pi


@pytest.mark.parametrize(
    ("start", "goal"),
    [([78, -154, 45], [66, -149, 44]), ([51, -132, 89], [-4, -11, 7]), ([-122, 50, -67], [-128, 47, -66])],
)
def test_an_arm_near_its_goal_or_behind_the_shoulder_takes_the_shortest_way(start: list[int], goal: list[int]) -> None:
    """Twelve degrees became a turn of 348; an arm that began behind the shoulder took twice the way past the face."""
    arm, _ = path("l", np.radians(start), np.radians(goal))
    turned = np.arccos(np.clip(np.sum(arm[1:] * arm[:-1], axis=1), -1.0, 1.0)).sum()
    assert turned < 2.2
