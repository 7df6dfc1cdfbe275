from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.errors import FrameError
from flexmotion.streamer.mirror.clip_frames import clip_frames
from flexmotion.streamer.mirror.frame_reader import LARGEST, FrameReader
from flexmotion.streamer.mirror.named_joints import LANDMARKS

from .mirror_frames import T_POSE, bones, bundle, message, shipped

HALF = np.sqrt(0.5)


def place(frame, name):
    return frame.positions[frame.skeleton.names.index(name)]


def test_named_joints_keep_axes_units_and_time():
    datagram = json.dumps({"t": 3.5, "up": "z", "units": "cm", "joints": {"b": [1, 2, 3], "a": [4, 5, None]}}).encode()
    (frame,) = FrameReader().take(datagram)
    assert frame.skeleton.names == ("a", "b") and (frame.skeleton.up, frame.skeleton.units) == ("z", "cm")
    assert frame.time_s == 3.5
    np.testing.assert_array_equal(place(frame, "b"), [1, 2, 3])
    assert np.isnan(place(frame, "a")[2])


def test_landmarks_of_mediapipe_have_left_up_and_forward():
    rows = [[0.0, 0.0, 0.0, 1.0]] * len(LANDMARKS)
    rows[LANDMARKS.index("left_hip")] = [0.1, 0.0, 0.0, 1.0]  # to the right of the picture: facing the camera, left
    rows[LANDMARKS.index("nose")] = [0.0, -0.6, -0.1, 1.0]  # above the hips, towards the camera
    rows[LANDMARKS.index("left_wrist")] = [0.0, 0.0, 0.0, 0.1]  # not seen
    (frame,) = FrameReader().take(json.dumps({"landmarks": rows}).encode())
    assert frame.skeleton.up == "y" and frame.skeleton.hip_centred and frame.time_s is None
    np.testing.assert_allclose(place(frame, "left_hip"), [0.1, 0, 0])  # x is left
    np.testing.assert_allclose(place(frame, "nose"), [0.0, 0.6, 0.1])  # y is up, z forward
    assert np.isnan(place(frame, "left_wrist")).all()


def test_landmarks_may_be_objects():
    rows = [{"x": 1.0, "y": 2.0, "z": 3.0, "visibility": 0.9}] * len(LANDMARKS)
    (frame,) = FrameReader().take(json.dumps({"landmarks": rows}).encode())
    np.testing.assert_allclose(frame.positions[0], [1.0, -2.0, -3.0])


def test_bones_of_vmc_are_added_up_in_right_handed_axes():
    (frame,) = FrameReader().take(bundle(bones(time_s=2.0)))
    assert frame.time_s == 2.0
    # Unity's left is at -x; here x is left.
    np.testing.assert_allclose(place(frame, "LeftUpperArm"), [0.17, 1.35, 0.0], atol=1e-6)
    np.testing.assert_allclose(place(frame, "RightHand"), [-0.69, 1.35, 0.0], atol=1e-6)
    np.testing.assert_allclose(place(frame, "LeftFoot"), [0.09, 0.08, 0.0], atol=1e-6)
    ahead = place(frame, "LeftToes") - place(frame, "LeftFoot")  # the model has none: it is a guess
    assert ahead[2] > 0.1 and ahead[1] < -0.05


def test_an_arm_of_vmc_that_is_raised_is_raised_here():
    # About z of Unity by +90°: counterclockwise seen against z, which takes the right arm's +x to +y.
    (frame,) = FrameReader().take(bundle(bones({"RightUpperArm": (0.0, 0.0, HALF, HALF)})))
    np.testing.assert_allclose(place(frame, "RightHand") - place(frame, "RightUpperArm"), [0.0, 0.52, 0.0], atol=1e-6)


@pytest.mark.parametrize("end", ["/VMC/Ext/T", "/VMC/Ext/OK", "again"])
def test_a_frame_of_vmc_may_come_in_pieces(end):
    reader, pieces = FrameReader(), bones()
    assert not any(reader.take(one.dgram) for one in pieces)
    last = {"/VMC/Ext/T": message("/VMC/Ext/T", 1.5), "/VMC/Ext/OK": message("/VMC/Ext/OK", 1), "again": pieces[0]}[end]
    (frame,) = reader.take(last.dgram)
    assert set(T_POSE) <= set(frame.skeleton.names)


def test_bones_that_are_no_human_make_no_frame():
    assert FrameReader().take(bundle(bones()[:4])) == []


@pytest.mark.parametrize(
    ("datagram", "named"),
    [
        (b"\x00\xff", "neither JSON nor OSC"),
        (b"{", "no JSON"),
        (b'{"pose": 1}', "joints, landmarks"),
        (b'{"joints": []}', "joints"),
        (b'{"joints": {"a": [1, 2]}}', "joints: a"),
        (b'{"joints": {"a": ["x", 2, 3]}}', "joints: a"),
        (b'{"joints": {"a": [1, 2, 3]}, "up": "x"}', "up"),
        (b'{"joints": {"a": [1, 2, 3]}, "units": "feet"}', "units"),
        (b'{"joints": {"a": [1, 2, 3]}, "t": "now"}', "t:"),
        (b'{"joints": {"a": [1, 2, 3]}, "t": NaN}', "t:"),
        (b'{"landmarks": [[1, 2, 3]]}', "expected 33"),
        (b"/VMC", "OSC"),
        (message("/VMC/Ext/Bone/Pos", "Hips", 0.0).dgram, "Hips"),
        (message("/VMC/Ext/Bone/Pos", "Hips", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0).dgram, "unit quaternion"),
        (message("/VMC/Ext/Bone/Pos", "Hips", float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0).dgram, "finite"),
        (b"{" + b" " * LARGEST, "bytes"),
    ],
)
def test_nonsense_is_named(datagram, named):
    with pytest.raises(FrameError, match=named):
        FrameReader().take(datagram)


@given(
    st.binary(max_size=200).flatmap(lambda tail: st.sampled_from([tail, b"{" + tail, b"/" + tail, b"#bundle" + tail]))
)
def test_bytes_are_a_frame_or_a_typed_error(datagram):
    try:
        assert isinstance(FrameReader().take(datagram), list)
    except FrameError as error:
        assert str(error)


@pytest.mark.parametrize("protocol", ["joints", "mediapipe"])
def test_a_clip_is_sent_as_it_is(protocol):
    motion = shipped(0.5)
    frames = clip_frames(motion, protocol)
    assert len(frames) == len(motion)
    (frame,) = FrameReader().take(frames[3][1])
    assert frame.time_s == pytest.approx(3 / motion.fps)
    hips = place(frame, "left_hip") - place(frame, "right_hip")
    assert np.linalg.norm(hips) == pytest.approx(motion.body.segments.hip_width, abs=1e-4)
