"""Reading BVH, and refusing what is none."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.motion_file import save_motion
from flexmotion.importers import read
from flexmotion.importers.bvh import read_bvh

ARM = """HIERARCHY
ROOT base
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT upper
  {
    OFFSET 1 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT lower
    {
      OFFSET 2 0 0
      CHANNELS 3 Xrotation Yrotation Zrotation
      End Site
      {
        OFFSET 3 0 0
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.025
0 0 0  0 0 0  0 0 0  0 0 0
5 6 7  90 0 0  0 90 0  0 0 90
"""


def write(tmp_path, text):
    path = tmp_path / "clip.bvh"
    path.write_text(text)
    return path


def test_positions_and_rotations(tmp_path):
    capture = read_bvh(write(tmp_path, ARM))
    assert capture.fps == pytest.approx(40.0)
    assert capture.names == ("base", "upper", "lower", "lower/end")
    assert capture.parents == (-1, 0, 1, 2)
    np.testing.assert_allclose(capture.positions[0], [[0, 0, 0], [1, 0, 0], [3, 0, 0], [6, 0, 0]])
    # The base rotates x to y, the upper bone rolls about its own axis, and the lower one rotates about its own z, which
    # the roll has moved from the world's z to its x.
    np.testing.assert_allclose(capture.positions[1], [[5, 6, 7], [5, 7, 7], [5, 9, 7], [5, 9, 10]], atol=1e-12)
    np.testing.assert_allclose(capture.zero_positions[:, 0], [0, 1, 3, 6])


def test_rotations_follow_the_order_of_channels(tmp_path):
    turned = read_bvh(write(tmp_path, ARM.replace("5 6 7  90 0 0", "0 0 0  90 90 0")))
    swapped = ARM.replace("Zrotation Xrotation Yrotation\n  JOINT", "Xrotation Zrotation Yrotation\n  JOINT")
    other = read_bvh(write(tmp_path, swapped.replace("5 6 7  90 0 0", "0 0 0  90 90 0")))
    np.testing.assert_allclose(turned.rotations[1, 0], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(other.rotations[1, 0], [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-12)


def test_position_channels_replace_the_offset(tmp_path):
    text = ARM.replace(
        "CHANNELS 3 Zrotation Xrotation Yrotation",
        "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation",
    ).replace("0 0 0  0 0 0  0 0 0  0 0 0", "0 0 0 0 0 0  1.5 0 0 0 0 0  0 0 0")
    text = text.replace("5 6 7  90 0 0  0 90 0  0 0 90", "5 6 7 90 0 0  1.5 0 0 0 90 0  0 0 90")
    capture = read_bvh(write(tmp_path, text))
    np.testing.assert_allclose(capture.positions[0, :, 0], [0, 1.5, 3.5, 6.5])


def test_windows_line_ends_tabs_and_namespaces(tmp_path):
    text = ARM.replace("ROOT base", "ROOT rig:base").replace("Frames: 2", "Frames:\t2").replace("\n", "\r\n")
    path = tmp_path / "clip.bvh"
    path.write_bytes(text.encode())
    assert read_bvh(path).names[0] == "base"


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (ARM, "", "the file is empty"),
        (ARM, "\n \n", "the file is empty"),
        (ARM, "frame,x,y\n0,1,2\n", "line 1: not a BVH file"),
        (ARM, ARM[: ARM.index("MOTION")], "ends before MOTION"),
        (ARM, ARM[: ARM.index("Frames")], "ends before 'Frames:'"),
        (ARM, ARM[: ARM.index("Frame Time")], "ends before 'Frame Time:'"),
        ("5 6 7  90 0 0  0 90 0  0 0 90\n", "", "1 frames, but 'Frames' says 2"),
        ("0 0 90\n", "0", "line 25: 10 values, expected 12"),
        ("5 6 7", "5 nan 7", "line 25: Yposition of joint 'base' is nan"),
        ("0 0 90\n", "0 0 inf\n", "Zrotation of joint 'lower' is inf"),
        ("5 6 7", "5 six 7", "line 25: could not convert string to float: 'six'"),
        ("OFFSET 1 0 0", "OFFSET 1 0", "line 8: .*expected 3 finite numbers"),
        ("OFFSET 1 0 0", "OFFSET nan 0 0", "line 8: .*expected 3 finite numbers"),
        ("Yrotation\n  JOINT", "Wrotation\n  JOINT", "line 5: unknown channel 'Wrotation'; valid: Xposition"),
        ("CHANNELS 6", "CHANNELS 5", "line 5: CHANNELS: expected their number"),
        (
            "CHANNELS 3 Zrotation Xrotation Yrotation",
            "CHANNELS 1 Zrotation",
            "line 9: expected three rotation channels of a joint, or none",
        ),
        ("JOINT lower", "JOINT upper", "line 10: a second joint named 'upper'"),
        ("JOINT lower", "ROOT other", "line 10: a second ROOT"),
        ("JOINT lower", "JOINT", "line 10: JOINT has no name"),
        ("JOINT lower\n    {", "JOINT lower\n", "MOTION|line|'}'"),
        ("Frame Time: 0.025", "Frame Time: 0", "'Frame Time' is 0, expected a positive number"),
        ("Frames: 2", "Fraems: 2", "line 22: found 'Fraems: 2', expected 'Frames: NUMBER'"),
        ("Frames: 2", "Frames: two", "line 22: could not convert"),
        ("  OFFSET 0 0 0\n", "  SCALE 2\n", "line 4: unknown keyword 'SCALE'"),
    ],
)
def test_errors_name_file_and_line(tmp_path, before, after, message):
    path = write(tmp_path, after if before == ARM else ARM.replace(before, after, 1))
    with pytest.raises(MotionFormatError, match=message) as caught:
        read_bvh(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(MotionFormatError, match="No such file"):
        read_bvh(tmp_path / "none.bvh")


def test_rotations_in_radians_are_told(clip, write_bvh, tmp_path):
    """They were read as degrees without a word: a figure with stiff legs slid along, and the robot fell."""
    path = write_bvh(tmp_path / "walk.bvh", clip[:60])
    assert read_bvh(path).warnings == ()
    lines = path.read_text().splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    rows = np.array([line.split() for line in lines[first:]], float)
    rows[:, 3:] = np.radians(rows[:, 3:])

    def told(table: np.ndarray) -> tuple[str, ...]:
        path.write_text("\n".join([*lines[:first], *(" ".join(map(str, row)) for row in table)]) + "\n")
        return read_bvh(path).warnings

    (warning,) = told(rows)
    assert warning.startswith("no rotation is beyond ±") and warning.endswith("expected degrees: are they in radians?")
    assert told(np.repeat(rows[:1], 60, axis=0)) == ()  # nobody moves: of a calibration pose nothing is known


def test_a_single_frame_is_told(clip, write_bvh, tmp_path):
    """It was imported without a word, and `dry-run` refused what `data import` had written."""
    path = write_bvh(tmp_path / "pose.bvh", clip[:1])
    assert "1 frame: a pose, no motion; a robot follows two frames or more" in read(path).warnings
    save_motion(clip[:1], tmp_path / "pose.npz")
    assert "1 frame: a pose, no motion; a robot follows two frames or more" in read(tmp_path / "pose.npz").warnings
