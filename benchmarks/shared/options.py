"""Command-line options that several benchmarks share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

BundleArgument = Annotated[
    Path | None, typer.Argument(metavar="BUNDLE", help="Model bundle; default: the shipped one.")
]
BundleOption = Annotated[Path | None, typer.Option("--bundle", help="Model bundle; default: the shipped one.")]
StepsOption = Annotated[int | None, typer.Option("--steps", min=1, help="Diffusion steps; default: the bundle's own.")]
SetOption = Annotated[Path, typer.Option("--set", help="Training set with held-out clips.")]
CsvOption = Annotated[Path | None, typer.Option("--csv", help="Write the single measurements to this file.")]
WriteOption = Annotated[
    bool, typer.Option("--write", help="Write the figures into the bundle's manifest: it then offers what passed.")
]
PlotsOption = Annotated[Path | None, typer.Option("--plots", help="Write pictures to this folder.")]
JobsOption = Annotated[int, typer.Option("--jobs", min=1, help="Processes at a time.")]
