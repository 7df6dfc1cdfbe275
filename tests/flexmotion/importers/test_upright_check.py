"""A walk with another axis up, or of a person upside down, was imported without a word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.importers import read
from flexmotion.importers.upright_check import check_upright

Write = Callable[..., Path]


def turned(motion: Motion, axis: str, degrees: float, *, path: bool, share: float = 1.0) -> Motion:
    """The motion with its human turned by an angle, in the first share of it; its path too, or each frame in place."""
    count = round(share * len(motion))
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    quaternion, place = motion.root_quaternion.copy(), motion.root_position.copy()
    before = Rotation.from_quat(quaternion[:count], scalar_first=True)
    quaternion[:count] = (turn * before).as_quat(scalar_first=True)
    if path:
        place[:count] = turn.apply(place[:count])
    return replace(motion.kinematics, root_quaternion=quaternion, root_position=place)


@pytest.fixture(scope="module")
def walk(clip: Motion) -> Motion:
    """A walk of several metres along one line."""
    here = clip[240:360]
    return replace(here, root_position=here.root_position + np.outer(np.arange(len(here)) / here.fps, [1.5, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("axis", "degrees", "path", "told"),
    [
        ("y", 90.0, True, ("never upright: the shoulders are at most", "the hips rise or sink by")),
        ("y", -90.0, True, ("never upright: the shoulders are at most", "the hips rise or sink by")),
        ("x", 180.0, False, ("never upright: the shoulders are at most -",)),
        ("x", 85.0, False, ("never upright: the shoulders are at most",)),
    ],
)
def test_a_person_who_is_never_upright_is_told(
    walk: Motion, write_bvh: Write, tmp_path: Path, axis: str, degrees: float, path: bool, told: tuple[str, ...]
) -> None:
    """A walk whose pelvis lies down and sinks by eight metres was imported, and `dry-run` passed."""
    found = read(write_bvh(tmp_path / "a.bvh", turned(walk, axis, degrees, path=path)), up="y").warnings
    assert len(found) == len(told) and all(note.startswith(text) for note, text in zip(found, told, strict=True))


def test_the_axis_that_is_up_is_named(walk: Motion) -> None:
    human = forward(walk)
    points = {f"{name}_{side}": getattr(human, name)[:, k] for name in ("hip", "ankle") for k, side in enumerate("lr")}
    points |= {f"shoulder_{side}": human.shoulder[:, k] for k, side in enumerate("lr")}
    assert check_upright(points, walk.body.leg, "z") == []
    lying = {name: np.stack([value[:, 1], value[:, 2], value[:, 0]], axis=1) for name, value in points.items()}
    (told,) = check_upright(lying, walk.body.leg, "z")[:1]
    assert told.endswith("give a mapping with 'up: y'")


def test_the_path_alone_may_have_another_axis(walk: Motion, write_bvh: Write, tmp_path: Path) -> None:
    place = walk.root_position[:, [1, 2, 0]]
    (told,) = read(write_bvh(tmp_path / "a.bvh", replace(walk.kinematics, root_position=place))).warnings
    assert told.startswith("the hips rise or sink by") and told.endswith("is another axis up?")


def test_who_is_upside_down_for_a_while_is_not_told(walk: Motion, write_bvh: Write, tmp_path: Path) -> None:
    """Cartwheels, handstands and rest on the floor are motion of people."""
    for axis, degrees in (("x", 180.0), ("y", 90.0)):
        part = turned(walk, axis, degrees, path=False, share=0.8)
        assert read(write_bvh(tmp_path / "a.bvh", part), up="y").warnings == ()
