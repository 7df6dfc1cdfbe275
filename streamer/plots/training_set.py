"""Plots of a training set: distributions of its modalities, and one clip in full."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from flexmotion.dataset.training_set import TrainingSet
from flexmotion.spatial.gravity import GRAVITY

STEP = 10
"""Distributions use every `STEP`-th frame."""


def plot_set(found: TrainingSet, folder: Path) -> list[Path]:
    """Write `distributions.png` and `clip.png`; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / "distributions.png", folder / "clip.png"]
    _distributions(found, paths[0])
    _clip(found, paths[1])
    return paths


def _distributions(found: TrainingSet, path: Path) -> None:
    names = [name for name, field in found.manifest["fields"].items() if field["dtype"] != "bool"]
    columns = 3
    rows = -(-len(names) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(12, 2.6 * rows), layout="constrained", squeeze=False)
    for place, name in zip(axes.ravel(), names, strict=False):
        values = np.asarray(found[name][::STEP], np.float64).ravel()
        low, high = np.quantile(values, [0.001, 0.999]) if values.size else (0.0, 1.0)
        place.hist(values, bins=80, range=(low, max(high, low + 1e-9)), log=True)
        place.set_title(name)
        place.set_xlabel(found.manifest["fields"][name]["unit"])
        place.set_ylabel("values")
        place.locator_params(axis="x", nbins=5)
    for place in axes.ravel()[len(names) :]:
        place.axis("off")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _clip(found: TrainingSet, path: Path) -> None:
    """The longest clip: vertical ground forces, leg torques, residual, activations."""
    clip = max(found.clips, key=lambda item: item.frames)
    times = np.arange(clip.frames) / clip.fps
    joints = found.manifest["joints"]
    legs = [6 + joints.index(f"{name}_r") for name in ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")]
    forces = found["wrenches"][clip.rows][:, :, 2]
    panels = [
        ("vertical ground force,\nstandard error [N]", forces, ("left foot", "right foot")),
        ("right leg [N·m]", found["torques"][clip.rows][:, legs], ("hip flexion", "knee flexion", "ankle")),
        ("residual", found["residual"][clip.rows], ("force [body weights]", "moment [body weights x m]")),
    ]
    muscles = "activations" in found.manifest["fields"]
    figure, axes = plt.subplots(len(panels) + muscles, 1, figsize=(11, 9), sharex=True, layout="constrained")
    for place, (title, values, names) in zip(axes, panels, strict=False):
        lines = place.plot(times, values, label=names)
        if values is forces and "force_error" in found.manifest["fields"]:
            error = found["force_error"][clip.rows] * clip.body.mass * GRAVITY
            for line, middle, width in zip(lines, forces.T, error.T, strict=True):
                place.fill_between(times, middle - width, middle + width, color=line.get_color(), alpha=0.25, lw=0)
        place.set_ylabel(title)
        place.legend(loc="upper right", ncols=len(names), fontsize="small")
        place.grid(alpha=0.3)
    if muscles:
        picture = np.asarray(found["activations"][clip.rows], np.float64).T
        shown = axes[-1].imshow(picture, aspect="auto", extent=(0, times[-1], len(picture), 0), vmin=0, vmax=1)
        axes[-1].set_ylabel("muscle: legs, then trunk")
        figure.colorbar(shown, ax=axes[-1], label="activation")
    figure.suptitle(clip.name)
    figure.supxlabel("time [s]")
    figure.savefig(path, dpi=100)
    plt.close(figure)
