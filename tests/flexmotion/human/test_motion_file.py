"""Our own motion files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.body import Body, Segments
from flexmotion.human.motion_file import load_motion, save_motion


def test_round_trip(clip, tmp_path):
    full = replace(
        clip,
        body=Body(1.6, 50.0, "female", replace(Segments.of_height(1.6), toe_out=-0.1)),
        contacts=np.ones((len(clip), 2), bool),
        activations=np.full((len(clip), 3), 0.5),
        source="somewhere",
    )
    for motion in (clip, full):
        save_motion(motion, tmp_path / "motion.npz")
        back = load_motion(tmp_path / "motion.npz")
        assert (back.fps, back.body, back.source) == (motion.fps, motion.body, motion.source)
        for name in ("root_position", "root_quaternion", "joints", "contacts", "activations", "torques", "wrenches"):
            np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))


def test_equal_motions_give_equal_bytes(clip, tmp_path):
    for name in ("a.npz", "b.npz"):
        save_motion(clip, tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_joints_in_another_order_are_matched_by_name(clip, tmp_path):
    path = tmp_path / "motion.npz"
    save_motion(clip, path)
    with np.load(path) as archive:
        content = dict(archive)
    header = json.loads(str(content["header"]))
    header["joints"] = header["joints"][::-1]
    torques = np.arange(len(clip) * 32, dtype=float).reshape(len(clip), 32)
    backwards = [*range(6), *range(31, 5, -1)]  # six of the root, then one a joint
    content |= {"header": np.array(json.dumps(header)), "joints": content["joints"][:, ::-1]}
    np.savez(path, **content | {"torques": torques[:, backwards]})
    np.testing.assert_array_equal(load_motion(path).joints, clip.joints)
    # Went wrong: torques stayed in the file's order, and were those of other joints.
    np.testing.assert_array_equal(load_motion(path).torques, torques)


def _spoil(path, **changes):
    with np.load(path) as archive:
        content = dict(archive)
    header = json.loads(str(content["header"])) | changes.pop("header", {})
    content |= {"header": np.array(json.dumps(header)), **changes}
    np.savez(path, **{name: value for name, value in content.items() if value is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": None}, "lacks joints"),
        ({"header": {"schema": "other/1"}}, "other/1"),
        ({"header": {"joints": ["hip_flexion_l"]}}, "lacks joint lumbar_extension"),
        ({"header": {"fps": -1}}, "fps"),
        ({"header": {"body": {"height": 0, "mass": 1, "sex": "male", "fitted": None}}}, "height"),
        ({"root_position": np.zeros((3, 3))}, "root_quaternion"),
        ({"root_position": np.full((361, 3), np.nan)}, "NaN"),
    ],
)
def test_errors_name_the_field(clip, tmp_path, changes, message):
    path = tmp_path / "motion.npz"
    save_motion(clip, path)
    _spoil(path, **changes)
    with pytest.raises(MotionFormatError, match=message) as caught:
        load_motion(path)
    assert "motion.npz" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"PK\x03\x04 cut off"])
def test_damaged_files(tmp_path, content):
    path = tmp_path / "motion.npz"
    path.write_bytes(content)
    with pytest.raises(MotionFormatError, match=r"motion\.npz"):
        load_motion(path)


def test_missing_file(tmp_path):
    with pytest.raises(MotionFormatError, match="No such file"):
        load_motion(tmp_path / "none.npz")
