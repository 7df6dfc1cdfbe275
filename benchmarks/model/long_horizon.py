"""Does generated motion stay plausible for minutes, with a new prompt every few seconds?

Prints figures of roll-outs beside those of held-out clips of the same kinds. Heights are of heels and toes, jerk is of
the body's points. Fails where a roll-out is not finite, a body freezes after a prompt to move, a foot in contact is
farther than 3 cm from the floor (in more than 2 % of its frames), or the jerk at joins is more than 1.5 times the jerk
within windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.model.real_clips import real_clips
from benchmarks.model.roll_out import Cue, RollOut, roll_out
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, CsvOption, PlotsOption, SetOption, StepsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError
from flexmotion.dataset.compact_set import open_set
from flexmotion.evaluation.interval import Interval
from flexmotion.evaluation.motions import foot_metrics, jerk
from flexmotion.features.encode import body_points
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler

Float = NDArray[np.float64]

PROMPTS: dict[str, bool] = {
    "walk forward": True,
    "walk backward": True,
    "turn left": True,
    "turn right": True,
    "run": True,
    "step to the left": True,
    "wave with the right hand": True,
    "wave with the left hand": True,
    "wave with both hands": True,
    "raise the right hand": False,
    "bow": False,
    "stand still": False,
}
"""Prompts, and whether a body that follows them moves all the time."""

NOTICE_S = 1.0
"""Time until the motion follows a new prompt [s]."""

FROZEN = 0.1
"""A body whose fastest point is slower than this is frozen [m/s]; standing people sway at about .03."""

NEAR_FLOOR, NEAR_SHARE = 0.03, 0.98
"""Feet in contact are nearer to the floor than this [m] in this share of their frames; of held-out clips in 99 %."""

JOIN_JERK = 1.5
THIRD = 3
"""Frames that a third difference reaches beyond its first one."""

MEAN_S = 10.0
AROUND = 12
"""Frames before and after a join that are drawn."""


@dataclass(frozen=True)
class Figures:
    """Of one roll-out or clip.

    Attributes:
        values: by name.
        heights: of feet in contact over the floor [m].
    """

    values: dict[str, float]
    heights: Float


@dataclass(frozen=True)
class Run:
    """One roll-out and its prompts, in order."""

    texts: tuple[str, ...]
    made: RollOut


def prompts(seed: int, seconds: float, every: float) -> tuple[str, ...]:
    """Prompts of one roll-out, never the same twice in a row."""
    rng, chosen = np.random.default_rng(seed), [""]
    while len(chosen) <= int(np.ceil(seconds / every)):
        chosen.append(str(rng.choice([text for text in PROMPTS if text != chosen[-1]])))
    return tuple(chosen[1:])


def common_figures(motion: Motion) -> Figures:
    """Figures that roll-outs and real clips have in common."""
    human = forward(motion)
    height = np.minimum(human.heel[..., 2], human.toe[..., 2])
    contacts = motion.contacts if motion.contacts is not None else np.zeros_like(height, np.bool_)
    values = {"supported": float(contacts.any(axis=1).mean()), "jerk": float(jerk(motion).mean())}
    return Figures(foot_metrics(motion) | values, height[contacts])


def figures(run: Run, every: float) -> Figures:
    """Figures of a roll-out."""
    motion, joins = run.made.motion, run.made.joins
    found = common_figures(motion)
    change = jerk(motion)
    at_join, at_cue = spanning(len(change), joins[~run.made.cued]), spanning(len(change), joins[run.made.cued])
    values = found.values | {
        "jerk_within": float(change[~(at_join | at_cue)].mean()),
        "jerk_at_joins": float(change[at_join].mean()),
        "jerk_at_prompts": float(change[at_cue].mean()),
        "frozen": frozen_share(run, every),
    }
    return Figures(values, found.heights)


def spanning(frames: int, joins: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which third differences, (frames,), reach across a join."""
    marked = np.zeros(frames, np.bool_)
    for back in range(1, THIRD + 1):
        rows = joins - back
        marked[rows[(rows >= 0) & (rows < frames)]] = True
    return marked


def frozen_share(run: Run, every: float) -> float:
    """Share of the prompts to move during which no point of the body does."""
    motion = run.made.motion
    speed = np.linalg.norm(np.diff(body_points(forward(motion)), axis=0), axis=-1) * motion.fps
    frozen = []
    for number, text in enumerate(run.texts):
        first, last = ((number * every + NOTICE_S) * motion.fps, (number + 1) * every * motion.fps)
        part = speed[round(first) : round(last)]
        if PROMPTS[text] and len(part):
            frozen.append(part.mean(axis=0).max() < FROZEN)
    return float(np.mean(frozen)) if frozen else 0.0


def rolled_out(sampler: Sampler, runs: int, seconds: float, every: float) -> tuple[list[Run], int]:
    """Finite roll-outs, and the number of those that were not."""
    found, failed = [], 0
    for seed in track(range(runs), "roll-outs", console=Console(stderr=True)):
        texts = prompts(seed, seconds, every)
        cues = [Cue(number * every, Condition(text)) for number, text in enumerate(texts)]
        try:
            found.append(Run(texts, roll_out(sampler, cues, seconds, seed)))
        except ValueError:
            failed += 1
    return found, failed


def table(model: Sequence[Figures], real: Sequence[Figures]) -> Table:
    """Figures of the model beside those of real clips."""
    out = Table("figure", "model", "real clips", title="Roll-outs")
    names = list(dict.fromkeys([*model[0].values, *real[0].values]))
    for name in names:
        cells = (Interval.of([row.values[name] for row in rows if name in row.values]) for rows in (model, real))
        out.add_row(name, *("-" if np.isnan(cell.mean) else str(cell) for cell in cells))
    for share in (0.5, 0.95, 0.99):
        heights = (np.abs(np.concatenate([row.heights for row in rows])) for rows in (model, real))
        quantiles = [f"{1e3 * np.quantile(own, share):.1f}" if len(own) else "-" for own in heights]
        out.add_row(f"height in contact, {100 * share:.0f} % below, mm", *quantiles)
    out.add_row("in contact within 3 cm of the floor", *(f"{100 * near_share(rows):.2f} %" for rows in (model, real)))
    return out


def near_share(rows: Sequence[Figures]) -> float:
    """Share of the frames of feet in contact that are near the floor."""
    heights = np.concatenate([row.heights for row in rows])
    return float((np.abs(heights) <= NEAR_FLOOR).mean()) if len(heights) else 0.0


def verdicts(model: Sequence[Figures], failed: int) -> list[Verdict]:
    """The criteria."""
    frozen = float(np.mean([row.values["frozen"] for row in model]))
    near = near_share(model)
    join, within = (np.mean([row.values[name] for row in model]) for name in ("jerk_at_joins", "jerk_within"))
    ratio = float(join / within)
    return [
        Verdict(f"roll-outs that are not finite: {failed} (0)", failed == 0),
        Verdict(f"prompts to move that froze: {100 * frozen:.1f} % (0)", frozen == 0),
        Verdict(f"feet in contact within 3 cm of the floor: {100 * near:.2f} % (>= 98 %)", near >= NEAR_SHARE),
        Verdict(f"jerk at joins over that within windows: {ratio:.2f} (<= {JOIN_JERK})", ratio <= JOIN_JERK),
    ]


def draw(runs: Sequence[Run], path: Path) -> None:
    """Jerk around the joins, speed over the minutes, and the paths of the first roll-outs."""
    from flexmotion.streamer.plots.palette import LEFT, MIDDLE, RIGHT
    from flexmotion.streamer.plots.style import new_figure, save, styled

    with styled():
        figure = new_figure(11, 3.8, "Roll-outs", "jerk around joins; speed of the body over time; paths from above")
        joins, speeds, paths = figure.subplots(1, 3)
        for cued, colour, name in ((False, LEFT, "same prompt"), (True, RIGHT, "new prompt")):
            rows = [around(run.made, cued) for run in runs]
            joins.plot(np.arange(-AROUND, AROUND), np.concatenate(rows).mean(axis=0), color=colour, label=name)
        joins.axvspan(-THIRD, -1, color=MIDDLE, alpha=0.15, linewidth=0)
        joins.set(xlabel="frames from the join", ylabel="jerk [m/s³]", ylim=(0, None))
        joins.legend()
        for run in runs:
            motion = run.made.motion
            travel = np.linalg.norm(np.diff(motion.root_position, axis=0), axis=1) * motion.fps
            length = round(MEAN_S * motion.fps)
            means = travel[: len(travel) // length * length].reshape(-1, length).mean(axis=1)
            speeds.plot((np.arange(len(means)) + 0.5) * MEAN_S, means, color=LEFT, alpha=0.4)
        speeds.set(xlabel="time [s]", ylabel=f"root speed, means of {MEAN_S:g} s [m/s]", ylim=(0, None))
        for run in runs[:6]:
            paths.plot(*run.made.motion.root_position[:, :2].T)
        paths.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        save(figure, path)


def around(made: RollOut, cued: bool) -> Float:
    """Jerk around the joins of one kind, (joins, 2 AROUND)."""
    change = jerk(made.motion)
    joins = made.joins[made.cued == cued]
    joins = joins[(joins >= AROUND) & (joins <= len(change) - AROUND)]
    return change[joins[:, None] + np.arange(-AROUND, AROUND)]


def main(
    data: SetOption,
    bundle: BundleArgument = None,
    runs: Annotated[int, typer.Option(min=1, help="Number of roll-outs.")] = 20,
    seconds: Annotated[float, typer.Option(min=1.0, help="Length of a roll-out [s].")] = 120.0,
    every: Annotated[float, typer.Option(min=0.1, help="Time between prompts [s].")] = 4.0,
    steps: StepsOption = None,
    csv_out: CsvOption = None,
    plots: PlotsOption = None,
) -> Outcome:
    """Roll out for minutes with changing prompts, and judge the motion."""
    sampler = open_sampler(bundle, steps)
    found, failed = rolled_out(sampler, runs, seconds, every)
    if not found:
        return Outcome([Verdict(f"roll-outs that are not finite: all {failed} (0)", False)])
    kinds = {sampler.prompt(text).kind for text in PROMPTS}
    clips = real_clips(open_set(data), "validation", sampler.fps, kinds=kinds)
    real = [common_figures(motion) for _, motion in clips]
    if not real:
        raise ConfigError(f"{data}: no held-out clips of the kinds of motion that are prompted")
    model = [figures(run, every) for run in found]
    Console(width=160).print(table(model, real))
    if csv_out is not None:
        write_csv(csv_out, [row.values for row in model])
    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)
        draw(found, plots / "long_horizon.png")
    means = {name: float(np.mean([row.values[name] for row in model])) for name in model[0].values}
    return Outcome(verdicts(model, failed), means | {"near_floor": near_share(model), "not_finite": failed})
