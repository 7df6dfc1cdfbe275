"""Model card of a bundle: content, data, training, corrections, figures, and limits of use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexmotion.bundles.manifest import Manifest

CARD = "MODEL_CARD.md"
FIGURES = "## Figures"


@dataclass(frozen=True)
class Trained:
    """Result of one training stage.

    Attributes:
        steps, processes, batch: of the training; the batch is that of each process.
        best: step of the best weights.
        figures: of these weights, on held-out clips.
    """

    steps: int
    processes: int
    batch: int
    best: int
    figures: Mapping[str, float]


@dataclass(frozen=True)
class Making:
    """Training of a bundle.

    Attributes:
        config: name of the configuration.
        hours, clips: of the training split.
        seed: of everything.
        stages: name -> result, in order.
        begun: release that the training began from; empty for none.
    """

    config: str
    hours: float
    clips: int
    seed: int
    stages: Mapping[str, Trained]
    begun: str = ""

    def commands(self, *, corrected: bool, eight_bits: bool = False) -> list[str]:
        """Commands that make the bundle from the set; `corrected`: with a file of corrections."""
        found: list[str] = []
        for name, stage in self.stages.items():
            several = f"torchrun --nproc-per-node {stage.processes} -m flexmotion.streamer"
            begin = several if stage.processes > 1 else "flexmotion"
            start = "--from RELEASE" if self.begun else f"--config {self.config} --seed {self.seed}"
            begun = "" if found else f"--set SET {start} "
            if begun and stage.processes > 1:  # one process computes the features
                found.append(f"flexmotion train {name} {begun}--steps 1 -o TRAINING")
                begun = ""
            found.append(f"{begin} train {name} {begun}--steps {stage.steps} -o TRAINING")
        if not self.begun:
            found.insert(1, "flexmotion train text -o TRAINING")
        options = "" if "distill" in self.stages else " --diffusion"
        options += " --corrections CORRECTIONS" if corrected else ""
        options += " --eight-bits" if eight_bits else ""
        return [*found, f"flexmotion export TRAINING -o BUNDLE{options}"]


def write_card(folder: Path, manifest: Manifest, made: Making) -> None:
    """Write the card into a bundle's folder."""
    window = f"{manifest.history} frames of history, {manifest.future} of future at {manifest.fps:g} fps"
    kind = f"{manifest.steps} steps, distilled" if manifest.guided else f"{manifest.steps} steps, guided"
    corrections = manifest.corrections.model_dump(exclude_defaults=True)
    lines = [
        f"# Model card: {manifest.name}",
        "",
        manifest.description or "Human motion with joint torques, ground forces and muscle activations, from text.",
        "",
        f"- **Window**: {window}; {kind}; guidance {manifest.guidance:g}.",
        *["- **Networks**: weights of matrix products in eight bits."] * manifest.eight_bits,
        f"- **Human**: {manifest.body.height:g} m, {manifest.body.mass:g} kg, {manifest.body.sex}.",
        f"- **Data**: {made.clips} clips, {made.hours:.2f} h, mirror images and variants included;",
        "  nothing of the held-out split.",
        f"- **Licence**: {manifest.licence}.",
        "  Weights trained on clips for non-commercial use are for non-commercial use.",
        "- **Not for**: motion unlike that of its data (stairs, chairs, contact with others). Its torques and forces",
        "  are estimates of a model trained on estimates, not measurements.",
        "",
        "## Training",
        "",
        "```",
        *made.commands(corrected=bool(corrections), eight_bits=manifest.eight_bits),
        "```",
        "",
        "SET is what `flexmotion data build` makes of the collections named above. Batches are those of each",
        "process (`stages` in the configuration).",
        *(
            [f"RELEASE is the weights file of {made.begun}; a stage that it holds goes on at its step."]
            * bool(made.begun)
        ),
        "",
        "| stage | steps | batch | best at | on held-out clips |",
        "|---|---|---|---|---|",
    ]
    for name, stage in made.stages.items():
        figures = ", ".join(f"{key} {value:.4g}" for key, value in stage.figures.items())
        batch = f"{stage.processes} x {stage.batch}" if stage.processes > 1 else f"{stage.batch}"
        lines.append(f"| {name} | {stage.steps} | {batch} | {stage.best} | {figures} |")
    versions = ", ".join(f"{name} {version}" for name, version in manifest.versions.items())
    lines += ["", f"Versions: {versions}.", ""]
    if corrections:
        about = "CORRECTIONS is a YAML file of them, or a bundle that has them:"
        lines += ["## Corrections", "", about, "", *(f"- `{name}`: {value}" for name, value in corrections.items()), ""]
    (folder / CARD).write_text("\n".join(lines), encoding="utf-8")


def add_figures(folder: Path, table: str) -> None:
    """Write the table of `evaluate` into a card; it replaces an earlier one.

    Args:
        folder: of the bundle.
        table: as Markdown.
    """
    path = folder / CARD
    text = path.read_text(encoding="utf-8").split(FIGURES)[0].rstrip()
    path.write_text("\n".join([text, "", FIGURES, "", table]), encoding="utf-8")


def add_note(folder: Path, note: str) -> None:
    """Add a paragraph to a bundle's card, before its figures."""
    path = folder / CARD
    text, figures, rest = path.read_text(encoding="utf-8").partition(FIGURES)
    path.write_text(f"{text.rstrip()}\n\n{note}\n" + (f"\n{figures}{rest}" if figures else ""), encoding="utf-8")
