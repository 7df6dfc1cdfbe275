"""`flexmotion check`: checks that end in exit code 0 or 1."""

from __future__ import annotations

import typer

from streamer.commands.options import (
    ClipOption,
    JsonOption,
    MappingOption,
    PromptOption,
    ReportOption,
    RobotOption,
    ScriptOption,
    SettingsOption,
)
from streamer.commands.output import print_json, print_note, print_result, progress_bar

CHECK_FAILED = 1

check = typer.Typer(no_args_is_help=True)


@check.callback()
def _checks() -> None:
    """Checks of what a motion or this machine can do; exit code 1 past a limit."""


@check.command()
def torque(
    clip: ClipOption = None,
    script: ScriptOption = None,
    prompt: PromptOption = None,
    robot: RobotOption = "op3",
    mapping: MappingOption = None,
    settings: SettingsOption = None,
    report: ReportOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check the torque that a motion asks of every servo, peak and thermal, against what the servo has.

    Plans the motion without running it. Exit code 1 where a servo cannot give what is asked, or would overheat.

    [bold]Examples[/bold]

      flexmotion check torque --clip walk.bvh

      flexmotion check torque --clip walk.bvh --robot ./my_robot --json
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from configs.robot import load_robot
    from configs.stream import load_stream
    from streamer.commands.choice import choose_motion
    from streamer.offline import retarget_offline
    from streamer.plots import write_torque
    from streamer.sources import ClipSource
    from streamer.torque_check import check_trajectory, render_check

    chosen = load_robot(robot)
    stream_settings = load_stream(settings)
    motion = choose_motion(
        clip=clip, script=script, prompt=prompt, mapping=mapping, blend_frames=stream_settings.blend_frames
    )
    with progress_bar(f"{chosen.name} retargets {motion.source}") as progress:
        trajectory = retarget_offline(chosen, ClipSource(motion), stream_settings, progress)
    result = check_trajectory(trajectory, chosen, motion.source)
    if as_json:
        print_json(result.json_text())
    else:
        print_result(render_check(result))
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        (report / "torque.json").write_text(result.json_text() + "\n", encoding="utf-8")
        print_note(f"drawn: {write_torque(report / 'torque.png', trajectory.torque, trajectory.qd, chosen)}")
    if not result.ok:
        raise typer.Exit(CHECK_FAILED)
