"""Mass and height of an imported human: as given, else guessed with a warning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body, Segments
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import save_motion
from flexmotion.importers import read

from .surface_markers import joint_centres, write_trc


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, clip: Motion) -> Path:
    tracks = {name: track[:90] for name, track in joint_centres(clip).items()}
    return write_trc(tmp_path_factory.mktemp("size") / "a.trc", tracks)


def test_guessed_mass_comes_with_a_warning(file: Path) -> None:
    """A guess was off by 29 %, and nothing said that it was one."""
    found = read(file)
    body = found.motion.body
    assert body.mass == pytest.approx(70.0 / 1.75**2 * body.height**2)
    assert "mass of" in found.mass_guess and "guessed" in found.mass_guess and "30 %" in found.mass_guess
    assert found.notes == (*found.warnings, found.mass_guess)


def test_given_mass_is_taken_without_a_warning(file: Path) -> None:
    found = read(file, mass=61.5)
    assert found.motion.body.mass == 61.5
    assert not any("mass" in text for text in found.notes)


def test_height_scales_what_joint_centres_do_not_define(file: Path) -> None:
    small, tall = (read(file, height=height).motion.body for height in (1.60, 2.00))
    assert (small.height, tall.height) == (1.60, 2.00)
    assert tall.segments.head == pytest.approx(small.segments.head * 2.00 / 1.60)
    assert tall.segments.hand > small.segments.hand
    assert tall.segments.thigh == pytest.approx(small.segments.thigh)
    assert tall.mass == pytest.approx(small.mass * (2.00 / 1.60) ** 2)


@pytest.mark.parametrize(
    ("given", "message"), [({"mass": 3.0}, "mass is 3 kg"), ({"height": 180.0}, "height is 180 m")]
)
def test_sizes_of_no_human(file: Path, given: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read(file, **given)


@pytest.fixture
def own(tmp_path: Path, clip: Motion) -> Callable[..., Path]:
    """Writes a motion file of a human of this size, with forces."""

    def write(height: float, mass: float, *, given: bool | None = None, fitted: bool = False) -> Path:
        frames = len(clip)
        body = Body(height, mass, fitted=Segments.of_height(height) if fitted else None)
        forces = {"torques": np.ones((frames, 32)), "wrenches": np.ones((frames, 2, 6))}
        save_motion(replace(clip, body=body, mass_given=given, **forces), tmp_path / "a.npz")
        return tmp_path / "a.npz"

    return write


def test_import_says_whether_the_mass_is_given(file: Path, tmp_path: Path) -> None:
    """A set had 74.06 kg for a subject imported with 95 kg: nothing said that this mass was known."""
    for mass, given in ((95.0, True), (None, False)):
        found = read(file, mass=mass, height=1.8).motion
        assert found.mass_given is given
        save_motion(found, tmp_path / "a.npz")
        again = read(tmp_path / "a.npz")
        assert (again.motion.mass_given, again.motion.body) == (given, found.body)
        assert bool(again.mass_guess) is not given


def test_own_files_keep_a_given_mass(own: Callable[..., Path]) -> None:
    found = read(own(1.6, 70.0, given=True))
    assert (found.motion.body, found.notes) == (Body(1.6, 70.0), ())
    assert found.motion.torques is not None


@pytest.mark.parametrize(
    ("mass", "given", "expected"),
    [(95.0, True, 95.0), (70.0, False, 58.5), (70 * (1.6 / 1.75) ** 2, False, 58.5)],
    ids=["neither default nor rule: given", "default of a body: a guess", "rule by height: a guess"],
)
def test_own_files_that_do_not_say_whether_their_mass_is_given(
    own: Callable[..., Path], mass: float, given: bool, expected: float
) -> None:
    found = read(own(1.6, mass))
    assert found.motion.mass_given is given
    assert found.motion.body.mass == pytest.approx(expected, abs=0.02)
    assert bool(found.mass_guess) is not given
    # Forces stay only where they are those of this mass.
    assert (found.motion.wrenches is None) == (mass == 70.0)


def test_another_mass_removes_the_forces_of_an_own_file(own: Callable[..., Path]) -> None:
    """A motion with forces of 75 kg was written as one of 150 kg with the same forces."""
    found = read(own(1.8, 75.0, given=True), mass=150.0)
    assert (found.motion.body.mass, found.motion.mass_given) == (150.0, True)
    assert (found.motion.torques, found.motion.wrenches) == (None, None)
    assert any(text.startswith("torques, wrenches removed") and "75.0 kg" in text for text in found.warnings)


def test_a_belt_of_an_own_file_is_refused(own: Callable[..., Path]) -> None:
    """`--belt 1.2` was ignored without a word."""
    path = own(1.8, 75.0, given=True)
    with pytest.raises(ConfigError, match=r"belt is 1.2 m/s.*over ground"):
        read(path, belt=1.2)
    assert not read(path, belt=None).belt.any()


def test_height_of_an_own_file(own: Callable[..., Path], clip: Motion) -> None:
    """`--height 1.2` changed the stature of a body, and none of its fitted segments."""
    with pytest.raises(ConfigError, match=r"height is 1.2 m, but the body of 1.80 m is fitted"):
        read(own(1.8, 75.0, given=True, fitted=True), height=1.2)
    assert read(own(1.8, 75.0, given=True, fitted=True), height=1.8).motion.wrenches is not None
    smaller = read(own(1.75, 75.0, given=True), height=1.4, fps=None).motion
    assert (smaller.body, smaller.wrenches) == (Body(1.4, 75.0), None)
    assert forward(smaller).toe == pytest.approx(0.8 * forward(clip).toe, abs=1e-6)
