from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.importers.frame import Frame, Skeleton
from flexmotion.importers.live_person import GAP_S, MEASURE_S, RENEW_S, LivePerson
from flexmotion.importers.mapping import find_mapping
from flexmotion.importers.one_euro import OneEuro
from flexmotion.streamer.commands.choice import choose_motion

SIDED = ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist")
NAMES = ("neck", "head", *(f"{side}_{name}" for name in SIDED for side in ("left", "right")))
SKELETON = Skeleton("test", NAMES, up="z", units="m")
FPS = 60.0


@pytest.fixture(scope="module")
def clip():
    motion = choose_motion()
    return motion[: round(4.0 * motion.fps)]


@pytest.fixture(scope="module")
def frames(clip):
    """The clip's joints at 60 frames a second."""
    human = forward(clip)
    fields = [human.shoulder.mean(axis=1)[:, None], human.vertex[:, None], *(getattr(human, name) for name in SIDED)]
    points = np.concatenate(fields, axis=1)
    times = np.arange(0.0, (len(clip) - 1) / clip.fps, 1.0 / FPS)
    before = (times * clip.fps).astype(int)
    share = (times * clip.fps - before)[:, None, None]
    return (1.0 - share) * points[before] + share * points[before + 1]


def played(person, frames, begin_s=0.0, skeleton=SKELETON):
    """Poses of frames that come at 60 a second."""
    return [
        pose
        for number, positions in enumerate(frames)
        for pose in person.take(Frame(skeleton, positions), begin_s + number / FPS)
    ]


def at(positions, name):
    return positions[..., NAMES.index(name), :]


def test_poses_are_those_of_the_clip(clip, frames):
    poses = played(LivePerson(), frames)
    times = np.array([pose.time_s for pose in poses])
    np.testing.assert_allclose(np.diff(times), 1.0 / 30.0)
    assert MEASURE_S <= times[0] <= MEASURE_S + 0.1
    assert {pose.stream for pose in poses} == {1}
    motion = concatenate([pose.motion for pose in poses])
    assert motion.body.segments.leg == pytest.approx(clip.body.segments.leg, abs=0.01)
    human, true = forward(motion), frames[np.round(times * FPS).astype(int)]
    for name in ("wrist", "ankle"):
        for side, word in enumerate(("left", "right")):
            found = getattr(human, name)[:, side] - human.pelvis_position
            hips = 0.5 * (at(true, "left_hip") + at(true, "right_hip"))
            assert np.linalg.norm(found - at(true, f"{word}_{name}") + hips, axis=-1).mean() < 0.03
    assert np.minimum(human.heel[..., 2], human.toe[..., 2]).min() > -0.03  # on the floor


@pytest.mark.parametrize("rate", [20.0, 60.0, 120.0])
def test_any_rate_gives_the_same_number_of_poses(frames, rate):
    person, poses = LivePerson(), []
    for number in range(int(3.0 * rate)):
        positions = frames[min(int(number / rate * FPS), len(frames) - 1)]
        poses += person.take(Frame(SKELETON, positions), 0.01 + number / rate)
    assert len(poses) == pytest.approx((3.0 - MEASURE_S) * 30.0, abs=3)


def test_late_frames_and_floods_are_left_out(frames):
    person = LivePerson()
    played(person, frames[:30])
    assert person.take(Frame(SKELETON, frames[20]), 20 / FPS) == []
    assert person.take(Frame(SKELETON, frames[29]), 29 / FPS + 0.001) == []
    assert person.refused["late"] == 1 and person.refused["too fast"] == 1


@pytest.mark.parametrize(
    ("reason", "change"),
    [
        ("a leg is not seen", lambda p: np.where(np.arange(len(p))[:, None] == NAMES.index("left_knee"), np.nan, p)),
        ("no human", lambda p: 0.1 * p),
        ("no human", lambda p: np.full_like(p, 1e300)),
        ("another body", lambda p: 1.4 * p),
        ("not upright", lambda p: p * [1.0, 1.0, -1.0]),
        ("not upright", lambda p: p[:, [2, 1, 0]]),
        ("sides exchanged", lambda p: p[[0, 1, *np.arange(2, len(p)).reshape(-1, 2)[:, ::-1].ravel()]]),
        ("a jump", lambda p: p + [3.0, 0.0, 0.0]),
        ("a jump", lambda p: p + 1.0 * (np.arange(len(p))[:, None] == NAMES.index("right_wrist"))),
    ],
)
def test_a_frame_that_cannot_be_the_person_is_refused(frames, reason, change):
    person = LivePerson()
    with np.errstate(over="ignore", invalid="ignore"):
        before = played(person, frames[:90])
        assert person.take(Frame(SKELETON, change(frames[90])), 90 / FPS) == []
    assert person.refused[reason] == 1 and sum(person.refused.values()) == 1
    after = played(person, frames[91:120], 91 / FPS)
    # The poses go on, over the frame that is missing.
    assert after[0].stream == before[-1].stream
    assert after[0].time_s - before[-1].time_s == pytest.approx(1.0 / 30.0)


@pytest.mark.parametrize("turned", [[1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]])
def test_a_person_upside_down_is_never_followed(frames, turned):
    """A camera that was mounted upside down made the robot fall: its person was followed, head below the feet."""
    person = LivePerson()
    assert played(person, frames * turned) == [] and not person.measured
    assert person.refused["not upright"] == len(frames)


@pytest.mark.parametrize("up", ["x", "y"])
def test_joints_with_another_axis_up_than_said_are_never_followed(frames, up):
    """Joints with z up that were sent without `up` were followed, and tilted the robot."""
    order = {"x": [2, 1, 0], "y": [0, 2, 1]}[up]
    person = LivePerson()
    assert played(person, frames[..., order]) == [] and not person.measured


def test_a_person_who_crouches_and_bows_is_followed(frames):
    person, down = LivePerson(), frames[:150].copy()
    played(person, down[:90])
    trunk = [NAMES.index(name) for name in ("neck", "head", "left_shoulder", "right_shoulder")]
    for number, positions in enumerate(down[90:], 1):
        hips = 0.5 * (at(positions, "left_hip") + at(positions, "right_hip"))
        sunk = min(0.005 * number, 0.25)
        for row in trunk:
            positions[row, 2] -= 2 * sunk * (positions[row, 2] - hips[2])
            positions[row, 0] += sunk
    assert len(played(person, down[90:], 90 / FPS)) >= 25
    assert person.refused["not upright"] == 0


def test_after_a_gap_a_new_stream_begins_with_the_same_body(frames):
    person = LivePerson()
    first = played(person, frames[:100])
    again = played(person, frames[:30], 100 / FPS + GAP_S + 0.2)
    assert (first[-1].stream, again[0].stream) == (1, 2)
    assert again[0].motion.body == first[0].motion.body


def test_another_person_who_stays_is_measured(frames):
    person = LivePerson()
    played(person, frames[:100])
    taller = played(person, 1.4 * frames[:200], 100 / FPS)
    assert taller[0].time_s > 100 / FPS + RENEW_S
    assert taller[0].motion.body.segments.leg == pytest.approx(1.4 * 0.85, rel=0.1)
    assert taller[0].stream == 2


def test_another_skeleton_takes_over_only_when_it_stays(frames):
    person, other = LivePerson(), replace(SKELETON, protocol="other")
    played(person, frames[:100])
    assert played(person, frames[100:102], 100 / FPS, other) == []
    assert played(person, frames[102:110], 102 / FPS)
    assert played(person, frames[:200], 110 / FPS, other)


def test_a_skeleton_that_is_none_says_what_it_lacks(frames):
    person = LivePerson()
    assert person.take(Frame(Skeleton("test", ("a", "b")), np.zeros((2, 3))), 0.0) == []
    assert "no legs found" in (person.trouble or "")
    assert person.refused["no human"] == 1


def test_an_arm_out_of_the_picture_stays_where_it_was(frames):
    person, hidden = LivePerson(), frames.copy()
    hidden[90:, NAMES.index("left_wrist")] = np.nan
    poses = played(person, hidden[:110])
    assert not sum(person.refused.values())
    human = forward(concatenate([pose.motion for pose in poses[-6:]]))
    gone = human.wrist[:, 0] - human.pelvis_position
    assert np.linalg.norm(gone - gone[0], axis=-1).max() < 0.05


def test_who_comes_back_with_an_arm_out_of_the_picture_is_followed(frames):
    # After a gap nothing was known of an arm that was not seen: no pose was made for as long as it stayed so.
    person = LivePerson()
    played(person, frames[:90])
    lost = frames[90:150].copy()
    at(lost, "left_wrist")[:] = np.nan
    back = played(person, lost, 90 / FPS + 2.0 * GAP_S)
    assert len(back) >= 25 and sum(person.refused.values()) == 0
    human = forward(concatenate([pose.motion for pose in back]))
    hips = 0.5 * (at(frames, "left_hip") + at(frames, "right_hip"))
    was = at(frames, "left_wrist")[89] - hips[89]
    assert np.linalg.norm(human.wrist[:, 0] - human.pelvis_position - was, axis=-1).max() < 0.15


@pytest.mark.parametrize(
    "hidden",
    [["left_wrist"], ["left_shoulder", "left_elbow", "left_wrist"], ["head"], ["neck", "head"]],
    ids=lambda names: names[0],
)
def test_who_was_never_seen_as_a_whole_is_followed_as_far_as_seen(frames, hidden):
    """Of a person with one arm out of the picture no pose was made, however long it lasted, and nothing told why."""
    person, seen = LivePerson(), frames.copy()
    seen[:, [NAMES.index(name) for name in hidden]] = np.nan
    poses = played(person, seen)
    assert len(poses) >= 80 and sum(person.refused.values()) == 0
    assert sorted(person.unseen) == sorted(hidden)
    motion = concatenate([pose.motion for pose in poses])
    assert np.isfinite(motion.joints).all()
    human, true = forward(motion), frames[np.round([pose.time_s * FPS for pose in poses]).astype(int)]
    found = human.wrist[:, 1] - human.pelvis_position
    hips = 0.5 * (at(true, "left_hip") + at(true, "right_hip"))
    assert np.linalg.norm(found - at(true, "right_wrist") + hips, axis=-1).mean() < 0.1
    if "left_wrist" in hidden:
        assert (human.shoulder[:, 0, 2] - human.wrist[:, 0, 2]).min() > 0.35  # it hangs


def test_an_arm_that_is_first_seen_later_is_measured_and_followed_then(frames):
    person, late = LivePerson(), frames.copy()
    late[:100, NAMES.index("left_wrist")] = np.nan
    poses = played(person, late)
    assert [pose.stream for pose in poses] == sorted(pose.stream for pose in poses)
    first, second = ([pose for pose in poses if pose.stream == number] for number in (1, 2))
    assert first[-1].time_s < 100 / FPS + 0.1 and second[0].time_s == pytest.approx(100 / FPS + MEASURE_S, abs=0.1)
    assert not person.unseen and sum(person.refused.values()) == 0
    whole = {pose.time_s: pose.motion for pose in played(LivePerson(), frames)}
    human, true = (
        forward(concatenate(motions))
        for motions in ([pose.motion for pose in second], [whole[pose.time_s] for pose in second])
    )
    gone = human.wrist - human.pelvis_position[:, None] - true.wrist + true.pelvis_position[:, None]
    assert np.linalg.norm(gone, axis=-1).max() < 0.05


def test_a_point_between_two_joints_is_where_their_middle_is(frames, tmp_path):
    # The ears of MediaPipe's landmarks stand for the head.
    names = (*(name for name in NAMES if name != "head"), "left_ear", "right_ear")
    aside = np.array([0.0, 0.08, 0.0])
    head = at(frames, "head")[:, None]
    split = np.concatenate([np.delete(frames, NAMES.index("head"), axis=1), head + aside, head - aside], axis=1)
    skeleton = replace(SKELETON, names=names)
    joints = {**find_mapping(NAMES, "test").joints, "head": "left_ear + right_ear"}
    mapping = tmp_path / "ears.yaml"
    mapping.write_text(json.dumps({"name": "ears", "joints": joints}))
    whole, halves = (
        played(LivePerson(), frames[:120]),
        played(LivePerson(mapping=str(mapping)), split[:120], 0.0, skeleton),
    )
    assert len(whole) == len(halves) > 20
    for one, other in zip(whole, halves, strict=True):
        np.testing.assert_allclose(other.motion.joints, one.motion.joints, atol=1e-9)


def test_hip_centred_frames_walk_by_the_foot_that_stands(frames):
    """A step with the hips at the origin all the time: the standing foot goes back, and the person forward."""
    skeleton = replace(SKELETON, hip_centred=True)
    stand = frames[0] - 0.5 * (at(frames[0], "left_hip") + at(frames[0], "right_hip"))
    person = LivePerson()
    walked = [stand.copy() for _ in range(160)]
    leg = [NAMES.index(f"left_{name}") for name in ("ankle", "toe", "knee")]
    other = [NAMES.index(f"right_{name}") for name in ("ankle", "toe", "knee")]
    for number, positions in enumerate(walked[80:], 80):
        back = 0.2 * min((number - 80) / 60.0, 1.0)
        positions[leg[:2], 0] -= back
        positions[leg[2], 0] -= 0.5 * back
        positions[other, 2] += 0.1  # swings
    poses = played(person, walked, skeleton=skeleton)
    assert poses[-1].motion.root_position[0, 0] - poses[0].motion.root_position[0, 0] == pytest.approx(0.2, abs=0.04)
    human = forward(poses[-1].motion)
    assert min(human.heel[0, :, 2].min(), human.toe[0, :, 2].min()) == pytest.approx(0.0, abs=1e-6)


def test_the_filter_is_quiet_at_rest_and_quick_in_motion():
    random = np.random.default_rng(0)
    noisy, euro = 0.01 * random.standard_normal((300, 1, 3)), OneEuro(4.0, 10.0, 30.0)
    still = np.array([euro(points) for points in noisy])
    assert still[60:].std() < 0.75 * noisy[60:].std()
    euro, ramp = OneEuro(4.0, 10.0, 30.0), np.arange(90)[:, None, None] * np.array([2.0 / 30.0, 0.0, 0.0])
    behind = ramp[-1, 0, 0] - [euro(points) for points in ramp][-1][0, 0]
    assert behind < 2.0 * 0.01  # 10 ms at 2 m/s
