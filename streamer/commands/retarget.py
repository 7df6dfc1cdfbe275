"""`flexmotion retarget`: a clip to robot joints, offline."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexmotion.streamer.commands.options import JsonOption, MappingOption, RobotOption, SettingsOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result, progress_bar


def retarget(
    clip: Annotated[
        Path, typer.Argument(metavar="FILE", help="Motion file: BVH, AMC, TRC, AMASS, or `data import`'s .npz.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .csv or .npz.")],
    robot: RobotOption = "op3",
    mapping: MappingOption = None,
    settings: SettingsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Turn a clip into this robot's motion, balanced and inside its joint limits, without running it.

    CSV has a column for each joint (radians, in the order of the robot's model), then the torso's pose and the feet's
    contacts; NPZ has also speeds, torques, footholds, centre of mass and ZMP. Prints how faithful the motion is.

    [bold]Examples[/bold]

      flexmotion retarget walk.bvh --robot op3 -o walk.csv
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.configs.robot import load_robot
    from flexmotion.configs.stream import load_stream
    from flexmotion.streamer.commands.choice import choose_motion
    from flexmotion.streamer.commands.places import check_place
    from flexmotion.streamer.motion.sources import ClipSource
    from flexmotion.streamer.planning.offline import retarget_offline
    from flexmotion.streamer.report.trajectory_file import WRITERS, write_trajectory
    from flexmotion.streamer.report.trajectory_quality import quality, render_quality

    check_place(out, tuple(WRITERS))
    chosen = load_robot(robot)
    motion = choose_motion(clip, mapping)
    with progress_bar(f"{chosen.name} retargets {motion.source}") as progress:
        trajectory = retarget_offline(chosen, ClipSource(motion), load_stream(settings), progress)
    write_trajectory(out, trajectory, chosen)
    result = quality(trajectory, chosen, motion)
    if as_json:
        print_json(result.json_text())
    else:
        print_result(render_quality(result))
    print_note(f"wrote {len(trajectory)} rows at {trajectory.rate_hz:g} Hz: {out}")
