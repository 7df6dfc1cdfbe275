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

from .mirror_frames import T_POSE, bones, bundle, message, nested_bundle, raw_bundle, shipped

HALF = np.sqrt(0.5)
HUGE = b"1" + b"0" * 400
"""An integer that no float holds."""


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
        (b'{"joints": {"a": [1, %b, 3]}}' % HUGE, "joints: a"),
        (b'{"joints": {"a": [1, 2, 3]}, "t": %b}' % HUGE, "t:"),
        (nested_bundle(9), "at most 8 deep"),
        (raw_bundle(b"", sizes=(-4,)), "-4 bytes"),
        (raw_bundle(b"/a\0\0", sizes=(8,)), "8 bytes"),
        (raw_bundle(b"/a\0\0\0\0", sizes=(6,)), "6 bytes"),
        (raw_bundle(b"a\0\0\0"), "neither a message nor a bundle"),
    ],
)
def test_nonsense_is_named(datagram, named):
    with pytest.raises(FrameError, match=named):
        FrameReader().take(datagram)


def test_a_frame_may_lie_in_a_bundle_of_bundles():
    content = bundle(bones(time_s=2.0))
    for _ in range(7):
        content = raw_bundle(content)
    (frame,) = FrameReader().take(content)
    assert frame.time_s == 2.0


def test_a_bone_whose_name_is_a_list_is_no_bone():
    assert FrameReader().take(b"/VMC/Ext/Bone/Pos\0\0\0,[i]\0\0\0\0" + bytes(4)) == []


values = st.sampled_from(sorted(T_POSE)) | st.floats(width=32) | st.booleans() | st.integers(-(2**63), 2**63 - 1)
osc_messages = st.builds(
    lambda address, given: message(address, *given).dgram,
    st.sampled_from(["/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos", "/VMC/Ext/T", "/VMC/Ext/OK", "/other"]),
    st.lists(st.lists(values, max_size=2) | values, max_size=9),
)
osc_elements = st.recursive(
    osc_messages | st.binary(max_size=24).map(lambda tail: b"/" + tail + bytes(-(len(tail) + 1) % 4)),
    lambda inner: st.builds(
        lambda elements, sizes: raw_bundle(*elements, sizes=tuple(sizes[: len(elements)])),
        st.lists(inner, max_size=3),
        st.just([]) | st.lists(st.integers(-12, 12), max_size=1),
    ),
    max_leaves=12,
)
numbers = st.sampled_from([None, True, "1", [], 10**400, -(10**400)]) | st.floats() | st.integers()
places = st.lists(numbers, min_size=3, max_size=3) | st.lists(numbers, max_size=5) | numbers
json_frames = st.builds(
    lambda content, time_s: json.dumps(content | {"t": time_s}).encode(),
    st.builds(lambda place: {"joints": {"a": place}}, places)
    | st.builds(lambda place: {"landmarks": [place] * len(LANDMARKS)}, places),
    numbers,
)
any_bytes = st.binary(max_size=200).flatmap(
    lambda tail: st.sampled_from([tail, b"{" + tail, b"/" + tail, b"#bundle\0" + tail])
)


@pytest.mark.parametrize("datagrams", [any_bytes, osc_elements, json_frames], ids=["bytes", "OSC", "JSON"])
@given(drawn=st.data())
def test_bytes_are_a_frame_or_a_typed_error(datagrams, drawn):
    """Only bytes that are no bundle were tried: bundles in bundles and integers beyond any float ended the process."""
    try:
        assert isinstance(FrameReader().take(drawn.draw(datagrams)), list)
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
