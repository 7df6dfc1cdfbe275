"""`flexmotion export`: writes a trained model as a bundle, which the live system samples, or as weights."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result
from flexmotion.streamer.commands.train import needs_training


def export(
    training: Annotated[
        Path,
        typer.Argument(
            metavar="TRAINING|WEIGHTS", help="Folder that `train` wrote, or file of `export --weights`, for a bundle."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the bundle, or file of the weights.")],
    distilled: Annotated[
        bool, typer.Option("--distilled/--diffusion", help="The distilled model of few steps, or the diffusion model.")
    ] = True,
    height: Annotated[float, typer.Option(min=0.5, help="Height of the human \\[m].")] = 1.75,
    mass: Annotated[float, typer.Option(min=5.0, help="Mass of the human \\[kg].")] = 70.0,
    description: Annotated[str, typer.Option(help="Description in the model card.")] = "",
    corrections: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|BUNDLE",
            help="YAML file of corrections, or a bundle that has them; else those of the training's configuration.",
            show_default=False,
        ),
    ] = None,
    eight_bits: Annotated[
        bool, typer.Option("--eight-bits", help="Networks in eight bits: faster, smaller, and nearly the same motion.")
    ] = False,
    onto: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|DIR",
            help="Of a personalised training: bundle of the model before, which gets the person and stays as it is in"
            " all else; by default it is exported too.",
            show_default=False,
        ),
    ] = None,
    weights: Annotated[
        bool,
        typer.Option(
            "--weights", help="Write a weights file instead: what `train --from` goes on from (half precision)."
        ),
    ] = False,
    stages: Annotated[
        str | None,
        typer.Option(
            help="Of the weights file, with commas: autoencoder, text, diffusion, distill, control, evaluator; default:"
            " all that are trained. Without text, the sentence encoder is written to the folder text beside the file.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a bundle: exported networks, statistics, known wordings, licence, with a hash.

    Of a personalised training: the bundle of the model before, with one more network for the person's manner.

    With --weights, a file to train further from: weights of the networks, statistics, configuration, licence. A
    training that is still running can be written.

    [bold]Examples[/bold]

      flexmotion export training -o bundle

      flexmotion export training -o bundle --corrections former_bundle

      flexmotion export training --weights -o released.safetensors

      flexmotion export released.safetensors -o bundle

      flexmotion export ada_training --onto default -o ada_bundle
    """
    needs_training()
    if weights and eight_bits:
        raise typer.BadParameter("--eight-bits: of a bundle; weights to train further from are in half precision")
    if onto is not None and (weights or eight_bits or corrections is not None):
        raise typer.BadParameter("--onto: everything but the person is that of the bundle; leave other options out")
    if weights:
        if training.is_file():
            raise typer.BadParameter(f"{training} is a weights file already; a bundle is made of it without --weights")
        _export_weights(training, out, stages, description, as_json)
        return
    if stages is not None:
        raise typer.BadParameter("--stages: of a weights file; give --weights")
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.bundles.manifest import read_corrections
    from flexmotion.bundles.shipped import bundle_folder
    from flexmotion.configs.corrections import Corrections
    from flexmotion.human.body import Body
    from flexmotion.training.personal_export import export_bundle
    from flexmotion.training.release import begin_to_export
    from flexmotion.training.run import BEFORE, Run

    with TemporaryDirectory() as place:
        if training.is_file():
            run = begin_to_export(training, Path(place), "distill" if distilled else "diffusion")
            if run.personal_wordings() and onto is None and not (Path(place) / BEFORE).exists():
                raise ConfigError(
                    f"{training}: is personalised, and lacks the model before: put the weights file that it began from"
                    " beside it, or give its bundle with --onto"
                )
        else:
            run = Run(training)
        bundle = export_bundle(
            run,
            out,
            distilled=distilled,
            onto=None if onto is None else Bundle(bundle_folder(onto)),
            body=Body(height=height, mass=mass),
            description=description,
            corrections=None if corrections is None else read_corrections(corrections),
            eight_bits=eight_bits,
        )
    if bundle.manifest.corrections == Corrections():
        print_note("no corrections: words are not slowed to a robot's pace")
    size = sum(path.stat().st_size for path in out.iterdir()) / 1e6
    if as_json:
        print_json({"bundle": str(out), "hash": bundle.hash, "megabytes": round(size, 2)})
    else:
        print_result(f"{out}: {size:.1f} MB, hash {bundle.hash}")


def _export_weights(training: Path, out: Path, stages: str | None, description: str, as_json: bool) -> None:
    from flexmotion.training.release import write_release
    from flexmotion.training.run import Run

    chosen = None if stages is None else [name.strip() for name in stages.split(",") if name.strip()]
    release = write_release(Run(training), out, stages=chosen, description=description)
    size = out.stat().st_size / 1e6
    steps = {name: record.step for name, record in release.header.stages.items()}
    if as_json:
        print_json({"weights": str(out), "hash": release.hash, "megabytes": round(size, 2), "steps": steps})
    else:
        told = ", ".join(f"{name} at step {step}" for name, step in steps.items())
        print_result(f"{out}: {size:.1f} MB, hash {release.hash}: {told}")
