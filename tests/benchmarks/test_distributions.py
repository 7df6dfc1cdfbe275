"""What `model/distributions` measures, on motion whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.model.distributions import (
    EVENTS,
    LIMIT,
    PARTINGS,
    Compared,
    Held,
    held_part,
    is_in_pose,
    measured,
    parted,
    turning_part,
    verdicts,
)
from benchmarks.model.posture_figures import FIGURES, figures, in_pose, on_body, step_widths
from flexmotion.biomechanics.mirror import mirror
from flexmotion.human.body import Body, Segments
from flexmotion.human.kinematics import foot_points, forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import default_clip

from ..standing_human import standing

HAND_UP = {"rises": "right"}


def bent(motion: Motion, joint: str, degrees: float, first: int = 0, last: int | None = None) -> Motion:
    """The motion with a joint at an angle for some frames."""
    joints = motion.joints.copy()
    joints[first:last, JOINTS.index(joint)] = np.radians(degrees)
    return replace(motion, joints=joints)


def compared(kind: str, made: float, real: float, name: str = "trunk pitch", partings: int = PARTINGS) -> Compared:
    none = np.array([])
    counts, values = {name: partings}, {name: (none, none, none)}
    return Compared(kind, 20, {name: real}, {name: made}, counts, values, strips=(None, None))  # type: ignore[arg-type]


def test_elbows_and_wrists_are_told_apart_by_side(circling) -> None:
    found = figures(bent(circling(30), "elbow_flexion_r", 70.0))
    np.testing.assert_allclose(found["right elbow"], 70.0, atol=1.0)
    np.testing.assert_allclose(found["left elbow"], 0.0, atol=1.0)
    assert (found["right wrist"] > found["left wrist"] + 5.0).all()
    assert len(found["time in pose"]) == 0 and len(found["step width"]) == 0  # nothing asked, no step
    assert set(found) == set(FIGURES)


def test_the_mirror_image_swaps_sides_alone(circling) -> None:
    motion = bent(circling(30), "elbow_flexion_r", 70.0)
    one, other = figures(motion), figures(mirror(motion))
    np.testing.assert_allclose(one["right elbow"], other["left elbow"], atol=1e-9)
    np.testing.assert_allclose(one["trunk pitch"], other["trunk pitch"], atol=1e-9)


def test_a_kind_without_a_side_counts_both(circling) -> None:
    """One walker's right elbow was straight: nobody had asked for that, and the mean of both was called wrong."""
    motion = bent(circling(30), "elbow_flexion_r", 70.0)
    both = measured(Held(motion, None), "walk")
    np.testing.assert_allclose(np.sort(both["right elbow"]), np.sort(both["left elbow"]), atol=1e-9)
    sided = measured(Held(motion, None), "walk-turn-right")
    assert sided["right elbow"].min() > 60.0 > sided["left elbow"].max()


def test_a_trunk_that_bends_forward_has_a_positive_pitch(circling) -> None:
    upright, bowed = (figures(bent(circling(10), "lumbar_extension", angle)) for angle in (0.0, -30.0))
    np.testing.assert_allclose(bowed["trunk pitch"] - upright["trunk pitch"], 30.0, atol=2.0)


def test_a_turn_is_compared_while_it_turns() -> None:
    """Half of a clip of a turn is straight, and samples turn all the time: their arms swung as if they did it wrong."""
    yaw = np.concatenate([np.zeros(60), 0.7 / 30.0 * np.arange(60), np.full(60, 0.7 * 2.0)])
    turned = np.column_stack([np.cos(yaw / 2), np.zeros((180, 2)), np.sin(yaw / 2)])
    straight = standing(6.0)[:180]
    part = turning_part(replace(straight, root_quaternion=turned), 12)
    assert 12 + 60 <= len(part) <= 12 + 60 + 32
    assert not len(turning_part(straight, 12)), "it does not turn at all"


def test_people_in_the_place_of_samples_are_as_near_as_people() -> None:
    """Two partings told real from real: clips in the place of samples failed in 6 of 31 kinds, by chance in 3 to 10."""
    ratios = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        people = [{"trunk pitch": random.normal(random.normal(0.0, 4.0), 1.0, 50)} for _ in range(48)]
        found = parted(people[:24], dict(enumerate(people[24:])), 12, random)["trunk pitch"]
        ratios.append(found.made / found.real)
    assert np.mean(np.array(ratios) <= LIMIT) >= 0.85 and np.mean(ratios) < 1.15


def test_a_figure_is_judged_over_the_partings_that_have_enough_values() -> None:
    """The figure vanished where one of the forty partings had too few values, without a word."""
    random = np.random.default_rng(1)
    walks = [{"step width": random.normal(10.0, 1.0, 20 if number < 2 else 1)} for number in range(8)]
    found = parted(walks, dict(enumerate(walks)), 4, random)["step width"]
    assert 0 < found.partings < PARTINGS and found.real > 0.0
    assert min(map(len, found.values)) >= EVENTS
    stands = [{"step width": np.ones(1)} for _ in range(8)]
    assert not parted(stands, dict(enumerate(stands)), 4, random)
    (told,) = verdicts([compared("run", 1.0, 1.0, "step width", found.partings)])
    assert told.sentence.endswith(f"; too few values in the others: run ({found.partings} of {PARTINGS} partings)"), (
        told
    )


def test_a_pose_is_compared_while_it_is_held(circling) -> None:
    """A clip begins and ends with hanging arms; who is asked to raise a hand keeps it up."""
    clip = bent(circling(60), "shoulder_flexion_r", 170.0, 20, 45)
    pose = in_pose(clip, HAND_UP)
    assert pose is not None and pose.sum() == 25
    part = held_part(clip, HAND_UP)
    assert len(part.motion) == 25 and figures(part.motion, part.pose)["time in pose"] == pytest.approx([100.0])
    assert len(held_part(circling(60), HAND_UP).motion) == 60  # never in it: all of it counts
    assert len(held_part(clip, {}).motion) == 60


def test_a_clip_that_misses_its_pose_is_none_of_it(circling) -> None:
    """3 of 44 hands on the heart miss it on the model's body: samples, which never do, were further from clips."""
    clip = circling(60)
    assert not is_in_pose(clip, HAND_UP)
    assert is_in_pose(bent(clip, "shoulder_flexion_r", 170.0, 20, 45), HAND_UP)
    assert is_in_pose(clip, {})


def test_a_pose_that_is_left_in_between_is_less_time_in_it(circling) -> None:
    clip = bent(bent(circling(60), "shoulder_flexion_r", 170.0, 20, 45), "shoulder_flexion_r", 0.0, 30, 35)
    part = held_part(clip, HAND_UP)
    assert figures(part.motion, part.pose)["time in pose"] == pytest.approx([80.0])


def test_a_look_counts_from_before_it(circling) -> None:
    """Looks are angles from the first frame, and of the held part that is one of the look: 40 % were in the pose."""
    clip, look = bent(circling(60), "neck_extension", 30.0, 20, 50), {"looks": {"up": 15}}
    part = held_part(clip, look)
    assert len(part.motion) == 30 and figures(part.motion, part.pose)["time in pose"] == pytest.approx([100.0])


def test_another_body_goes_as_many_legs(circling) -> None:
    walk, child = circling(60, 1.0), Body(height=1.2, mass=25.0)
    own = on_body(walk, child)
    assert own.body == child and own.wrenches is None
    ratio = np.ptp(own.root_position[:, 0]) / np.ptp(walk.root_position[:, 0])
    assert ratio == pytest.approx(child.leg / walk.body.leg)


def test_another_body_stands_on_the_floor(circling) -> None:
    """Clips of a skeleton with other feet and shanks were compared while they stood 5 cm deep in the floor."""
    walk = circling(60, 1.0)
    tall = Segments.of_height(1.75)
    other = Body(height=1.75, mass=70.0, fitted=replace(tall, ankle_height=tall.ankle_height + 0.05, hip_width=0.2))
    lowest, own = (foot_points(each)[..., 2].min(axis=(1, 2)) for each in (walk, on_body(walk, other)))
    assert np.median(own) == pytest.approx(np.median(lowest) * other.leg / walk.body.leg, abs=1e-9)
    assert on_body(walk, walk.body).root_position is walk.root_position


def test_distances_that_nobody_sees_are_equal() -> None:
    """Clips that were made by one rule differ by a hundredth of a degree; a tenth is no failure."""
    assert compared("nod", made=0.4, real=0.01).ratio("trunk pitch") == 1.0
    assert compared("nod", made=3.0, real=1.5).ratio("trunk pitch") == 2.0


def test_every_kind_has_to_be_near() -> None:
    near, far = compared("walk", 1.2, 1.0), compared("run", 2.0 * LIMIT, 2.0 * 0.9)
    (one,) = verdicts([near])
    (both,) = verdicts([near, far])
    assert one.holds and not both.holds
    assert "1 of 2 kinds" in both.sentence and "worst run" in both.sentence


def test_samples_that_skate_more_than_their_clips_fail() -> None:
    stands, walks = (replace(compared(kind, 1.0, 1.0), jerks=(100.0, 80.0)) for kind in ("stand", "walk"))
    stands, walks = replace(stands, skates=(0.0, 0.01)), replace(walks, skates=(0.4, 0.5))
    _, skate, jerks = verdicts([stands, walks])
    assert not skate.holds and "0 of 1 kinds" in skate.sentence and "worst walk 1.25" in skate.sentence
    assert jerks.holds and "2 of 2 kinds" in jerks.sentence
    _, skate, jerks = verdicts([replace(walks, skates=(0.4, 0.44), jerks=(100.0, 160.0))])
    assert skate.holds and not jerks.holds


def test_a_pelvis_that_is_turned_makes_no_step_wider() -> None:
    """Steps of walks were 9 cm wider than they are: they were measured across a pelvis that turns with each step."""
    human = forward(default_clip())
    spin = Rotation.from_rotvec([0.0, 0.0, np.radians(9.0)]).as_matrix()
    turned = replace(human, pelvis_rotation=spin @ human.pelvis_rotation)
    own = step_widths(human, default_clip().fps)
    assert len(own) > 3
    np.testing.assert_array_equal(step_widths(turned, default_clip().fps), own)
    assert 0.03 < np.median(own) < 0.2
    # Who walks backward has the left foot to the right of its way: its steps were as wide, below zero.
    behind = replace(human, pelvis_rotation=np.diag([-1.0, -1.0, 1.0]) @ human.pelvis_rotation)
    np.testing.assert_allclose(step_widths(behind, default_clip().fps), -own)
