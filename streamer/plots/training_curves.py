"""Picture of a training: the validation of each stage over its steps, and where its best weights are."""

from __future__ import annotations

import json
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import FormatStrFormatter

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.plots.palette import MUTED
from flexmotion.streamer.plots.style import new_figure, save, styled

COLOURS = 10
"""Colours of matplotlib's cycle; further lines are dashed."""

Curve = dict[int, dict[str, float]]
"""Figures of validations by step."""


def read_curve(history: Path) -> Curve:
    """Validations of a stage, in order of step.

    A stage that was resumed from an earlier state has some steps twice; the later one counts.

    Args:
        history: `history.jsonl` of the stage.

    Raises:
        ConfigError: the file is missing, or a line is not that of a validation.
    """
    try:
        lines = history.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ConfigError(f"{history}: {error.strerror}; train the stage first") from error
    found: Curve = {}
    for number, line in enumerate(lines, 1):
        try:
            row = json.loads(line)
            found[int(row["step"])] = {name: float(value) for name, value in row["validation"].items()}
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ConfigError(f"{history}:{number}: not a validation of a stage") from error
    return dict(sorted(found.items()))


def plot_training(curves: dict[str, Curve], path: Path, title: str) -> Path:
    """Write the curves of stages as a PNG, one below the other. Each loss is drawn as a share of its first value.

    Args:
        curves: by the stage's name; none is empty.
        path: of the picture.
        title: of the picture.
    """
    with styled():
        note = "losses on held-out windows, as shares of the first validation; line: the least in all"
        figure = new_figure(9.0, 3.4 * len(curves) + 0.7, title, note)
        for place, (stage, curve) in zip(
            figure.subplots(len(curves), 1, squeeze=False)[:, 0], curves.items(), strict=True
        ):
            _panel(place, stage, curve)
        return save(figure, path)


def _panel(place: Axes, stage: str, curve: Curve) -> None:
    first = curve[next(iter(curve))]
    for number, name in enumerate(first):
        known = [step for step in curve if name in curve[step] and first[name] > 0]
        style = "-" if number < COLOURS else "--"
        place.plot(known, [curve[step][name] / first[name] for step in known], style, label=name)
    place.axvline(least(curve), color=MUTED, linewidth=0.8)
    place.set(title=stage, xlabel="steps", ylabel="share of the first", yscale="log", xlim=(0, None))
    place.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    place.yaxis.set_minor_formatter(FormatStrFormatter("%g"))
    place.tick_params(axis="y", which="minor", labelsize=6)
    place.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))


def least(curve: Curve) -> int:
    """Step of the least loss, whose weights a stage keeps."""
    return min(curve, key=lambda step: curve[step]["loss"])
