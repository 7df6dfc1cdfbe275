from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.retarget.arm_cost import ArmTargets
from flexmotion.retarget.arms import UpperBody

from .arm_robots import with_arms

DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module")
def upper(op3: Robot) -> UpperBody:
    return UpperBody(op3)


def errors(upper: UpperBody, angles: np.ndarray, targets: ArmTargets) -> tuple[np.ndarray, np.ndarray]:
    """Direction errors of upper arms and forearms for rows of `upper.joints`, (F, 2) each [degrees]."""
    poses = upper.chain.poses(angles[:, : upper.arms.size].reshape(-1, *upper.arms.shape))
    return tuple(  # type: ignore[return-value]
        DEGREES * np.arccos(np.clip(np.sum(own * wanted, axis=-1), -1, 1))
        for own, wanted in ((poses.upper, targets.upper), (poses.fore, targets.fore))
    )


def standing(upper: UpperBody) -> np.ndarray:
    return upper.robot.stand_pose[upper.joints]


def streamed(
    upper: UpperBody,
    human: HumanKinematics,
    fps: float,
    cadence: int,
    horizon: int,
    start: np.ndarray | None = None,
) -> np.ndarray:
    """Angles as plans play them: windows of `horizon` frames, of each of which `cadence` frames are played.

    Args:
        start: angles before the first frame, the stand pose's where not given, (U,) [rad].
    """
    before, played = None, []
    start = standing(upper) if start is None else start
    for first in range(0, len(human), cadence):
        angles, _ = upper.solve(human[first : first + horizon], start, fps, before)
        played.append(angles[:cadence])
        if len(angles) > cadence:
            start, before = angles[cadence - 1], angles[cadence - 2 : cadence]
    return np.concatenate(played)


def test_arms_follow_the_humans_directions(upper: UpperBody, clip: Motion) -> None:
    angles, targets = upper.solve(forward(clip), standing(upper), clip.fps)
    arm, fore = errors(upper, angles, targets)
    assert arm.mean() < 15 and fore.mean() < 15


def test_angles_stay_within_their_limits(upper: UpperBody, clip: Motion, op3: Robot) -> None:
    angles, _ = upper.solve(forward(clip), standing(upper), clip.fps)
    assert (angles >= op3.lower[upper.joints]).all() and (angles <= op3.upper[upper.joints]).all()


def test_a_plan_continues_what_the_last_one_began(upper: UpperBody, clip: Motion) -> None:
    """Windows that overlap give the arms of the whole motion, also at their joins."""
    human = forward(clip)
    whole, _ = upper.solve(human, standing(upper), clip.fps)
    played = streamed(upper, human, clip.fps, cadence=8, horizon=31)
    assert np.median(np.abs(played - whole)) < 0.01
    steps = np.abs(np.diff(played[:, : upper.arms.size], axis=0)).max(axis=1)
    joins = np.arange(8, len(played) - 8, 8) - 1
    assert steps[joins].max() < 1.2 * steps.max()


def rocking(frames: int, cone: float) -> HumanKinematics:
    """A human whose straight right arm, nearly straight out to the side, rocks to and fro on a cone about that side.

    Args:
        cone: half the cone's angle [rad].
    """
    turn = 1.2 * np.sin(np.pi * np.arange(frames) / 30.0)
    one = np.ones(frames)
    arm = np.stack([np.sin(cone) * np.sin(turn), -np.cos(cone) * one, -np.sin(cone) * np.cos(turn)], axis=1)
    return with_right_arm(arm, arm)


def folding(frames: int) -> HumanKinematics:
    """A human whose right hand goes from hanging to before the chest, and up to the chin, and stays there.

    The directions are those of a bow that a model sampled ("take a bow", seed 7), ten times a second.
    """
    at = np.minimum(np.arange(frames) / 3.0, 10.0)
    upper = [[0.1, -0.2, -1.0], [0.0, -0.2, -0.9], [0.0, -0.5, -0.9], [0.2, -0.55, -0.8], [0.4, -0.5, -0.8]]
    upper += [[0.45, -0.5, -0.75], [0.5, -0.6, -0.7], [0.4, -0.6, -0.7], [0.4, -0.6, -0.7], [0.4, -0.6, -0.6]]
    fore = [[0.4, -0.1, -0.9], [0.7, 0.1, -0.7], [0.8, 0.5, -0.3], [0.4, 0.85, 0.1], [-0.2, 0.8, 0.5]]
    fore += [[-0.45, 0.55, 0.7], [-0.5, 0.5, 0.7], [-0.45, 0.65, 0.65], [-0.3, 0.8, 0.5], [-0.25, 0.9, 0.4]]

    def followed(directions: list[list[float]]) -> np.ndarray:
        known = np.array(directions)
        moved = np.stack([np.interp(at, np.arange(len(known)), column) for column in known.T], axis=1)
        return moved / np.linalg.norm(moved, axis=1, keepdims=True)

    return with_right_arm(followed(upper), followed(fore))


def with_right_arm(upper: np.ndarray, fore: np.ndarray) -> HumanKinematics:
    """A human with these directions of the right upper arm and forearm, (F, 3); the left arm hangs."""
    frames = len(upper)
    still = np.zeros((frames, 2, 3))
    rotation = np.broadcast_to(np.eye(3), (frames, 3, 3))
    elbow, hand = still.copy(), still.copy()
    elbow[:, 0, 2], hand[:, 0, 2] = -0.3, -0.6
    elbow[:, 1], hand[:, 1] = 0.3 * upper, 0.3 * (upper + fore)
    sided = dict.fromkeys(("hip", "knee", "ankle", "heel", "toe", "wrist"), still)
    return HumanKinematics(
        com=still[:, 0],
        pelvis_position=still[:, 0],
        pelvis_rotation=rotation,
        torso_rotation=rotation,
        head_rotation=rotation,
        foot_rotation=np.broadcast_to(np.eye(3), (frames, 2, 3, 3)),
        hand_rotation=np.broadcast_to(np.eye(3), (frames, 2, 3, 3)),
        vertex=still[:, 0],
        shoulder=still,
        elbow=elbow,
        hand=hand,
        **sided,
    )


def test_an_arm_near_its_singular_pose_does_not_swing_around(upper: UpperBody) -> None:
    """Straight out to the side, shoulder pitch has no effect: followed frame by frame the joint spun."""
    human = rocking(90, cone=0.3)
    angles = streamed(upper, human, 30.0, cadence=8, horizon=31)
    arm, fore = errors(upper, angles, ArmTargets.of(human, upper.chain))
    assert max(arm.max(), fore.max()) < 20
    assert np.abs(np.diff(angles[:, : upper.arms.size], axis=0)).max() * 30.0 < 6.0


def test_the_hand_on_the_side_of_the_humans_waves(upper: UpperBody, clip: Motion) -> None:
    angles, _ = upper.solve(forward(clip), standing(upper), clip.fps)
    second = int(2.5 * clip.fps)
    hand = upper.chain.poses(angles[second, : upper.arms.size].reshape(upper.arms.shape)).hand
    assert hand[1, 2] > hand[0, 2] + 0.1
    assert hand[0, 1] > 0 > hand[1, 1]


def test_targets_are_relative_to_the_torso(upper: UpperBody, stand: Callable[..., Motion]) -> None:
    here, bent = stand(2, elbow_flexion_r=1.0), stand(2, elbow_flexion_r=1.0, lumbar_extension=-0.4)
    own, other = (ArmTargets.of(forward(motion), upper.chain) for motion in (here, bent))
    np.testing.assert_allclose(own.fore, other.fore, atol=1e-9)


def test_only_a_raised_hand_has_weight(upper: UpperBody, stand: Callable[..., Motion]) -> None:
    hanging, raised = stand(2), stand(2, shoulder_flexion_r=1.7)
    assert ArmTargets.of(forward(hanging), upper.chain).hand_weight.max() == 0.0
    left, right = ArmTargets.of(forward(raised), upper.chain).hand_weight[0]
    assert left == 0.0 and right > 0.9


@pytest.mark.parametrize(("joint", "role"), [("neck_rotation", "pan"), ("neck_extension", "tilt")])
def test_the_head_turns_with_the_humans(upper: UpperBody, stand: Callable[..., Motion], joint: str, role: str) -> None:
    angles, _ = upper.solve(forward(stand(2, **{joint: 0.3})), standing(upper), 30.0)
    column = list(upper.joints).index(upper.head[role])
    straight, _ = upper.solve(forward(stand(2)), standing(upper), 30.0)
    assert abs((angles - straight)[0, column]) == pytest.approx(0.3, abs=0.02)


def test_a_configuration_is_left_only_where_another_is_much_better(
    upper: UpperBody, stand: Callable[..., Motion]
) -> None:
    """Half a turn of shoulder pitch with the roll negated: the arm stays so unless it must stay far from the human."""
    human = forward(stand(30, shoulder_flexion_r=1.2, shoulder_flexion_l=1.2))
    near, targets = upper.solve(human, standing(upper), 30.0)
    other = near[0].copy()
    pitch, roll = [0, upper.arms.shape[1]], [1, upper.arms.shape[1] + 1]
    other[pitch] -= np.pi * np.sign(other[pitch])
    other[roll] *= -1
    kept, _ = upper.solve(human, other, 30.0)
    assert np.abs(kept[:, pitch] - other[pitch]).max() < 0.5
    assert max(error.max() for error in errors(upper, kept, targets)) < 25
    bent = standing(upper)
    bent[pitch] = 2.5 * np.sign(near[0, pitch])
    bent[roll] = 0.0
    found, _ = upper.solve(human, bent, 30.0)
    assert max(error[-1].max() for error in errors(upper, found, targets)) < 15


def test_an_arm_that_has_wound_up_comes_back(upper: UpperBody, stand: Callable[..., Motion]) -> None:
    """After a bow a right arm stayed half a turn around, pitch at its limit, while the human's hung."""
    wound = standing(upper)
    pitch, roll = upper.arms.shape[1], upper.arms.shape[1] + 1
    wound[pitch], wound[roll] = upper.chain.lower[1, 0], -wound[roll]
    angles = streamed(upper, forward(stand(90)), 30.0, cadence=8, horizon=31, start=wound)
    assert np.abs(angles[-1] - standing(upper))[[pitch, roll]].max() < 0.5


def test_folding_an_arm_does_not_wind_it_up(upper: UpperBody) -> None:
    """A right arm went half a turn around on the way to the chest.

    Poses with the elbow bent backward had crowded out the candidates of the configuration that it was in.
    """
    angles = streamed(upper, folding(60), 30.0, cadence=8, horizon=31)
    pitch, roll = upper.arms.shape[1], upper.arms.shape[1] + 1
    assert angles[:, pitch].min() > -0.5 * np.pi
    assert angles[:, roll].max() < 0.0


def test_arguments_are_not_changed(upper: UpperBody, clip: Motion) -> None:
    start, before = standing(upper), np.tile(standing(upper), (2, 1))
    upper.solve(forward(clip[:5]), start, clip.fps, before)
    np.testing.assert_array_equal(start, standing(upper))
    np.testing.assert_array_equal(before[0], before[1])


@pytest.mark.parametrize(("joints", "limit"), [(1, 80), (2, 25), (4, 8), (6, 8)])
def test_arms_of_any_number_of_joints_follow(tmp_path: Path, clip: Motion, joints: int, limit: float) -> None:
    """An upper arm that turns about itself has every direction of both segments; without elbow the hand's remains."""
    upper = UpperBody(load_robot(with_arms(tmp_path, joints)))
    angles, targets = upper.solve(forward(clip), standing(upper), clip.fps)
    arm, fore = errors(upper, angles, targets)
    assert max(arm.mean(), fore.mean()) < limit
    assert np.abs(np.diff(angles, axis=0)).max() * clip.fps < 12
