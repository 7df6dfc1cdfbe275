"""The page: one file without external resources, verdict first."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.tick_row import blank
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.report.report_page import write_report_page
from flexmotion.streamer.report.summary import verdict


def test_page_is_self_contained(outcome: Outcome, pictures: list[Path], tmp_path: Path) -> None:
    html = write_report_page(tmp_path / "index.html", outcome.report, pictures).read_text(encoding="utf-8")
    assert len(re.findall(r'src="data:image/png;base64,', html)) == len(pictures)
    assert not re.search(r'(src|href)="(?!data:)', html)
    assert "http" not in re.sub(r"base64,[^\"]*", "", html)
    assert html.index("PASS</h1>") < html.index(verdict(outcome.report)) < html.index("<img")
    words = ("leg tracking error", "l_knee", "<h2>Likeness</h2>", "forearms")
    for word in (*words, "prefers-color-scheme: dark", 'name="viewport"'):
        assert word in html


def test_text_from_outside_is_escaped(outcome: Outcome, tmp_path: Path) -> None:
    report = outcome.report.model_copy(update={"source": "<script>alert(1)</script>"})
    html = write_report_page(tmp_path / "index.html", report, []).read_text(encoding="utf-8")
    assert "<script>" not in html


def test_a_run_that_never_had_torque_has_a_page_without_pictures(outcome: Outcome, tmp_path: Path) -> None:
    """A run that was interrupted before its first tick, 0.0 s long, had five pictures of nothing."""
    nothing = RunTrace(outcome.record.rate_hz, outcome.record.joint_names)
    nothing.append(blank(nothing.rows.dtype, 1))
    page = replace(outcome, record=nothing).write(tmp_path)
    assert "<img" not in page.read_text(encoding="utf-8") and not list(tmp_path.glob("*.png"))
