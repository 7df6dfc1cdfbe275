"""Files that every format allows and no human makes: they were read, and robots followed them, without a word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import save_motion
from flexmotion.importers import read
from flexmotion.importers.way_check import check_way

Write = Callable[..., Path]


def test_frame_times_in_milliseconds_are_refused(clip: Motion, write_bvh: Write, tmp_path: Path) -> None:
    """A clip with a frame time of 33.33 was over an hour long; with `--seconds 4` the robot stood, and passed."""
    path = write_bvh(tmp_path / "ms.bvh", clip)
    path.write_text(path.read_text().replace(f"Frame Time: {1 / clip.fps:.7f}", "Frame Time: 33.33"))
    told = r"ms\.bvh: a frame every 33\.33 s, expected 0\.5 s at most; is its time given in milliseconds"
    with pytest.raises(MotionFormatError, match=told):
        read(path)
    save_motion(replace(clip, fps=0.03), tmp_path / "slow.npz")
    with pytest.raises(MotionFormatError, match=r"slow\.npz: a frame every 33\.33 s"):
        read(tmp_path / "slow.npz")


def test_a_damaged_number_is_refused_with_its_frame(clip: Motion, write_bvh: Write, tmp_path: Path) -> None:
    """One place of 1e30 in one frame passed without a note."""
    path = write_bvh(tmp_path / "huge.bvh", clip, leading=3)
    lines = path.read_text().splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("Frame Time")) + 20
    lines[at] = " ".join(["1e30", *lines[at].split()[1:]])
    path.write_text("\n".join(lines) + "\n")
    told = r"huge\.bvh: frame 20 \(at 0\.63 s\): the hips are 1e\+28 m from the middle of their way, expected 1000 m"
    with pytest.raises(MotionFormatError, match=told):
        read(path)


def test_a_jump_is_told_with_its_frame(clip: Motion, tmp_path: Path) -> None:
    place = clip.root_position.copy()
    place[10:] += [3.0, 0.0, 0.0]
    save_motion(replace(clip, root_position=place), tmp_path / "jump.npz")
    (warning,) = read(tmp_path / "jump.npz").warnings
    assert warning.startswith("frame 11 (at 0.33 s): the hips jump by 3") and warning.endswith("15 m/s at most")
    save_motion(clip, tmp_path / "clip.npz")
    assert read(tmp_path / "clip.npz").warnings == ()


def test_a_long_way_out_of_doors_is_read() -> None:
    """An hour at 1.4 m/s leads further than the first limit."""
    times = np.arange(3600.0 * 2) / 2.0
    assert check_way("walk", 2.0, np.column_stack([1.4 * times, 0.0 * times, 0.0 * times])) == []
