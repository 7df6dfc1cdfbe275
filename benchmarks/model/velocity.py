"""Does the model follow a commanded velocity where the training data have such motion?

Every combination of forward, sideways and turning speeds, from standing. A velocity is the mean along and across the
heading of the pelvis, and of its turning. Judged are the seconds after the first one, in which the body speeds up, over
commands near the training windows: `--enough` of them within .15 m/s and .2 rad/s. Fails where the mean error is more
than .15 m/s or .2 rad/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.roll_out import Cue, roll_out
from benchmarks.shared.judges import frame_velocities
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, PlotsOption, SetOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.evaluation.interval import Interval
from flexmotion.sampling.sampler import Condition, Sampler

Float = NDArray[np.float64]

FORWARD, SIDEWAYS, TURNING = (0.0, 0.25, 0.5, 0.75, 1.0), (-0.3, 0.0, 0.3), (-1.0, -0.5, 0.0, 0.5, 1.0)
NEAR = np.array([0.15, 0.15, 0.2])
"""Windows within this of a command count as such motion [m/s, m/s, rad/s]."""

LIMITS = 0.15, 0.2
SETTLE_S = 1.0
"""Time in which a body speeds up [s]."""


@dataclass(frozen=True)
class Row:
    """One command and the motion that followed it.

    Attributes:
        command: forward, left [m/s], turning left [rad/s].
        windows: training windows near it.
        settled: mean velocities of the samples after the first seconds, (N, 3).
        from_rest: likewise, from the first frame on, (N, 3).
    """

    command: tuple[float, float, float]
    windows: int
    settled: Float
    from_rest: Float

    def errors(self, found: Float) -> tuple[Float, Float]:
        """Of every sample: speed [m/s] and turning [rad/s]."""
        apart = found - self.command
        return np.linalg.norm(apart[:, :2], axis=1), np.abs(apart[:, 2])


def window_velocities(found: MotionSet, seconds: float) -> Float:
    """Mean velocities of consecutive windows of the training clips, (N, 3)."""
    rows = [np.zeros((0, 3))]
    for clip in found.select("train"):
        length = round(seconds * clip.fps)
        if clip.frames > length:
            velocity = frame_velocities(found.motion(clip))
            count = len(velocity) // length
            rows.append(velocity[: count * length].reshape(count, length, 3).mean(axis=1))
    return np.concatenate(rows)


def run(sampler: Sampler, condition: Condition, samples: int, seconds: float, near: int) -> Row:
    """All samples of a commanded velocity."""
    settled, from_rest = [], []
    for seed in range(samples):
        motion = roll_out(sampler, [Cue(0.0, condition)], SETTLE_S + seconds, seed).motion
        velocity = frame_velocities(motion)
        length = round(seconds * sampler.fps)
        from_rest.append(velocity[:length].mean(axis=0))
        settled.append(velocity[-length:].mean(axis=0))
    assert condition.velocity is not None
    return Row(condition.velocity, near, np.array(settled), np.array(from_rest))


def table(rows: Sequence[Row]) -> Table:
    """Commands and the velocities that were found."""
    out = Table(title="Commanded velocity: forward, left (m/s), turning left (rad/s)")
    for name in ("command", "windows", "found", "speed error", "turning error", "errors from rest on"):
        out.add_column(name, justify="right")
    for row in rows:
        speed, turning = row.errors(row.settled)
        rest = row.errors(row.from_rest)
        out.add_row(
            " ".join(f"{value:5.2f}" for value in row.command),
            str(row.windows),
            " ".join(f"{value:5.2f}" for value in row.settled.mean(axis=0)),
            str(Interval.of(speed)),
            str(Interval.of(turning)),
            f"{rest[0].mean():.2f} {rest[1].mean():.2f}",
        )
    return out


def draw(rows: Sequence[Row], enough: int, path: Path) -> None:
    """Found velocities over commanded ones, one panel a component."""
    from flexmotion.streamer.plots.palette import LEFT, MUTED
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(11, 4.0, "Velocity", "found over commanded; grey: the data have no such motion")
        titles = ("forward [m/s]", "left [m/s]", "turning left [rad/s]")
        for place, (axes, title) in enumerate(zip(figure.subplots(1, 3), titles, strict=True)):
            limits = [row.command[place] for row in rows]
            axes.plot([min(limits), max(limits)], [min(limits), max(limits)], color=MUTED, linewidth=0.8)
            for row in rows:
                known = row.windows >= enough
                at = np.full(len(row.settled), row.command[place])
                style = {"color": LEFT if known else MUTED, "alpha": 0.4 if known else 0.15, "linewidths": 0}
                axes.scatter(at, row.settled[:, place], s=12, **style)
            axes.set(title=title, xlabel="commanded", ylabel="found")
        save(figure, path)


def main(
    data: SetOption,
    bundle: BundleArgument = None,
    samples: Annotated[int, typer.Option(min=1, help="Of each command.")] = 8,
    seconds: Annotated[float, typer.Option(min=0.5, help="Length of the judged motion [s].")] = 4.0,
    guidance: Annotated[float | None, typer.Option(help="Guidance scale; default: that of the live system.")] = None,
    enough: Annotated[int, typer.Option(min=0, help="Training windows near a command that is judged.")] = 20,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
    plots: PlotsOption = None,
) -> Outcome:
    """Command velocities and measure the motion."""
    sampler = open_sampler(bundle, steps)
    if not sampler.bundle.manifest.velocity:
        raise ConfigError(f"{sampler.bundle.folder}: this bundle does not follow velocities")
    windows = window_velocities(open_set(data), sampler.future / sampler.fps)
    rows = []
    for command in track(list(product(FORWARD, SIDEWAYS, TURNING)), "commands", console=Console(stderr=True)):
        near = int((np.abs(windows - command) <= NEAR).all(axis=1).sum())
        rows.append(run(sampler, Condition(velocity=command, guidance=guidance), samples, seconds, near))
    known = [row for row in rows if row.windows >= enough]
    console = Console(width=160)
    console.print(table(known))
    console.print(f"{len(rows) - len(known)} more commands are not near the data")
    if csv_out is not None:
        write_csv(csv_out, [csv_row(row) for row in rows])
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        draw(rows, enough, plots / "velocity.png")
    if not known:
        return Outcome([Verdict(f"commands near the data: none of {len(rows)}", False)])
    verdicts, figures = [], {"commands": float(len(known)), "of": float(len(rows))}
    for place, (name, unit) in enumerate((("speed", "m/s"), ("turning", "rad/s"))):
        error = Interval.of(np.concatenate([row.errors(row.settled)[place] for row in known]))
        limit = LIMITS[place]
        sentence = f"mean error of {name} over {len(known)} of {len(rows)} commands: {error} {unit} (<= {limit})"
        verdicts.append(Verdict(sentence, error.mean <= limit))
        figures[f"{name}_error"] = error.mean
    return Outcome(verdicts, figures)


def csv_row(row: Row) -> dict[str, float]:
    """One command's figures."""
    names = ("forward", "left", "turning")
    (speed, turning), mean = row.errors(row.settled), row.settled.mean(axis=0)
    return {
        **dict(zip(names, row.command, strict=True)),
        "windows": row.windows,
        **{f"found_{name}": float(value) for name, value in zip(names, mean, strict=True)},
        "speed_error": float(speed.mean()),
        "turning_error": float(turning.mean()),
    }
