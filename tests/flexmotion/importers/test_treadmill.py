"""Belts of treadmills: found where there is one, at any speed and direction, and never on the ground."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.shared.clips import data_folder
from flexmotion.configs.errors import ConfigError
from flexmotion.importers.belt import remove_belt
from flexmotion.importers.landmarks import Landmarks, landmarks
from flexmotion.importers.mapping import find_mapping
from flexmotion.importers.packed import read_packed
from flexmotion.importers.trc import read_trc
from flexmotion.importers.treadmill import (
    backward_speed,
    backwards,
    belt_velocity,
    feet_rest,
    suspected_velocity,
    without_belt,
)

HIP = 0.9


def gait(speed: float, seconds: float, *, heading: float = 0.0, fps: float = 60.0, duty: float = 0.6) -> Landmarks:
    """Hips that move at one speed [m/s] over feet that rest on the ground for `duty` of a stride, and swing."""
    time = np.arange(round(seconds * fps)) / fps
    stride = 1.1 if duty > 0.5 else 0.7
    points = {}
    for side, phase, left in (("l", 0.0, 0.1), ("r", 0.5, -0.1)):
        cycle = time / stride + phase
        share = np.clip((cycle % 1.0 - duty) / (1.0 - duty), 0.0, 1.0)
        swing = share**3 * (10 - 15 * share + 6 * share**2)
        x = speed * stride * (np.floor(cycle) + swing - phase + duty / 2)
        z = 0.03 + 0.12 * np.sin(np.pi * share) ** 2
        points[f"toe_{side}"] = np.column_stack([x, np.full_like(x, left), z])
        points[f"hip_{side}"] = np.column_stack([speed * time, np.full_like(x, left), np.full_like(x, HIP)])
    return turned(Landmarks("gait", fps, points), heading)


def turned(found: Landmarks, heading: float) -> Landmarks:
    turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
    return Landmarks(found.path, found.fps, {name: point @ turn.T for name, point in found.points.items()})


@pytest.mark.parametrize(("speed", "duty"), [(0.5, 0.65), (1.1, 0.6), (1.8, 0.58), (2.5, 0.4), (4.0, 0.33)])
@pytest.mark.parametrize("fps", [30.0, 100.0])
@pytest.mark.parametrize("heading", [0.0, 2.1, -1.2])
def test_belt_of_any_speed_and_direction(speed: float, duty: float, fps: float, heading: float) -> None:
    ground = gait(speed, 4.0, heading=heading, fps=fps, duty=duty)
    velocity = speed * np.array([np.cos(heading), np.sin(heading)])
    assert not belt_velocity(ground).any()
    assert belt_velocity(without_belt(ground, velocity)) == pytest.approx(-velocity, abs=0.03 + 0.02 * speed)


def test_belt_of_a_short_clip() -> None:
    """One stride, 1.2 s, is what the example of a laboratory has."""
    clip = without_belt(gait(1.1, 1.2), np.array([1.1, 0.0]))
    assert belt_velocity(clip) == pytest.approx([-1.1, 0.0], abs=0.05)


@pytest.mark.parametrize("start", [0.1, 0.2, 0.6, 0.7])
def test_belt_that_a_short_clip_does_not_prove(start: float) -> None:
    """Less than a stride of a treadmill was taken as ground without a word."""
    ground = gait(1.1, 2.0)
    frames = slice(round(start * ground.fps), round((start + 0.4) * ground.fps))
    belt = without_belt(ground, np.array([1.1, 0.0]))[frames]
    assert not belt_velocity(belt).any()
    assert suspected_velocity(belt).any()
    assert not suspected_velocity(ground[frames]).any()


def test_removal_gives_the_clip_over_ground() -> None:
    ground = gait(1.3, 3.0)
    belt = without_belt(ground, np.array([1.3, 0.0]))
    back = without_belt(belt, belt_velocity(belt))
    assert np.abs(back.points["toe_l"] - ground.points["toe_l"]).max() < 0.05


def test_speed_is_against_the_heading() -> None:
    ground = gait(1.0, 3.0, heading=0.7)
    assert backward_speed(ground, backwards(ground, 1.4)) == pytest.approx(1.4)
    assert backwards(ground, 1.4) == pytest.approx([-1.4 * np.cos(0.7), -1.4 * np.sin(0.7)], abs=1e-6)


def _drifting(feet: np.ndarray, hips: np.ndarray, lift: tuple[np.ndarray, np.ndarray], fps: float = 60.0) -> Landmarks:
    """Feet and hips on given horizontal paths, (T, 2), the feet lifted by `lift` (left, right)."""
    points = {}
    for side, left, up in (("l", 0.1, lift[0]), ("r", -0.1, lift[1])):
        points[f"toe_{side}"] = np.column_stack([feet[:, 0], feet[:, 1] + left, 0.03 + up])
        points[f"hip_{side}"] = np.column_stack([hips[:, 0], hips[:, 1] + left, np.full(len(feet), HIP)])
    return Landmarks("drifting", fps, points)


def test_motion_over_ground_is_no_belt() -> None:
    time = np.arange(300) / 60.0
    flat = np.zeros(300)
    line = np.column_stack([1.2 * time, flat])
    still = np.zeros((300, 2))
    hops = 0.2 * np.abs(np.sin(2 * np.pi * time))
    legs = np.column_stack([0.2 * np.sin(2 * np.pi * time), flat])
    circle = np.column_stack([0.4 * np.cos(3 * time), 0.4 * np.sin(3 * time)])
    march = tuple(0.15 * np.clip(np.sin(2 * np.pi * time + phase), 0, None) for phase in (0.0, np.pi))
    clips = {
        "stand": _drifting(still, still, (flat, flat)),
        "carried along, as on a sledge": _drifting(line, line, (flat, flat)),
        "hops forward on both feet": _drifting(line, line, (hops, hops)),
        "swings both legs, sitting": _drifting(legs, still, (flat, flat)),
        "spins on sliding feet": _drifting(circle, still, (flat, flat)),
        "marches on the spot": _drifting(still, still, march),
        "skates: alternate feet slide under the moving body": _drifting(line, line, march),
    }
    assert [name for name, clip in clips.items() if belt_velocity(clip).any()] == []
    assert [name for name, clip in clips.items() if suspected_velocity(clip).any()] == []


def test_clip_too_short_for_a_belt() -> None:
    assert not belt_velocity(gait(1.0, 0.1)).any()


@pytest.fixture(scope="module")
def recorded() -> list[Landmarks]:
    try:
        path = data_folder() / "cmu_joints22_30fps_mm.npz"
    except ConfigError:
        pytest.skip("needs the motion data")
    found = []
    with np.load(path) as content:
        for name in content.files[::2]:
            capture = read_packed(str(path), {name: content[name]}, name)
            found.append(landmarks(capture, find_mapping(capture.names, capture.path)))
    return found


def test_recorded_motion_has_no_belt(recorded: list[Landmarks]) -> None:
    assert [clip.path for clip in recorded if belt_velocity(clip).any()] == []
    assert [clip.path for clip in recorded[::3] if suspected_velocity(clip).any()] == []


def test_recorded_walks_as_if_on_a_belt(recorded: list[Landmarks]) -> None:
    """Walks and runs along a line, less their mean velocity, are what a treadmill's cameras would see."""
    errors = []
    for clip in recorded:
        hips = (clip.points["hip_l"] + clip.points["hip_r"])[:, :2] / 2
        seconds = (len(clip) - 1) / clip.fps
        mean = (hips[-1] - hips[0]) / seconds
        path = np.linalg.norm(np.diff(hips[:: round(clip.fps / 5)], axis=0), axis=-1).sum() / seconds
        if np.linalg.norm(mean) > max(0.4, 0.95 * path) and seconds > 2.5:
            errors.append(np.linalg.norm(belt_velocity(without_belt(clip, mean)) + mean))
    assert len(errors) > 20
    assert np.mean(np.array(errors) < 0.15) > 0.9


def test_trials_of_laboratories() -> None:
    """The trial on the belt was taken as ground: its vertical force was wrong by 11.8 % of body weight."""
    from flexmotion.importers import read

    try:
        folder = data_folder()
    except ConfigError:
        pytest.skip("needs the motion data")
    speeds = {}
    for name in ("gait2354_markers", "gait2354_joint_centres", "gait_second_walk_joint_centres"):
        file: Path = folder / f"{name}.trc"
        speeds[name] = float(np.linalg.norm(read(file, fps=None).belt))
    assert speeds["gait2354_markers"] == pytest.approx(1.13, abs=0.03)
    assert speeds["gait2354_joint_centres"] == pytest.approx(1.13, abs=0.03)
    assert speeds["gait_second_walk_joint_centres"] == 0.0


@pytest.mark.parametrize("first", [0, 48, 84])
def test_short_part_of_a_treadmill_trial(first: int) -> None:
    """.63 s of the trial on the belt was taken as ground, and nothing said that it might not be."""
    from flexmotion.importers.load import fit_capture

    try:
        capture = read_trc(data_folder() / "gait2354_markers.trc")
    except ConfigError:
        pytest.skip("needs the motion data")
    found = fit_capture(replace(capture, positions=capture.positions[first : first + 38]))
    assert not found.belt.any()
    assert any("may be a treadmill" in text and "--belt V, or none" in text for text in found.warnings)
    decided = fit_capture(replace(capture, positions=capture.positions[first : first + 38]), belt=None)
    assert not any("treadmill" in text for text in decided.warnings)


@pytest.mark.parametrize(
    ("belt", "message"),
    [(None, "belt is given as none, but both feet move at 1.1"), (3.0, "given as 3.00 m/s, but the feet move at 1.1")],
)
def test_given_belt_that_is_not_that_of_the_recording(belt: float | None, message: str, shared_data: Path) -> None:
    """Vertical forces were wrong by 23 to 35 % of body weight, and nothing said so although the speed was known."""
    from flexmotion.importers import read

    found = read(shared_data / "gait2354_markers.trc", belt=belt)
    assert any(message in text and "ground forces may be wrong" in text for text in found.warnings), found.warnings
    assert np.linalg.norm(found.belt) == pytest.approx(belt or 0.0)


def test_belt_given_for_a_walk_over_ground(shared_data: Path) -> None:
    from flexmotion.importers import read

    found = read(shared_data / "gait_second_walk_joint_centres.trc", belt=1.1)
    assert any("both feet rest" in text for text in found.warnings), found.warnings


@pytest.mark.parametrize("error", [-0.15, 0.0, 0.15])
def test_given_belt_that_agrees(error: float) -> None:
    """Treadmills show their speed to about a tenth; forces do not change by as much."""
    belt = without_belt(gait(1.3, 4.0), np.array([1.3, 0.0]))
    assert not [text for text in remove_belt(belt, 1.3 + error)[2] if "but" in text]
    assert not feet_rest(belt, 1.3)


def test_given_belt_of_feet_that_rest() -> None:
    ground = gait(1.3, 4.0)
    assert feet_rest(ground, 1.3)
    assert "both feet rest" in remove_belt(ground, 1.3)[2][0]
    assert remove_belt(ground, None)[2] == []
