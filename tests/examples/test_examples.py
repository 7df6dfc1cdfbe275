"""The programs of `examples/`, run as a user runs them."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.gateway.ports import any_free

from ..waiting import wait_until

EXAMPLES = Path(__file__).parents[2] / "examples"
VIRTUAL = Path(__file__).parents[1] / "virtual_program.py"
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


def test_targets_are_sent_to_a_run_and_answered(tmp_path: Path) -> None:
    ports = ["--web-port", str(port := any_free()), "--stop-port", str(any_free())]
    command = [sys.executable, str(VIRTUAL), "dry-run", "--web", *ports, "--no-realtime", "--json"]
    over_zenoh = find_spec("zenoh") is not None
    zenoh_port = any_free()
    if over_zenoh:
        settings = tmp_path / "stream.yaml"
        settings.write_text(f"gateway: {{zenoh_port: {zenoh_port}, zenoh_stop_port: {any_free()}}}\n")
        command += ["--zenoh", "--settings", str(settings)]
    environment = os.environ | {"FASTEST": "1"}  # the other program lives on the wall clock
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as live:
        try:
            assert live.stderr is not None and live.stdout is not None
            while "READY -> STREAMING" not in (line := live.stderr.readline()):
                assert line, "the run ended before it streamed"
            wait_until(lambda: listens(port), "the gateway to listen")
            wave, walk, fly, hold, state = run("send_targets.py", "--port", str(port)).splitlines()
            told = run("send_over_zenoh.py", f"tcp/127.0.0.1:{zenoh_port}").splitlines() if over_zenoh else []
            live.terminate()
            report = json.loads(live.stdout.read())
        finally:
            live.kill()
    if over_zenoh:
        states = [line.split()[:2] for line in told]
        assert states[:2] == [["take", "accepted"], ["text", "accepted"]]
        assert states[3:] == [["alice"], ["accepted"]]
        assert states[2][0] == "velocity" and states[2][1] in ("accepted", "slowed")
    assert wave.split()[:3] == ["text", "accepted", "wave-right-hand"]
    assert walk.split()[0] == "velocity" and walk.split()[1] in ("accepted", "slowed")
    assert fly.split()[:2] == ["text", "refused"] and "no robot of this project does 'fly" in fly
    assert hold.split()[:2] == ["hold", "accepted"]
    assert state in ("STREAMING", "HOLD")
    assert report["motion"]["fell"] is False and report["limits"]["violations_sent"] == 0
    assert [target["state"] for target in report["targets"]][-5 if over_zenoh else -3] in ("accepted", "slowed")
    # A report in which something was refused is not PASS.
    assert report["ok"] is False


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_a_clip_is_sent_as_frames_of_a_person(tmp_path: Path) -> None:
    clip = tmp_path / "steps.npz"
    save_motion(default_clip()[:12], clip)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 39539))
        out = run("mirror_clip.py", str(clip), "mediapipe")
        found = [json.loads(receiver.recv(65536)) for _ in range(12)]
    assert out.startswith("sent 12 frames in ") and len(found[0]["landmarks"]) == 33
    assert [frame["t"] for frame in found] == sorted(frame["t"] for frame in found)


@pytest.mark.skipif(find_spec("mediapipe") is not None, reason="the extra camera is installed")
def test_a_camera_without_its_libraries_says_what_to_install() -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "mirror_camera.py"), "model.task"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and "pip install 'flexmotion[camera]'" in done.stderr


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.name)
def test_every_program_is_short_and_in_the_index(program: Path) -> None:
    assert len(program.read_text().splitlines()) < 40
    assert f"]({program.name})" in (EXAMPLES / "README.md").read_text()
