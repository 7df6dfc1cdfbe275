"""Mass and height of an imported human: as given, else guessed with a warning."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
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
    assert any("mass of" in text and "guessed" in text and "30 %" in text for text in found.warnings)


def test_given_mass_is_taken_without_a_warning(file: Path) -> None:
    found = read(file, mass=61.5)
    assert found.motion.body.mass == 61.5
    assert not any("mass" in text for text in found.warnings)


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


def test_own_files_keep_their_body(tmp_path: Path, clip: Motion) -> None:
    save_motion(clip, tmp_path / "a.npz")
    assert read(tmp_path / "a.npz").motion.body == clip.body
    assert read(tmp_path / "a.npz").warnings == ()
    assert read(tmp_path / "a.npz", mass=80.0).motion.body.mass == 80.0
