"""`flexmotion bundles`: the motion models that come with the project: what they do, and under which licence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.configs.repertoire import RobotRepertoire


def bundles(
    bundle: Annotated[
        str | None, typer.Argument(metavar="NAME|DIR", help="This one alone, or one in a folder.", show_default=False)
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", "-r", help="Only kinds of motion that this robot does too.", show_default=False),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the motion models that come with the project, and all that each can do; --bundle NAME chooses one.

    [bold]Examples[/bold]

      flexmotion bundles

      flexmotion bundles my-bundle

      flexmotion bundles --robot op3

      flexmotion dry-run --bundle default --prompt "walk"
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.bundles.bundle import Bundle
    from flexmotion.bundles.repertoire import robot_repertoire
    from flexmotion.bundles.shipped import bundle_folder, shipped_bundles
    from flexmotion.configs.robot import load_robot

    repertoire = None if robot is None else robot_repertoire(load_robot(robot))
    folders = shipped_bundles() if bundle is None else {bundle: bundle_folder(bundle)}
    found = {name: _summary(Bundle(folder), repertoire) for name, folder in folders.items()}
    if as_json:
        print_json([{"name": name, **summary} for name, summary in found.items()])
        return
    if not found:
        print_result("this version comes without a model; --bundle DIR names the folder of one")
    for name, summary in found.items():
        print_result(f"{name}: {summary['description'] or summary['model']}, hash {summary['hash']}")
        print_result(f"  kinds of motion: {', '.join(summary['kinds'])}")
        if summary["manners"]:
            print_result(f"  manners: {', '.join(summary['manners'])}")
        if summary["persons"]:
            print_result(f"  of persons, by networks of their own: {', '.join(summary['persons'])}")
        print_result(f"  licence: {summary['licence']}")


def _summary(bundle: Bundle, repertoire: RobotRepertoire | None) -> dict[str, Any]:
    from flexmotion.bundles.repertoire import offered_kinds, offered_manners

    manifest = bundle.manifest
    return {
        "model": manifest.name,
        "description": manifest.description,
        "folder": str(bundle.folder),
        "hash": bundle.hash,
        "licence": manifest.licence,
        "kinds": list(offered_kinds(bundle, repertoire)),
        "manners": list(offered_manners(bundle)),
        "persons": list(bundle.personal),
    }
