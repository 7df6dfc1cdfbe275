"""The programs of `examples/`, run as a user runs them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import default_clip

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))


def run(name: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_robot_driven_by_velocity_walks_ahead_and_turns_left() -> None:
    out = run("drive_by_velocity.py")
    rows = [
        [float(number) for number in re.findall(r"-?\d+\.?\d*", line)] for line in out.splitlines() if " s " in line
    ]
    times, ahead, _left, turned = zip(*rows, strict=True)
    assert times == (2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0)
    assert ahead[2] > 0.1
    assert turned[5] - turned[2] > 60.0
    assert out.endswith("ended OFF\n") and "fell: False" in out


def test_motion_sampled_from_words_is_saved(tmp_path: Path) -> None:
    file = tmp_path / "wave.npz"
    out = run("sample_motion.py", "wave with the right hand", str(file))
    motion = load_motion(file)
    assert out == f"{file}: {len(motion)} frames at 30 Hz, joints ({len(motion)}, 26) [rad]\n"
    assert motion.duration >= 4.0
    left, right = (np.ptp(motion.joints[:, JOINTS.index(f"shoulder_flexion_{side}")]) for side in "lr")
    assert right > 1.0 and right > 3.0 * left


def test_a_clip_is_retargeted_inside_the_joint_limits(tmp_path: Path) -> None:
    clip = tmp_path / "steps.npz"
    save_motion(default_clip()[225:290], clip)
    head, *rows = run("retarget_clip.py", str(clip), "op3").splitlines()
    assert re.fullmatch(r"\d+ rows at 125 Hz, [1-9]\d* steps", head)
    robot = load_robot("op3")
    assert [row.split()[0] for row in rows] == list(robot.joint_names)
    for index, row in enumerate(rows):
        low, high = (np.radians(float(word.rstrip("°"))) for word in row.split()[1::2])
        assert robot.lower[index] - 1e-3 <= low <= high <= robot.upper[index] + 1e-3


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.name)
def test_every_program_is_short_and_in_the_index(program: Path) -> None:
    assert len(program.read_text().splitlines()) < 40
    assert f"]({program.name})" in (EXAMPLES / "README.md").read_text()
