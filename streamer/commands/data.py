"""`flexmotion data`: motion files to a training set, and what is in it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.option_groups import ImportOptions, grouped
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar
from flexmotion.streamer.commands.places import check_place

data = typer.Typer(help="Motion files to a training set with forces, torques and muscle activations.")

FPS = 30.0
"""Frame rate of what is written, by default [1/s]."""

COLUMNS = ("min", "p01", "median", "p99", "max")

OutOption = Annotated[Path, typer.Option("--out", "-o", help="File or folder to write.")]


@data.command("import")
@grouped
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Motion: .bvh .amc .npy .npz .trc .c3d")],
    reading: ImportOptions,
    out: OutOption,
    fps: Annotated[float, typer.Option(min=1.0, max=1000.0, help="Frame rate to write.")] = FPS,
    as_json: JsonOption = False,
) -> None:
    """Read a motion file of any supported format and write it as the project's own .npz.

    [bold]Examples[/bold]

      flexmotion data import walk.bvh -o walk.npz
      flexmotion data import walk.trc -o walk.npz --mass 72.6 --height 1.80
    """
    from flexmotion.human.motion_file import save_motion

    check_place(out, (".npz",))
    reading.check()
    found = reading.read(file, fps)
    save_motion(found.motion, out)
    errors = {name: {"rms_m": error.rms, "max_m": error.max} for name, error in found.errors.items()}
    body = found.motion.body
    if as_json:
        print_json(
            {
                "file": str(out),
                "frames": len(found.motion),
                "mapping": found.mapping,
                "fit": errors,
                "belt": found.belt.tolist(),
                "mass_kg": body.mass,
                "mass_given": found.motion.mass_given,
                "height_m": body.height,
                "start_s": found.placement.start,
                "warnings": list(found.notes),
            }
        )
        return
    for warning in found.notes:
        print_note(f"{file.name}: {warning}")
    print_note(f"{file.name}: {body.mass:.1f} kg, {body.height:.2f} m")
    print_result(f"{out}: {len(found.motion)} frames at {fps:g} Hz, skeleton {found.mapping or 'own format'}")


@data.command()
@grouped
def augment(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Motion file of any supported format.")],
    reading: ImportOptions,
    out: OutOption,
    seed: Annotated[int, typer.Option(help="Seed of the variants.")] = 0,
    mirrored: Annotated[bool, typer.Option("--mirror", help="Only mirror the motion.")] = False,
    perturbed: Annotated[
        bool, typer.Option("--perturbed", help="Simulate the human under a push, load and slope drawn from the seed.")
    ] = False,
    push: Annotated[
        float | None, typer.Option(min=0.0, help="Simulate: peak force of a push on the trunk [body weights].")
    ] = None,
    push_direction: Annotated[float, typer.Option(help="Direction of the push, from x to y [degrees].")] = 0.0,
    push_at: Annotated[float, typer.Option(min=0.0, help="Start of the push, which lasts .2 s [s].")] = 1.0,
    load: Annotated[float | None, typer.Option(min=0.0, help="Simulate: mass carried in both hands [kg].")] = None,
    slope: Annotated[
        float | None,
        typer.Option(min=-5.0, max=5.0, help="Simulate: angle at which the floor rises along x [degrees]."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of a simulated variant (.png).")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a variant of a motion: another body, tempo, start and loads, or a simulated answer to a perturbation.

    [bold]Examples[/bold]

      flexmotion data augment walk.bvh -o other.npz --seed 3

      flexmotion data augment walk.bvh -o pushed.npz --push 0.1 --push-direction 90 --plot pushed.png
    """
    from dataclasses import asdict

    import numpy as np

    from flexmotion.biomechanics.augmentation import varied
    from flexmotion.biomechanics.dynamics import dynamics
    from flexmotion.biomechanics.mirror import mirror
    from flexmotion.human.motion_file import save_motion

    asked = {"--push": push, "--load": load, "--slope": slope}
    given = [name for name, value in asked.items() if value is not None]
    simulated = perturbed or bool(given)
    if mirrored and simulated:
        raise typer.BadParameter(f"--mirror cannot be combined with {', '.join(given) or '--perturbed'}")
    if perturbed and given:
        raise typer.BadParameter(f"--perturbed draws what {', '.join(given)} would set: give one of the two")
    if plot is not None and not simulated:
        raise typer.BadParameter("--plot draws a simulated variant: add --perturbed, --push, --load or --slope")
    check_place(out, (".npz",))
    check_place(plot)
    reading.check()
    read = reading.read(file, FPS)
    motion = read.motion
    for warning in read.notes:
        print_note(f"{file.name}: {warning}")
    about: dict = {"file": str(out), "seed": seed, "warnings": list(read.notes)}
    if simulated:
        from flexmotion.biomechanics.simulation.perturbation import Perturbation
        from flexmotion.biomechanics.simulation.variant import perturbed as simulate

        wanted = None
        if given:
            wanted = Perturbation(
                push=push or 0.0,
                direction=float(np.radians(push_direction)),
                start_s=push_at if push else 0.0,
                duration_s=0.2 if push else 0.0,
                carried=(("hand_l", load / 2), ("hand_r", load / 2)) if load else (),
                slope=(float(np.tan(np.radians(slope or 0.0))), 0.0),
            )
        answer = simulate(motion, seed, perturbation=wanted)
        found = answer.dynamics
        about |= answer.description()
        if plot is not None:
            from flexmotion.streamer.plots.perturbed import plot_perturbed

            plot_perturbed(answer, plot)
    else:
        changed, loads = (mirror(motion), ()) if mirrored else varied(motion, seed)
        found = dynamics(changed, loads=loads)
    save_motion(found.motion, out)
    residual = np.median(found.residual, axis=0)
    if as_json:
        print_json(about | {"body": asdict(found.motion.body), "residual_median": residual.tolist()})
        return
    body_text = f"{found.motion.body.height:.2f} m, {found.motion.body.mass:.1f} kg"
    print_result(f"{out}: {len(found.motion)} frames, {body_text}, residual {100 * residual[0]:.2f} % of body weight")
    if simulated:
        mean, largest = (100 * about["assistance"][name] for name in ("force_mean_bw", "force_max_bw"))
        print_result(f"assistance at the root: {mean:.2f} % of body weight in the mean, {largest:.2f} % at most")


@data.command()
def build(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Motion data; archives are unpacked.")],
    out: OutOption,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = os.cpu_count() or 1,
    engine: Annotated[
        str, typer.Option(help="process, or ray: a cluster at RAY_ADDRESS, else a local one.")
    ] = "process",
    fps: Annotated[float, typer.Option(min=10.0, help="Frame rate of the set.")] = 30.0,
    variants: Annotated[int, typer.Option(min=0, help="Varied copies of every clip.")] = 0,
    perturbed: Annotated[
        int, typer.Option(min=0, help="Simulated copies of a clip: pushed, loaded, on a slope; slow.")
    ] = 0,
    perturbed_share: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of the clips that have simulated copies.")
    ] = 1.0,
    mirrored: Annotated[bool, typer.Option("--mirror/--no-mirror", help="With mirror images.")] = True,
    muscles: Annotated[bool, typer.Option("--muscles/--no-muscles", help="With muscle activations.")] = True,
    seed: Annotated[int, typer.Option(help="Seed of the variants.")] = 0,
    limit: Annotated[int | None, typer.Option(min=1, help="At most this many clips, spread over all.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Build a training set from folders of motion data; an interrupted build resumes when started again.

    [bold]Examples[/bold]

      flexmotion data build motions -o set
    """
    from flexmotion.dataset.build import build as build_set
    from flexmotion.dataset.engines import ENGINES
    from flexmotion.dataset.settings import BuildSettings

    if engine not in ENGINES:
        raise typer.BadParameter(f"engine is {engine!r}, expected {' or '.join(ENGINES)}")
    for folder in folders:
        if not folder.is_dir():
            raise typer.BadParameter(f"{folder}: no such folder of motion data")
    if muscles:
        from flexmotion.biomechanics.muscle_geometry import muscle_models

        # Missing models are reported now, not by every process after its first clip.
        muscle_models()
    settings = BuildSettings(
        fps=fps,
        variants=variants,
        perturbed=perturbed,
        perturbed_share=perturbed_share,
        mirrored=mirrored,
        muscles=muscles,
        seed=seed,
    )
    with progress_bar(f"builds {out}") as progress:
        manifest = build_set(folders, out, settings, engine=engine, workers=workers, limit=limit, progress=progress)
    _report(manifest, as_json)
    print_note(f"wrote {manifest['frames']} frames: {out}")


@data.command()
def gestures(
    folders: Annotated[
        list[Path], typer.Argument(metavar="FOLDER...", help="Recordings in which people stand and walk normally.")
    ],
    out: OutOption,
    kind: Annotated[list[str] | None, typer.Option(help="Gesture of gestures.yaml; may be given again.")] = None,
    count: Annotated[int, typer.Option(min=1, help="Motions of each gesture, half of them to each side.")] = 44,
    fps: Annotated[float, typer.Option(min=10.0, help="Frame rate of the motions.")] = 30.0,
    limit: Annotated[int | None, typer.Option(min=1, help="Read at most this many recordings.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all draws.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Make gestures that recordings lack: arms, head and knees moved over recorded standing and walking.

    The folder that is written has motions, index and captions, and is one more source of `data build`.

    [bold]Examples[/bold]

      flexmotion data gestures recordings -o gestures
      flexmotion data build recordings gestures -o set
    """
    from flexmotion.dataset.gestures.make import make_gestures
    from flexmotion.gestures.recipes import recipes

    known = {gesture.kind: gesture for gesture in recipes()}
    unknown = [name for name in kind or () if name not in known]
    if unknown:
        raise typer.BadParameter(f"kind is {unknown[0]!r}, expected one of {', '.join(known)}")
    with progress_bar(f"makes {out}") as progress:
        made = make_gestures(
            folders,
            out,
            [known[name] for name in kind or known],
            count=count,
            seed=seed,
            fps=fps,
            limit=limit,
            progress=progress,
        )
    if as_json:
        print_json({"folder": str(out), "motions": made})
        return
    for name, number in sorted(made.items()):
        print_result(f"{number:4d} {name}")
    print_note(f"wrote {sum(made.values())} motions: {out}")


@data.command()
def inspect(
    folder: Annotated[Path, typer.Argument(metavar="SET", help="Folder that `data build` wrote.")],
    plots: Annotated[Path | None, typer.Option(help="Folder for plots of every modality.")] = None,
    verify: Annotated[bool, typer.Option(help="Compare the files with their hashes.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Print what is in a set: hours, clips kept and dropped by reason, ranges of every modality.

    [bold]Examples[/bold]

      flexmotion data inspect set --plots plots --verify
    """
    from flexmotion.dataset.training_set import TrainingSet

    found = TrainingSet(folder)
    _report(found.manifest, as_json)
    if plots is not None:
        from flexmotion.streamer.plots.training_set import plot_set

        for path in plot_set(found, plots):
            print_note(f"wrote {path}")
    if verify:
        wrong = found.damaged()
        if wrong:
            print_note(f"damaged: {', '.join(wrong)}")
            raise typer.Exit(CHECK_FAILED)
        print_note("every file matches the manifest")


@data.command()
def export(
    folder: Annotated[Path, typer.Argument(metavar="SET", help="Folder that `data build` wrote.")],
    out: OutOption,
) -> None:
    """Write the compact form of a set: half precision, with joint contact forces.

    Muscle activations, their flag of infeasible frames, and mirror images are left out.

    [bold]Examples[/bold]

      flexmotion data export set -o set.fms
    """
    from flexmotion.dataset.compact import export_compact
    from flexmotion.dataset.training_set import TrainingSet

    check_place(out)
    size = export_compact(TrainingSet(folder), out)
    print_result(f"{out}: {size / 1e6:.1f} MB" if size >= 1e6 else f"{out}: {size / 1e3:.0f} kB")


def _report(manifest: dict, as_json: bool) -> None:
    from rich.table import Table

    if as_json:
        wanted = ("frames", "summary", "ranges", "fields", "dropped", "versions", "settings")
        print_json({key: manifest[key] for key in wanted})
        return
    summary = manifest["summary"]
    print_result(", ".join(f"{name} {hours:.2f} h" for name, hours in summary["hours"].items()))
    dropped = ", ".join(f"{count} {reason}" for reason, count in summary["clips_dropped"].items()) or "none"
    named = sum(bool(clip["captions"] or {"content", "action"} & clip["labels"].keys()) for clip in manifest["clips"])
    print_result(f"clips: {summary['clips_kept']} kept, {named} of them with labels or captions; dropped: {dropped}")
    if named < len(manifest["clips"]):
        print_note(
            f"{len(manifest['clips']) - named} clips have neither: no words are learnt from them; put the collection's"
            " *_index.csv or *_captions.csv in one of the folders"
        )
    table = Table("field", "unit", *COLUMNS)
    for name, row in sorted(manifest["ranges"].items()):
        table.add_row(name, manifest["fields"][name]["unit"], *(f"{row[key]:.4g}" for key in COLUMNS))
    print_result(table)
    kinds = Table("kind", "clips", "frames", "frames dropped", "good", "flagged", "residual force", "residual moment")
    variants = {f"variant {name}": row for name, row in summary.get("by_variant", {}).items()}
    for name, row in (summary["by_kind"] | variants).items():
        force, moment = row.get("residual_median", (float("nan"), float("nan")))
        cells = (row["clips"], row["frames"], row["frames_dropped"])
        good = f"{100 * row['kept_share']:.1f} %" if "kept_share" in row else "-"
        flagged = f"{100 * row['flagged_share']:.1f} %" if "flagged_share" in row else "-"
        kinds.add_row(name, *map(str, cells), good, flagged, f"{100 * force:.2f} % BW", f"{moment:.4f} BW·m")
    print_result(kinds)
    for clip in manifest["dropped"][:20]:
        print_result(f"dropped {clip['name']}: {clip['reason']}")
    if len(manifest["dropped"]) > 20:
        print_result(f"… and {len(manifest['dropped']) - 20} more, in the manifest")
