"""The pose in which a gesture is held that was made by a recipe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.repertoire import offered_kinds
from flexmotion.features.joint_groups import ball_matrices
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.at_rest import UPPER
from flexmotion.sampling.kept_pose import KeptPose
from flexmotion.sampling.made_gestures import made_gestures
from flexmotion.sampling.made_pose import made_pose
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.text.phrases import is_brief, is_pose, wordings

NECK = JOINTS.index("neck_rotation")


def pose_of(kind: str, base: np.ndarray, seed: int = 0) -> KeptPose | None:
    return made_pose(kind, Body(), base, np.zeros(len(JOINTS)), seed)


def test_every_pose_that_was_made_and_leaves_the_legs_alone_has_one() -> None:
    rest = np.zeros(len(JOINTS))
    poses = {kind for kind in made_gestures() if is_pose(kind) and pose_of(kind, rest) is not None}
    assert {"salute-left-hand", "look-up", "hands-on-hips", "point-right"} <= poses
    assert "crouch" not in poses, "its legs are the model's"
    assert not any(is_brief(kind) for kind in poses)
    assert pose_of("wave-right-hand", rest) is None


def test_it_is_drawn_anew_and_the_same_of_one_seed() -> None:
    rest = np.zeros(len(JOINTS))
    first, same, other = (pose_of("look-right", rest, seed) for seed in (1, 1, 2))
    assert first is not None and same is not None and other is not None
    assert np.array_equal(first.joints, same.joints) and first.joints[NECK] != other.joints[NECK]
    assert first.frame < 0 and set(first.columns) <= UPPER


def test_a_look_does_not_begin_from_the_look_before_it() -> None:
    """Right after left, the head would turn by both angles."""
    turned = np.zeros(len(JOINTS))
    turned[NECK] = 1.0
    one, other = pose_of("look-left", np.zeros(len(JOINTS))), pose_of("look-left", turned)
    assert one is not None and other is not None and one.joints[NECK] == other.joints[NECK]


def test_trunks_do_not_turn_further_with_every_gesture() -> None:
    """Looks down and hands that were held out by turns bent the trunk by 28 degrees: each went on from the last."""
    lumbar, joints = JOINTS.index("lumbar_extension"), np.zeros(len(JOINTS))
    for number in range(20):
        pose = pose_of("look-down" if number % 2 else "hold-out-right-hand", joints, number)
        assert pose is not None
        joints = pose.joints
        assert abs(joints[lumbar]) < np.radians(20.0)


def test_an_arm_that_has_turned_all_round_goes_on_where_it_is(make_standing: Callable[..., Motion]) -> None:
    pose = pose_of("salute-right-hand", np.zeros(len(JOINTS)))
    assert pose is not None
    before, columns = (
        make_standing(4),
        [JOINTS.index(f"{name}_r") for name in ("shoulder_rotation", "forearm_pronation")],
    )
    joints = before.joints.copy()
    joints[:, columns] = pose.joints[columns] - 2 * np.pi
    kept = pose.later(60).kept(make_standing(90), replace(before, joints=joints)).joints
    assert np.abs(np.diff(np.concatenate([joints[-1:], kept]), axis=0)).max() < 0.3
    assert ball_matrices(kept[-1]) == pytest.approx(ball_matrices(pose.joints), abs=1e-2)
    assert kept[-1, columns[1]] == pytest.approx(pose.joints[columns[1]] - 2 * np.pi, abs=1e-3)


@pytest.mark.parametrize("text", ["look up", "beckon with the left hand", "stand still", "hands on hips"])
def test_arms_that_were_held_out_move_as_fast_as_people_do(text: str, bundle: Path) -> None:
    """Beside an arm held out to the side both solutions of its angles are near: wrists moved by .9 m in one frame."""
    sampler = Sampler(Bundle(bundle), balanced=False)
    for seed, first in ((10, "spread your arms out to the sides"), (0, "point up with the right hand")):
        source = ModelSource(sampler, [Item(0.0, Text(first)), Item(1.7, Text(text))], "model:shipped", seed)
        motion = source.window(0, 150)
        assert motion is not None
        wrist = forward(motion).wrist - motion.root_position[:, None]
        assert np.linalg.norm(np.diff(wrist, axis=0), axis=-1).max() * 30.0 < 7.0


@pytest.mark.parametrize("kind", ["salute-left-hand", "hands-on-hips", "look-behind-right", "point-up-right-hand"])
def test_the_shipped_model_reaches_it_and_stays(kind: str, bundle: Path) -> None:
    """One of eight samples of pointing up dropped the arm again; hands were 5 cm away from those of clips."""
    sampler = Sampler(Bundle(bundle))
    assert kind in offered_kinds(sampler.bundle)
    source = ModelSource(sampler, [Item(0.0, Text(wordings(kind)[0]))], "model:shipped")
    motion = source.window(0, 240)
    assert motion is not None
    pose = sampler.made_pose(sampler.meant(source.condition(Text(wordings(kind)[0]))), sampler.standing(), 0)
    assert pose is not None
    columns = list(pose.columns)
    assert np.abs(motion.joints[90:, columns] - pose.joints[columns]).max() < np.radians(3.0)
    assert np.abs(np.diff(motion.joints[90:], axis=0)).max() < np.radians(0.2)


def test_a_pose_that_is_done_a_number_of_times_comes_down_in_between(bundle: Path) -> None:
    """A hand that was to be raised twice stayed up for ten seconds."""
    sampler = Sampler(Bundle(bundle))
    source = ModelSource(sampler, [Item(0.0, Text("salute with the right hand three times"))], "model:shipped")
    motion = source.window(0, 360)
    assert motion is not None
    up = (forward(motion).wrist[:, 1, 2] > 1.3).astype(int)
    assert (np.diff(up) == 1).sum() == 3 and (np.diff(up) == -1).sum() >= 2
