"""Does an autoencoder learn forces better from a set with augmented clips?

SET is built with `flexmotion data build --variants N`. Reduced autoencoders are trained on all of its clips, and on the
recorded ones alone, with the same features, steps and seeds. Compared are errors on held-out recorded clips, and on
held-out clips with their variants, for motion unlike the recorded. A run that was stopped continues when it is started
again. Fails where the mean ratio of the errors on recorded clips is above 1.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import geometric_mean
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.model.reduced import mean_ratio, small
from benchmarks.shared.options import CsvOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import ModelConfig, load_model_config
from flexmotion.dataset.compact_set import MotionSet, open_set
from flexmotion.dataset.fields import MUSCLES
from flexmotion.evaluation.interval import Interval
from flexmotion.features.layout import Layout
from flexmotion.training.autoencoder_task import AutoencoderTask
from flexmotion.training.checkpoints import load_weights
from flexmotion.training.feature_store import RECORDED, FeatureStore, build_store
from flexmotion.training.processes import Processes, use_threads
from flexmotion.training.stage import train_stage
from flexmotion.training.window_set import WindowSet

WITH, WITHOUT = "with variants", "without"
HELD_OUT = {"recorded": False, "recorded and varied": True}
"""Held-out clips: whether variants are among them."""

COMPARED = ("points_mm", "torques", "wrenches", "contacts", "joint_contact_bw", "euler_root", "euler_joints")
"""Errors: normalised, but for points [mm] and joint contact [body weights]."""

FORCES = ("torques", "wrenches", "joint_contact_bw", "euler_root", "euler_joints")
"""Errors that the criterion is about."""

WINDOWS = 512
FIGURES = "figures.json"

Rows = Mapping[str, Mapping[str, Sequence[Mapping[str, float]]]]
"""Training -> held-out clips -> figures of each seed."""


def reduced(config: ModelConfig, source: MotionSet, steps: int, width: int, layers: int) -> ModelConfig:
    """The configuration with small networks, and the blocks that the set has; muscle torques are not compared."""
    motion = source.motion(source.clips[0])
    has = {"muscles": motion.activations is not None, "joint_contact": motion.joint_contact is not None}
    network = small(width, layers)
    losses = {"muscle_torques": 0.0, "physics_from": steps // 4}
    stage = config.stages.autoencoder.model_copy(update={"steps": steps, "validate_every": steps})
    return config.model_copy(
        update={
            "window": config.window.model_copy(update=has),
            "autoencoder": config.autoencoder.model_copy(update={"encoder": network, "decoder": network}),
            "losses": config.losses.model_copy(update=losses),
            "stages": config.stages.model_copy(update={"autoencoder": stage}),
        }
    )


def measured(config: ModelConfig, store: FeatureStore, variants: bool, seed: int, folder: Path) -> dict[str, dict]:
    """Train one autoencoder, and measure it on held-out clips."""
    task = AutoencoderTask(config, store if variants else store.without_variants(), seed, Processes())
    train_stage(task, config.stages.autoencoder, folder, fingerprint=config.model_dump_json())
    load_weights(task.network, folder)
    task.network.eval()
    found = {}
    for name, varied in HELD_OUT.items():
        held_out = WindowSet(task.training.store, config.window, "validation", variants=varied)
        windows = held_out.draw((seed, 81), WINDOWS)
        found[name] = {key: value for key, value in task.measure(windows).items() if key in COMPARED}
    return found


def ratio(rows: Rows, held_out: str, name: str) -> float:
    """Mean error with variants over that without."""
    return mean_ratio(rows[WITH][held_out], rows[WITHOUT][held_out], name)


def table(rows: Rows) -> Table:
    """Errors with intervals over the seeds, and their ratio."""
    out = Table("held-out clips", "error", WITHOUT, WITH, "with / without", title="Augmented clips in training")
    for held_out in HELD_OUT:
        for name in rows[WITH][held_out][0]:
            cells = [str(Interval.of([row[name] for row in rows[kind][held_out]])) for kind in (WITHOUT, WITH)]
            out.add_row(held_out, name, *cells, f"{ratio(rows, held_out, name):.3f}")
    return out


def verdict(rows: Rows) -> Verdict:
    """The criterion."""
    names = [name for name in FORCES if name in rows[WITH]["recorded"][0]]
    value = geometric_mean(ratio(rows, "recorded", name) for name in names)
    return Verdict(f"errors of forces on recorded clips, with over without variants: {value:.3f} (<= 1)", value <= 1.0)


def training_hours(store: FeatureStore) -> float:
    """Of the training split, mirror images included."""
    return sum(clip.frames for clip in store.clips if clip.split == "train") / store.layout.fps / 3600


def main(
    data: Annotated[Path, typer.Argument(metavar="SET", help="Training set with variants.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the runs; an unfinished one continues.")],
    seeds: Annotated[int, typer.Option(min=1, help="Of each training.")] = 3,
    steps: Annotated[int, typer.Option(min=4, help="Of each autoencoder.")] = 2000,
    width: Annotated[int, typer.Option(min=4, help="Of the networks.")] = 96,
    layers: Annotated[int, typer.Option(min=1, help="Of each network.")] = 2,
    threads: Annotated[int, typer.Option(min=1, help="Of the CPU.")] = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Train with and without variants, and measure the autoencoders."""
    use_threads(threads)
    source, console = open_set(data), Console(width=160)
    if all(clip.variant in RECORDED for clip in source.clips):
        raise ConfigError(f"{data}: has no variants; build it with --variants")
    config = reduced(load_model_config("stream"), source, steps, width, layers)
    window = config.window
    layout = Layout(window.fps, MUSCLES if window.muscles else 0, joint_contact=window.joint_contact)
    store = build_store(source, layout, out / "features")
    rows: dict[str, dict[str, list[dict[str, float]]]] = {
        kind: {held_out: [] for held_out in HELD_OUT} for kind in (WITHOUT, WITH)
    }
    for seed in range(seeds):
        for kind, found in rows.items():
            folder = out / f"{kind.replace(' ', '-')}-{seed}"
            path = folder / FIGURES
            done = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
            settings = {"steps": steps, "width": width, "layers": layers}
            if done.get("settings") != settings:
                console.print(f"training {folder}")
                done = {"settings": settings, "figures": measured(config, store, kind == WITH, seed, folder)}
                path.write_text(json.dumps(done, indent=1), encoding="utf-8")
            for held_out, figures in done["figures"].items():
                found[held_out].append(figures)
    hours = [training_hours(chosen) for chosen in (store.without_variants(), store)]
    console.print(table(rows))
    console.print(f"autoencoders of {layers} + {layers} layers x {width}, {steps} steps, {seeds} seeds;")
    console.print(f"{hours[0]:.2f} h of recorded clips and mirror images, {hours[1]:.2f} h with variants")
    if csv_out is not None:
        flat = [
            {"training": kind, "held_out": held_out, "seed": seed, **row}
            for kind, found in rows.items()
            for held_out, own in found.items()
            for seed, row in enumerate(own)
        ]
        write_csv(csv_out, flat)
    ratios = {
        held_out: {name: round(ratio(rows, held_out, name), 4) for name in rows[WITH][held_out][0]}
        for held_out in HELD_OUT
    }
    return Outcome([verdict(rows)], {"with_over_without": ratios, "hours": [round(value, 3) for value in hours]})
