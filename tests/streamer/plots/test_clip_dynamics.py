"""The page of `data dynamics`."""

from __future__ import annotations

from flexmotion.biomechanics.analysis import analyse
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.plots.clip_dynamics import draw_dynamics
from flexmotion.streamer.plots.style import styled


def test_title_and_subtitle_fit_on_the_page() -> None:
    """The end of the subtitle, what grey means, was cut off at the edge of the page."""
    with styled():
        figure = draw_dynamics(analyse(default_clip()[:40], muscles=False))
        figure.draw_without_rendering()
        page, top = figure.bbox, max(axes.get_tightbbox().y1 for axes in figure.axes)
        for text in figure.texts:
            extent = text.get_window_extent()
            assert extent.x0 >= 0 and extent.x1 <= page.width, text.get_text()
            assert "grey" not in text.get_text() or extent.y0 >= top
