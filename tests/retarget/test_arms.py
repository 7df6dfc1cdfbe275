from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.retarget.arms import UpperBody


@pytest.fixture(scope="module")
def upper(op3: Robot) -> UpperBody:
    return UpperBody(op3)


def hands(upper: UpperBody, angles: np.ndarray) -> np.ndarray:
    """Hands in the torso frame for rows of `upper.joints`, (F, 2, 3)."""
    q = upper.robot.stand_pose.copy()
    found = []
    for row in angles:
        q[upper.joints] = row
        found.append(upper.hand_positions(q))
    return np.array(found)


def test_hands_follow_the_human_within_reach(upper: UpperBody, clip: Motion, op3: Robot) -> None:
    angles, targets = upper.solve(forward(clip), op3.stand_pose)
    error = np.linalg.norm(hands(upper, angles) - targets.hand, axis=2) / upper.lengths.sum(axis=1)
    assert np.median(error[targets.reachable]) < 0.08
    assert targets.reachable.any(axis=0).all()


def test_angles_stay_within_their_limits(upper: UpperBody, clip: Motion, op3: Robot) -> None:
    angles, _ = upper.solve(forward(clip), op3.stand_pose)
    assert (angles >= op3.lower[upper.joints]).all() and (angles <= op3.upper[upper.joints]).all()


def test_a_motion_that_is_cut_anywhere_gives_the_same_arms(upper: UpperBody, clip: Motion, op3: Robot) -> None:
    """Restarts at every fourth frame of a window, instead of the source, gave other arms for each window."""
    human = clip[100:160]
    whole, _ = upper.solve(forward(human), op3.stand_pose, first=100)
    for cut in (13, 22, 31):
        q = op3.stand_pose.copy()
        q[upper.joints] = whole[cut - 1]
        rest, _ = upper.solve(forward(human[cut:]), q, first=100 + cut)
        np.testing.assert_allclose(rest[8:], whole[cut + 8 :], atol=0.05)


def test_the_hand_on_the_side_of_the_humans_waves(upper: UpperBody, clip: Motion) -> None:
    targets = upper.targets(forward(clip))
    second = int(2.5 * clip.fps)
    assert targets.hand[second, 1, 2] > targets.hand[second, 0, 2] + 0.1
    assert targets.hand[second, 0, 1] > 0 > targets.hand[second, 1, 1]


def test_targets_are_relative_to_the_torso(upper: UpperBody, stand: Callable[..., Motion]) -> None:
    here, bent = stand(2, elbow_flexion_r=1.0), stand(2, elbow_flexion_r=1.0, lumbar_extension=-0.4)
    np.testing.assert_allclose(upper.targets(forward(here)).hand, upper.targets(forward(bent)).hand, atol=1e-9)


@pytest.mark.parametrize(("joint", "role"), [("neck_rotation", "pan"), ("neck_extension", "tilt")])
def test_the_head_turns_with_the_humans(
    upper: UpperBody, stand: Callable[..., Motion], op3: Robot, joint: str, role: str
) -> None:
    angles, _ = upper.solve(forward(stand(2, **{joint: 0.3})), op3.stand_pose)
    column = list(upper.joints).index(upper.head[role])
    straight, _ = upper.solve(forward(stand(2)), op3.stand_pose)
    turned = (angles - straight)[0, column]
    assert abs(turned) == pytest.approx(0.3, abs=0.02)


def test_the_arm_reaches_the_same_pose_from_any_start(
    upper: UpperBody, stand: Callable[..., Motion], op3: Robot
) -> None:
    """A start at the joint limits leads to the same position of the hand."""
    human = forward(stand(30, shoulder_flexion_r=1.2, elbow_flexion_r=1.0))
    far = op3.stand_pose.copy()
    far[upper.arms] = op3.lower[upper.arms]
    ends = [hands(upper, upper.solve(human, start)[0])[-1] for start in (op3.stand_pose, far)]
    np.testing.assert_allclose(ends[0], ends[1], atol=0.02)


def test_the_start_is_not_changed(upper: UpperBody, clip: Motion, op3: Robot) -> None:
    start = op3.stand_pose.copy()
    upper.solve(forward(clip[:5]), start)
    np.testing.assert_array_equal(start, op3.stand_pose)


def test_a_robot_without_hands_is_refused_by_name(op3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(op3, "config", op3.config.model_copy(update={"hands": None}))
    with pytest.raises(RetargetError, match=r"op3\.yaml: field hands is required"):
        UpperBody(op3)
