"""The page: one file without external resources, verdict first."""

from __future__ import annotations

import re
from pathlib import Path

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
