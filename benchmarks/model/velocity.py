"""Does the model go as fast as it is told, where the data have such motion?

    python benchmarks/velocity.py BUNDLE --set SET [--samples 8] [--seconds 4] [--guidance G] [--csv FILE] [--plots DIR]

Every combination of forward, sideways and turning speeds, from standing. A velocity is the mean along and across where
the pelvis faces, and of its turning. Judged are the seconds after the first, in which a body gets going, over commands
that the training windows have: at least as many of them as `--enough` within .15 m/s and .2 rad/s of it. Exits with 1
where the mean error is more than .15 m/s or .2 rad/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from model_rollout import Cue, roll_out
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.transform import Rotation
from verdicts import Verdict, benchmark, write_csv

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.evaluation.interval import Interval
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

FORWARD, SIDEWAYS, TURNING = (0.0, 0.25, 0.5, 0.75, 1.0), (-0.3, 0.0, 0.3), (-1.0, -0.5, 0.0, 0.5, 1.0)
NEAR = np.array([0.15, 0.15, 0.2])
"""Windows within this of a command are such motion [m/s, m/s, rad/s]."""

LIMITS = 0.15, 0.2
SETTLE_S = 1.0
"""Time in which a body gets going."""


@dataclass(frozen=True)
class Row:
    """One command and what came of it.

    Attributes:
        command: forward, left [m/s], turning left [rad/s].
        windows: training windows near it.
        settled: mean velocities of the samples once they go, (N, 3).
        from_rest: likewise, from the first frame on.
    """

    command: tuple[float, float, float]
    windows: int
    settled: Float
    from_rest: Float

    def errors(self, found: Float) -> tuple[Float, Float]:
        """Of every sample: speed [m/s] and turning [rad/s]."""
        apart = found - self.command
        return np.linalg.norm(apart[:, :2], axis=1), np.abs(apart[:, 2])


def frame_velocities(motion: Motion) -> Float:
    """Velocity along and across the heading, and of turning, from frame to frame, (T - 1, 3)."""
    yaw = continuous_matrix_heading(Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_matrix())
    step, turn = np.diff(motion.root_position[:, :2], axis=0) * motion.fps, np.diff(yaw) * motion.fps
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    along = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
    across = np.cos(middle) * step[:, 1] - np.sin(middle) * step[:, 0]
    return np.stack([along, across, turn], axis=1)


def window_velocities(found: MotionSet, seconds: float) -> Float:
    """Mean velocities of windows of the training clips that follow each other, (N, 3)."""
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
    """Commands and what came of them."""
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
    """What was found over what was asked for, one panel a component."""
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
    folder: Annotated[Path, typer.Argument(metavar="BUNDLE", help="Bundle to judge.")],
    data: Annotated[Path, typer.Option("--set", help="Training set.")],
    samples: Annotated[int, typer.Option(min=1, help="Of each command.")] = 8,
    seconds: Annotated[float, typer.Option(min=0.5, help="That are judged.")] = 4.0,
    guidance: Annotated[float | None, typer.Option(help="How strictly it is followed; as live by default.")] = None,
    enough: Annotated[int, typer.Option(min=0, help="Windows from which on the data have a motion.")] = 20,
    steps: Annotated[int | None, typer.Option(help="Of the diffusion; the bundle's own by default.")] = None,
    csv_out: Annotated[Path | None, typer.Option("--csv", help="Write one row a command here.")] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
) -> list[Verdict]:
    """Command velocities and measure what comes of them."""
    sampler = Sampler(Bundle(folder), steps)
    if not sampler.bundle.manifest.velocity:
        raise ConfigError(f"{folder}: this bundle cannot be told a velocity")
    windows = window_velocities(open_set(data), sampler.future / sampler.fps)
    rows = []
    for command in track(list(product(FORWARD, SIDEWAYS, TURNING)), "commands", console=Console(stderr=True)):
        near = int((np.abs(windows - command) <= NEAR).all(axis=1).sum())
        rows.append(run(sampler, Condition(velocity=command, guidance=guidance), samples, seconds, near))
    known = [row for row in rows if row.windows >= enough]
    console = Console(width=160)
    console.print(table(known))
    console.print(f"{len(rows) - len(known)} more commands are not in the data")
    if csv_out is not None:
        write_csv(csv_out, [csv_row(row) for row in rows])
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        draw(rows, enough, plots / "velocity.png")
    if not known:
        return [Verdict(f"commands that the data have: none of {len(rows)}", False)]
    found = []
    for place, (name, unit) in enumerate((("speed", "m/s"), ("turning", "rad/s"))):
        error = Interval.of(np.concatenate([row.errors(row.settled)[place] for row in known]))
        limit = LIMITS[place]
        sentence = f"mean error of {name} over {len(known)} of {len(rows)} commands: {error} {unit} (<= {limit})"
        found.append(Verdict(sentence, error.mean <= limit))
    return found


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


if __name__ == "__main__":
    benchmark(main)
