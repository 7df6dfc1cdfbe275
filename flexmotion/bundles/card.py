"""The model card of a bundle: what it is, of what data, how it was made, how good it is, what it is not for."""

from __future__ import annotations

from pathlib import Path

from flexmotion.bundles.bundle import Manifest

CARD = "MODEL_CARD.md"


def write_card(folder: Path, manifest: Manifest, hours: float, clips: int, stages: dict[str, tuple[int, dict]]) -> None:
    """Write the card into a bundle's folder.

    Args:
        folder: of the bundle.
        manifest: of the bundle.
        hours, clips: of the training split.
        stages: of the training: name -> step of the best weights, and what they reached on held-out clips.
    """
    window = f"{manifest.history} frames of history, {manifest.future} of future at {manifest.fps:g} fps"
    kind = f"{manifest.steps} steps, distilled" if manifest.guided else f"{manifest.steps} steps, guided"
    lines = [
        f"# Model card: {manifest.name}",
        "",
        manifest.description or "Human motion with joint torques, ground forces and muscle activations, from text.",
        "",
        f"- **Window**: {window}; {kind}; guidance {manifest.guidance:g}.",
        f"- **Human**: {manifest.body.height:g} m, {manifest.body.mass:g} kg, {manifest.body.sex}.",
        f"- **Data**: {clips} clips, {hours:.2f} h, mirror images included; nothing of the held-out split.",
        f"- **Licence**: {manifest.licence}.",
        "  Weights trained on clips for non-commercial use are for non-commercial use.",
        "- **Not for**: motion unlike that of its data (stairs, chairs, contact with others). Its torques and forces",
        "  are estimates of a model trained on estimates, not measurements.",
        "",
        "## Training",
        "",
        "Made by the commands of `docs/model.md`. Best weights of every stage, on held-out clips:",
        "",
        "| stage | step | figures |",
        "|---|---|---|",
    ]
    for name, (step, figures) in stages.items():
        lines.append(f"| {name} | {step} | {', '.join(f'{key} {value:.4g}' for key, value in figures.items())} |")
    versions = ", ".join(f"{name} {version}" for name, version in manifest.versions.items())
    lines += ["", f"Versions: {versions}.", ""]
    (folder / CARD).write_text("\n".join(lines), encoding="utf-8")
