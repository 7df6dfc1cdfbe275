"""The column Time of a TRC file was ignored: forces of a walk at half its speed were written without a word."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.motion import Motion
from flexmotion.importers.trc import read_trc
from flexmotion.importers.trc_times import frame_numbers

from .surface_markers import joint_centres, write_trc

FIRST = 7
"""Line of the first row of `write_trc`."""

Change = Callable[[list[list[str]]], None]


@pytest.fixture
def written(tmp_path: Path, clip: Motion) -> Path:
    return write_trc(tmp_path / "walk.trc", joint_centres(clip[:90]))


def change_rows(path: Path, change: Change) -> None:
    lines = path.read_text().splitlines()
    rows = [line.split("\t") for line in lines[FIRST - 1 :]]
    change(rows)
    path.write_text("\n".join([*lines[: FIRST - 1], *("\t".join(row) for row in rows)]) + "\n")


def set_times(time: Callable[[int, int], float]) -> Change:
    def change(rows: list[list[str]]) -> None:
        for index, row in enumerate(rows):
            row[1] = f"{time(index, len(rows)):.4f}"

    return change


def repeat(rows: list[list[str]]) -> None:
    rows.insert(40, rows[39])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (set_times(lambda i, n: i / 60), r"line 3: DataRate is 30, but from line 7 on Time advances by 0.0166"),
        (set_times(lambda i, n: (n - i) / 30), r"line 8: Time is 2.9\d+ s after 3 s, expected rows 0.033"),
        (set_times(lambda i, n: i / 30 if i < 40 else i / 30 - 1), r"line 47: Time is 0.33\d+ s after 1.3 s"),
        (set_times(lambda i, n: i / 30 if i < 40 else i / 30 + 1e6), r"line 47: Time goes from 1.3 s to 1e\+06 s"),
        (repeat, r"line 47: Time is 1.3 s after 1.3 s"),
        (lambda rows: rows.reverse(), "line 8: Time is"),
    ],
    ids=["twice the rate", "backwards", "back once", "far ahead", "a row twice", "reversed"],
)
def test_times_that_are_not_those_of_the_frames_are_refused(written: Path, change: Change, told: str) -> None:
    """They were imported without a word, with speeds and forces that nobody had."""
    change_rows(written, change)
    with pytest.raises(MotionFormatError, match=f"walk.trc, {told}"):
        read_trc(written)


def test_frames_that_are_left_out_are_gaps(written: Path) -> None:
    """Ten frames that were dropped made a jump, at a third of a second less."""
    whole = read_trc(written)

    def drop(rows: list[list[str]]) -> None:
        del rows[50:60], rows[20]

    change_rows(written, drop)
    found = read_trc(written)
    gone = np.isin(np.arange(90), [20, *range(50, 60)])
    assert len(found) == 90 and np.isnan(found.positions[gone]).all()
    np.testing.assert_array_equal(found.positions[~gone], whole.positions[~gone])
    (told,) = (note for note in found.warnings if "left out" in note)
    assert "line 27: Time goes from 0.6333 s to 0.7 s: frames left out: 1; further such places: 1" in told


@pytest.mark.parametrize("text", ["0", ""])
def test_times_that_do_not_advance_are_told(written: Path, text: str) -> None:
    """Zeros in all rows are of a program that writes no times: nothing contradicts the header."""

    def same(rows: list[list[str]]) -> None:
        for row in rows:
            row[1] = text

    change_rows(written, same)
    found = read_trc(written)
    assert any("Time does not advance, from line 7 on: rows are taken as 0.0333" in n for n in found.warnings)


@pytest.mark.parametrize("fps", [59.94, 60.0, 100.0, 119.88, 120.0, 200.0, 240.0, 1000.0])
@pytest.mark.parametrize("decimals", [2, 3, 4, 6])
def test_rounded_times_are_those_of_the_frames(fps: float, decimals: int) -> None:
    """Laboratories write times in milliseconds, or hundredths of a second."""
    times = np.round(3.7 + np.arange(500) / fps, decimals)
    numbers, notes = frame_numbers("a.trc", times, range(6, 506), fps)
    np.testing.assert_array_equal(numbers, np.arange(500))
    assert not notes


def test_an_uneven_row_is_told() -> None:
    times = np.arange(100) / 30
    times[50:] += 0.4 / 30
    numbers, notes = frame_numbers("a.trc", times, range(6, 106), 30.0)
    assert numbers[-1] == 99 and len(notes) == 1
    assert notes[0].startswith("line 56: Time advances by 0.0466667 s, expected 0.0333333 s; it is taken as 0.03333 s")
