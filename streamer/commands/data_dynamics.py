"""`flexmotion data dynamics`: forces, moments, muscles and joint contact of one clip, for other tools."""

from __future__ import annotations

import io
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.option_groups import ImportOptions, grouped
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result
from flexmotion.streamer.commands.places import check_place

if TYPE_CHECKING:
    from flexmotion.biomechanics.analysis import ClipAnalysis, Recording
    from flexmotion.importers import Import

PAGES = (".png", ".pdf", ".svg", ".html")
EXPLAINED = 0.5
"""Least share of good frames of a clip that passes; a training set drops one with fewer."""


@grouped
def dynamics(
    file: Annotated[Path, typer.Argument(metavar="CLIP", help="Motion file of any supported format.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .npz, .csv, or .sto for OpenSim.")],
    reading: ImportOptions,
    cutoff: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Cut-off of the low-pass filter for motion; else 6.", show_default=False),
    ] = None,
    fps: Annotated[
        float | None, typer.Option(min=10.0, max=1000.0, help="Frame rate; else that of the file.", show_default=False)
    ] = None,
    muscles: Annotated[
        bool | None,
        typer.Option(
            "--muscles/--no-muscles",
            help="With muscles and joint contact; else where the extra 'biomech' is installed.",
            show_default=False,
        ),
    ] = None,
    plots: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Page of plots: .png, .pdf, .svg, .html.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute ground forces with their error, joint moments, muscles and joint contact of one clip.

    .npz holds arrays, and is a motion file too; .csv is one table. For OpenSim, -o walk.sto writes

      walk.sto                  ground forces, centres of pressure, free torques

      walk_external_loads.xml   applies them to the feet calcn_l and calcn_r

      walk_coordinates.sto      pelvis and joint angles

      walk_moments.sto          joint moments

      walk_quality.sto          force error, residuals, flags

      walk_activations.sto      muscle activations

      walk_joint_contact.sto    joint contact forces

      walk_model.osim           the human with these coordinates and bodies

    Exit code 1: the files are written, but ground forces explain fewer than half of the frames.

    [bold]Examples[/bold]

      flexmotion data dynamics walk.trc --mass 72.6 -o walk.csv --plots walk.png

      flexmotion data dynamics walk.trc --mass 72.6 -o walk.sto
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.biomechanics.analysis import analyse, check_cutoff
    from flexmotion.biomechanics.dynamics_files import dynamics_writer, write_files
    from flexmotion.biomechanics.smoothing import CUTOFF
    from flexmotion.streamer.report.dynamics_summary import render_dynamics

    writer = dynamics_writer(out)
    check_place(out)
    check_place(plots, PAGES)
    reading.check()
    if cutoff is not None:
        check_cutoff(cutoff, fps)
    with_muscles = find_spec("myo_sim") is not None if muscles is None else muscles
    if muscles is None and not with_muscles:
        print_note("without muscles and joint contact, which need the extra 'biomech'")

    found = reading.read(file, fps)
    for warning in found.notes:
        print_note(f"{file.name}: {warning}")
    analysed = analyse(
        found.motion, CUTOFF if cutoff is None else cutoff, muscles=with_muscles, recording=_recording(found)
    )
    content = analysed.figures() | _of_import(found, reading.mass)
    contents = writer(out, analysed)
    if plots is not None:
        contents |= {plots: _page(plots, analysed, content)}
    write_files(contents)
    if as_json:
        print_json(content | {"files": [str(path) for path in contents]})
    else:
        print_result(render_dynamics(content))
    print_note(f"wrote {', '.join(str(path) for path in contents)}")
    if not content["contact_share"]:
        print_note(f"{file.name}: no foot carries load in any frame, all ground forces are about zero")
    if content["good_share"] < EXPLAINED:
        print_note(
            f"{file}: ground forces explain {100 * content['good_share']:.0f} % of the frames, "
            f"expected at least {100 * EXPLAINED:.0f} %: contact with something else than a level floor, or a bad "
            "recording"
        )
        raise typer.Exit(CHECK_FAILED)


def _of_import(found: Import, mass: float | None) -> dict[str, Any]:
    return {
        "mass_is": "given" if mass is not None else "that of the file" if found.motion.mass_given else "guessed",
        "belt_m_s": float((found.belt**2).sum() ** 0.5),
        "placement": asdict(found.placement),
        "notes": list(found.notes),
    }


def _recording(found: Import) -> Recording:
    """The motion's place in its recording."""
    from flexmotion.biomechanics.analysis import Recording

    turn, origin = found.placement.on_floor
    return Recording(found.placement.start, turn, origin, (float(found.belt[0]), float(found.belt[1])))


def _page(path: Path, analysed: ClipAnalysis, content: dict[str, Any]) -> bytes:
    """The page of plots in the format of a path's suffix."""
    from flexmotion.streamer.plots.clip_dynamics import draw_dynamics
    from flexmotion.streamer.plots.style import styled
    from flexmotion.streamer.report.dynamics_summary import dynamics_page

    suffix = path.suffix.lower()
    drawn = io.BytesIO()
    with styled():
        picture = "png" if suffix == ".html" else suffix.removeprefix(".")
        # No date and no version, so that equal clips give equal files.
        metadata = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}[picture]
        draw_dynamics(analysed).savefig(drawn, format=picture, metadata=metadata)
    return dynamics_page(content, drawn.getvalue()) if suffix == ".html" else drawn.getvalue()
