"""Films of human and robot, read back with the real decoder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import FilmError
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import blank
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.plots.video import FPS, HumanScene, RobotScene, film_run, source_clock, write_video
from flexmotion.streamer.report.report_page import write_report_page

imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="films need the extra 'video'")


def frames(path: Path) -> np.ndarray:
    reader = imageio_ffmpeg.read_frames(str(path))
    size = next(reader)["size"]
    return np.stack([np.frombuffer(part, np.uint8).reshape(size[1], size[0], 3) for part in reader])


def test_both_are_seen_to_move_side_by_side(outcome: Outcome, tmp_path: Path) -> None:
    assert outcome.motion is not None
    record = outcome.record
    begin = float(record.time_s[np.flatnonzero(np.isfinite(record.source_s[: record.used]))[0]])
    panels = [
        ("human", HumanScene(outcome.motion, source_clock(outcome.record, begin))),
        ("robot", RobotScene(outcome.record, outcome.robot, begin)),
    ]
    found = frames(write_video(tmp_path / "film.mp4", panels, 1.5))
    assert len(found) == round(1.5 * FPS)
    half = found.shape[2] // 2
    for panel in (found[:, :, :half], found[:, :, half:]):
        drawn = panel.min(axis=3) < 200
        assert drawn.any(axis=(1, 2)).all()
        assert (drawn[0] != drawn[-1]).sum() > 0.02 * drawn[0].sum()


@pytest.fixture(scope="module")
def short(outcome: Outcome) -> Outcome:
    """A second of the run, in which the robot follows: drawing a film takes a second for each of its own."""
    whole = outcome.record
    record = RunTrace(whole.rate_hz, whole.joint_names)
    first = int(np.flatnonzero(np.isfinite(whole.source_s[: whole.used]))[0])
    record.append(whole.rows[first : first + round(whole.rate_hz)])
    return replace(outcome, record=record)


def test_the_report_shows_the_film(short: Outcome, tmp_path: Path) -> None:
    page = short.write(tmp_path, video=True).read_text(encoding="utf-8")
    assert (tmp_path / "motion.mp4").stat().st_size > 1000
    assert page.count("<video") == 1 and "data:video/mp4;base64," in page


def test_a_report_without_film_has_no_place_for_it(outcome: Outcome, pictures: list[Path], tmp_path: Path) -> None:
    page = write_report_page(tmp_path / "index.html", outcome.report, pictures).read_text(encoding="utf-8")
    assert "<video" not in page


def test_a_run_of_which_no_pose_is_known_is_not_filmed_and_keeps_its_report(outcome: Outcome, tmp_path: Path) -> None:
    blind = RunTrace(outcome.record.rate_hz, outcome.record.joint_names)
    blind.append(blank(blind.rows.dtype, 50))
    assert film_run(tmp_path / "film.mp4", blind, outcome.robot, outcome.motion) is None
    page = replace(outcome, record=blind).write(tmp_path, video=True)
    assert page.is_file() and "<video" not in page.read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="known pose"):
        RobotScene(blind, outcome.robot)


def test_a_film_that_cannot_be_written_leaves_the_report(short: Outcome, tmp_path: Path) -> None:
    """The page was written after the film, and lost with it; a film of an earlier run was taken for this one's."""
    (tmp_path / "motion.mp4").write_bytes(b"an earlier run")
    (tmp_path / "motion.part.mp4").symlink_to("/dev/full")
    with pytest.raises(FilmError, match="motion.mp4"):
        short.write(tmp_path, video=True)
    assert (tmp_path / "index.html").is_file() and not (tmp_path / "motion.mp4").exists()


def test_a_human_waits_before_its_source_plays_and_stays_after_it(outcome: Outcome) -> None:
    record = outcome.record
    played = np.flatnonzero(np.isfinite(record.source_s[: record.used]))
    clock = source_clock(record, 0.0)
    assert clock(record.time_s[0]) == record.source_s[played[0]]
    assert clock(record.time_s[record.used - 1] + 9.0) == record.source_s[played[-1]]
