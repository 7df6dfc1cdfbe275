"""One self-contained HTML page of a run: verdict, figures and pictures. It needs no network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from flexmotion.streamer.report.report import Report
from flexmotion.streamer.report.summary import (
    asked_rows,
    joint_rows,
    likeness_rows,
    likeness_words,
    motion_rows,
    motion_title,
    timing_rows,
    torque_note,
    verdict,
)

CAPTIONS = {
    "robot": "Human and robot",
    "footsteps": "Footsteps",
    "timeline": "Timeline",
    "tracking": "Tracking",
    "torque": "Torque",
    "effort": "The human's effort beside the robot's",
}


def write_report_page(file: Path, report: Report, pictures: Sequence[Path], film: Path | None = None) -> Path:
    """Write the page with its pictures embedded, each titled by its file's stem, and a film; returns its path."""
    environment = Environment(
        loader=PackageLoader("flexmotion.streamer.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    html = environment.get_template("report.html").render(
        report=report,
        verdict=verdict(report),
        likeness=likeness_rows(report),
        likeness_words=likeness_words(report),
        motion=motion_rows(report),
        motion_title=motion_title(report),
        asked=asked_rows(report),
        joints=joint_rows(report),
        torque_note=torque_note(report),
        timing=timing_rows(report),
        pictures=[(CAPTIONS.get(picture.stem, picture.stem), _embedded(picture)) for picture in pictures],
        film=None if film is None else _embedded(film),
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(html, encoding="utf-8")
    return file


def _embedded(file: Path) -> str:
    return base64.b64encode(file.read_bytes()).decode("ascii")
