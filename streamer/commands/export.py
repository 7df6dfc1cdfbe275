"""`flexmotion export`: a training to a bundle that the live system samples."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_result
from flexmotion.streamer.commands.train import needs_training


def export(
    training: Annotated[Path, typer.Argument(metavar="TRAINING", help="Folder that `train` wrote.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the bundle.")],
    distilled: Annotated[
        bool, typer.Option("--distilled/--diffusion", help="The model of few steps, or the one it was distilled from.")
    ] = True,
    height: Annotated[float, typer.Option(min=0.5, help="Of the human that it moves \\[m].")] = 1.75,
    mass: Annotated[float, typer.Option(min=5.0, help="Of that human \\[kg].")] = 70.0,
    description: Annotated[str, typer.Option(help="For people.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Write a bundle: exported networks, statistics, known wordings, licence, all under a hash.

    [bold]Examples[/bold]

      flexmotion export training -o bundle
    """
    needs_training()
    from flexmotion.human.body import Body
    from flexmotion.training.export import export as write
    from flexmotion.training.run import Run

    bundle = write(
        Run(training), out, distilled=distilled, body=Body(height=height, mass=mass), description=description
    )
    size = sum(path.stat().st_size for path in out.iterdir()) / 1e6
    if as_json:
        print_json({"bundle": str(out), "hash": bundle.hash, "megabytes": round(size, 2)})
    else:
        print_result(f"{out}: {size:.1f} MB, hash {bundle.hash}")
