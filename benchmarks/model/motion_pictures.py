"""How does generated motion look beside real and augmented motion?

Draws strips of figures, one PNG a kind of motion. Real is a held-out clip, augmented a variant of a training clip (its
mirror image where the set has no others), generated is sampled from standing. Arrows are ground reaction forces; a
body weight is as long as a leg. With `--videos` the same motions are filmed side by side, the simulated robot that
follows the prompt beside them, one MP4 a kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from benchmarks.model.real_clips import real_clips
from benchmarks.model.roll_out import always, roll_out
from benchmarks.robot.model_run import follow
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleArgument, SetOption, StepsOption
from benchmarks.shared.outcome import Outcome
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.plots.filmstrip import limbs
from flexmotion.streamer.plots.palette import MUTED, WARN
from flexmotion.streamer.plots.solid import Camera
from flexmotion.streamer.plots.style import new_figure, save, styled
from flexmotion.streamer.plots.video import HumanScene, RobotScene, Scene, check_video, write_video
from flexmotion.text.phrases import wordings

KINDS = ("walk", "walk-turn-left", "run", "wave-right-hand", "raise-up-both-hands", "bow")
FIGURES = 9
SECONDS = 3.0
SPACING = 0.72
"""Distance between neighbouring figures, in heights of the human."""

LEAST_FORCE = 0.05
"""Smallest force that is drawn [body weights]."""

AZIMUTH_DEG, ELEVATION_DEG = -55.0, 12.0


@dataclass(frozen=True)
class Strip:
    """A motion and its title."""

    title: str
    motion: Motion


def middle(motion: Motion) -> Motion:
    """The `SECONDS` in the middle of a motion, or all of a shorter one."""
    frames = round(SECONDS * motion.fps)
    first = max(0, (len(motion) - frames) // 2)
    return motion[first : first + frames]


def example(found: MotionSet, kind: str, split: str, variant: str, fps: float, seed: int) -> Motion | None:
    """The middle of one clip of a kind; None where there is no such clip."""
    clips = [motion for _, motion in real_clips(found, split, fps, variant=variant, kinds=(kind,))]
    return middle(clips[np.random.default_rng(seed).integers(len(clips))]) if clips else None


def strips(sampler: Sampler, found: MotionSet, kind: str, seed: int) -> list[Strip]:
    """Strips of one kind of motion, as far as the set has it."""
    prompt, frames = wordings(kind)[0], round(SECONDS * sampler.fps)
    generated = roll_out(sampler, always(prompt), SECONDS + 1.0, seed).motion[-frames:]
    augmented = "varied" if any(True for _ in found.select("train", "varied")) else "mirror"
    candidates = [
        ("real (held out)", example(found, kind, "validation", "original", sampler.fps, seed)),
        (f"augmented ({augmented})", example(found, kind, "train", augmented, sampler.fps, seed)),
        (f"generated: “{prompt}”", generated),
    ]
    return [Strip(title, motion) for title, motion in candidates if motion is not None]


def draw(kind: str, rows: list[Strip]) -> Figure:
    """The strips of one kind, one below the other."""
    figure = new_figure(
        11,
        0.6 + 1.95 * len(rows),
        f"{kind}: real, augmented, generated",
        "left is blue, right orange; each figure centred on itself; red: ground reaction force",
    )
    for axes, row in zip(np.atleast_1d(figure.subplots(len(rows), 1)), rows, strict=True):
        draw_strip(axes, row)
    return figure


def draw_strip(axes: Axes, row: Strip) -> None:
    """A strip of figures, with the ground reaction forces."""
    motion, camera = row.motion, Camera.at(AZIMUTH_DEG, ELEVATION_DEG)
    height, weight = motion.body.height, motion.body.mass * GRAVITY
    for place, frame in enumerate(np.linspace(0, len(motion) - 1, FIGURES).round().astype(int)):
        pose = forward(motion[frame : frame + 1])
        centre, offset = pose.pelvis_position[0] * [1.0, 1.0, 0.0], np.array([place * SPACING * height, 0.0])
        for points, colour in limbs(pose):
            line = camera.project(points - centre)[:, :2] + offset
            axes.add_collection(LineCollection([line], colors=colour, linewidths=2.2, capstyle="round", zorder=3))
        if motion.wrenches is not None:
            for side in range(2):
                force = motion.wrenches[frame, side, :3] / weight * motion.body.leg
                if np.linalg.norm(force) < LEAST_FORCE * motion.body.leg:
                    continue
                arrow = np.stack([pose.ankle[0, side] * [1.0, 1.0, 0.0], pose.ankle[0, side] * [1.0, 1.0, 0.0] + force])
                start, end = camera.project(arrow - centre)[:, :2] + offset
                axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": WARN, "linewidth": 1.0})
        label = f"{frame / motion.fps:.1f} s"
        axes.text(offset[0], -0.14 * height, label, ha="center", va="top", color=MUTED, fontsize=8)
    axes.set(xlim=(-0.45 * height, ((FIGURES - 1) * SPACING + 0.45) * height), ylim=(-0.28 * height, 1.05 * height))
    axes.set_title(row.title)
    axes.set_aspect("equal")
    axes.set_axis_off()


def main(
    data: SetOption,
    plots: Annotated[Path, typer.Option(help="Folder for the pictures.")],
    bundle: BundleArgument = None,
    kind: Annotated[list[str] | None, typer.Option(help="Kind of motion; may be given again.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the choice of clips and of the samples.")] = 0,
    videos: Annotated[
        bool, typer.Option("--videos", help="Film them too, and the robot; needs the extra video.")
    ] = False,
    steps: StepsOption = None,
) -> Outcome:
    """Draw real, augmented and generated motion side by side."""
    if videos:
        check_video()
    sampler, found = open_sampler(bundle, steps), open_set(data)
    followed = open_sampler(bundle, steps, balanced=False) if videos else sampler
    plots.mkdir(parents=True, exist_ok=True)
    for name in kind or KINDS:
        if not wordings(name):
            raise ConfigError(f"kind {name!r} has no wordings; see flexmotion/data/phrases.yaml")
        rows = strips(sampler, found, name, seed)
        with styled():
            print(save(draw(name, rows), plots / f"motion_{name}.png"))
        if videos:
            print(film(name, rows, followed, seed, plots / f"motion_{name}.mp4"))
    return Outcome()


def film(kind: str, rows: list[Strip], sampler: Sampler, seed: int, path: Path) -> Path:
    """The motions of a kind side by side, and the robot that follows the prompt."""
    robot, prompt = load_robot("op3"), wordings(kind)[0]
    pace, items = human_pace(robot, sampler.body), [Item(0.0, Text(prompt))]
    source = ModelSource(sampler, items, f"prompt:{prompt}", seed, SECONDS + 1.0, pace)
    record = follow(robot, source, perturbed=False, seed=seed, mass_kg=0.0).record
    begin = float(record.time_s[np.flatnonzero(np.isfinite(record.source_s[: record.used]))[0]])
    panels: list[tuple[str, Scene]] = []
    panels.extend((row.title, HumanScene(row.motion)) for row in rows)
    panels.append((f"OP3: “{prompt}”", RobotScene(record, robot, begin)))
    return write_video(path, panels, SECONDS)
