"""Commands that speak to a run which was started with --web: `flexmotion send`, `status`, `arm`, `stop` and others."""

from __future__ import annotations

import json
import math
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexmotion.streamer.commands.answer_text import answer_line, ended_line, status_lines, stop_line
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.option_groups import grouped
from flexmotion.streamer.commands.output import print_json, print_note, print_result
from flexmotion.streamer.commands.part_options import PartOptions
from flexmotion.streamer.commands.run_address import RunAddress

if TYPE_CHECKING:
    from flexmotion.streamer.gateway.messages import Answer

_VELOCITY_S = 5.0
"""A velocity that is sent once holds this long [s]; a stick's holds for half a second and is sent again."""

_ENDING = (
    *("TEXT", "--velocity", "--heading", "--waypoint", "--clip"),
    *("--hand", "--foot", "--head", "--point", "--look", "--joint"),
)
"""What `--wait` can wait for."""
_RESTRICTING = ("--contact", "--torque", "--tension")
"""What ends with its time alone."""


def _present(answer: Answer, as_json: bool) -> None:
    if as_json:
        print_json(answer.model_dump_json(exclude_none=True, indent=2))
    else:
        print_result(answer_line(answer))
    if answer.state not in ("accepted", "slowed", "moved"):
        raise typer.Exit(CHECK_FAILED)


@grouped
def send(
    *,
    text: Annotated[str | None, typer.Argument(help='What to do, in words: "wave".', show_default=False)] = None,
    velocity: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--velocity", metavar="VX VY WZ", help="Forward, left \\[m/s], turning left \\[rad/s].", show_default=False
        ),
    ] = None,
    heading: Annotated[
        float | None,
        typer.Option(
            "--heading", metavar="DEGREES", help="Turn to it: left of where it stood up looking.", show_default=False
        ),
    ] = None,
    waypoint: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--waypoint",
            metavar="X Y",
            help="Walk there: ahead, left of where it stood up \\[m]. With --heading it then turns to that.",
            show_default=False,
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="M",
            help="How near a waypoint, a hand, a foot or the head is near enough \\[m].",
            show_default="0.1 of a waypoint, else 0.05",
        ),
    ] = None,
    turning: Annotated[
        float | None,
        typer.Option("--turning", metavar="RAD/S", help="Fastest turning to a heading.", show_default="the robot's"),
    ] = None,
    clip: Annotated[str | None, typer.Option("--clip", help="A clip of the run's library.", show_default=False)] = None,
    hold: Annotated[bool, typer.Option("--hold", help="Come to a stand.")] = False,
    limp: Annotated[
        str | None,
        typer.Option(
            "--limp",
            metavar="JOINT,…",
            help="Switch these joints' torque off: arms and head, while the robot stands.",
            show_default=False,
        ),
    ] = None,
    stiff: Annotated[
        str | None,
        typer.Option("--stiff", metavar="JOINT,…", help="Switch it on again, where they are.", show_default=False),
    ] = None,
    reboot: Annotated[
        str | None,
        typer.Option(
            "--reboot", metavar="JOINT,…", help="Restart their servos; all torque is off.", show_default=False
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            "--for",
            min=0.05,
            max=600.0,
            help="Come to a stand after this many seconds; arms stay as they are.",
            show_default=False,
        ),
    ] = None,
    wait: Annotated[
        bool,
        typer.Option(
            "--wait",
            help="Wait for its end: done (a hand: there), replaced, stopped, its time over. Without an amount words "
            "end with the next.",
        ),
    ] = False,
    take: Annotated[bool, typer.Option("--take", help="Take the lease over from another operator first.")] = False,
    part: PartOptions,
    run: RunAddress,
) -> None:
    """Send a target to a run and print what it heard; exit code 1 where it is not done, with --wait not to its end.

    A velocity holds for 5 s, or for --for; words hold until the next target. A heading and a waypoint end where the
    robot has arrived, by its own odometry. A hand, an arm that points, the head and a joint go there whatever the rest
    of the body does, and back to it after --for, or 10 s. A foot makes a step there, where the robot stands, likewise;
    the head is brought to a place by hips and trunk over feet that stand. A foot that is kept on the ground, a torque
    that is capped and a tension hold until they are relaxed, or for --for. While a joint is limp the robot stands and
    follows no target.

    [bold]Examples[/bold]

      flexmotion send "wave with the right hand"

      flexmotion send --velocity .3 0 0 --for 4

      flexmotion send "walk two metres then wave" --wait

      flexmotion send --heading 90

      flexmotion send --waypoint 1 .5 --heading 180

      flexmotion send --hand right .15 -.1 .2 --in 1

      flexmotion send --foot left .06 .1 --in 1

      flexmotion send --head .02 0 .38 --for 5

      flexmotion send --look 1 .5 .2 --for 5

      flexmotion send --contact left

      flexmotion send --torque knee 1.5

      flexmotion send --tension "both arms" 0

      flexmotion send --relax "torque knee"

      flexmotion send --limp l_el,l_sho_pitch
    """
    turn = heading if waypoint is None and part.foot is None else None
    given = {
        "TEXT": text,
        "--velocity": velocity,
        "--heading": turn,
        "--waypoint": waypoint,
        "--clip": clip,
        "--hold": hold or None,
        "--limp": limp,
        "--stiff": stiff,
        "--reboot": reboot,
        **part.given,
    }
    chosen = [name for name, value in given.items() if value is not None]
    if len(chosen) != 1:
        raise typer.BadParameter(f"expected one of {', '.join(given)}; found {' and '.join(chosen) or 'none'}")
    if tolerance is not None and not {"--waypoint", "--hand", "--foot", "--head"} & set(chosen):
        raise typer.BadParameter("--tolerance is that of a --waypoint, --hand, --foot or --head")
    given_parts = {name for name, value in part.given.items() if value is not None}
    moved = given_parts - {"--relax", "--contact", "--torque", "--tension"}
    if part.in_s is not None and not moved:
        raise typer.BadParameter("--in is that of a --hand, --foot, --head, --point, --look or --joint")
    if wait and chosen[0] not in _ENDING and not (seconds is not None and chosen[0] in _RESTRICTING):
        expected = f"{', '.join(_ENDING)}, and with --for of {', '.join(_RESTRICTING)}"
        raise typer.BadParameter(f"--wait is that of {expected}: nothing else ends by itself")
    if turning is not None and turn is None:
        raise typer.BadParameter("--turning is that of a --heading")
    if heading is not None:
        _require_degrees("--heading", heading, 360.0 if part.foot is None else 180.0)
    if part.joint is not None:
        _require_degrees("--joint", part.joint[1], 360.0)
    radians = None if heading is None else math.radians(heading)
    message: dict[str, Any]
    if text is not None:
        message = {"type": "text", "text": text}
    elif velocity is not None:
        message, seconds = {"type": "velocity", "velocity": list(velocity)}, seconds or _VELOCITY_S
    elif waypoint is not None:
        message = {"type": "waypoint", "position_m": waypoint, "heading_rad": radians, "tolerance_m": tolerance}
    elif turn is not None:
        message = {"type": "heading", "heading_rad": radians, "turning_rad_s": turning}
    elif clip is not None:
        message = {"type": "clip", "clip": clip}
    elif hold:
        message = {"type": "hold"}
    elif any(value is not None for value in part.given.values()):
        message = part.message(tolerance, radians)
    else:
        joints = limp or stiff or reboot or ""
        message = {"type": chosen[0].removeprefix("--"), "joints": joints.split(",")}
    with run.client() as client:
        if take:
            client.take()
        answer = client.ask({**message, "ttl_s": seconds})
        _present(answer, run.as_json)
        if wait and not run.as_json:
            print_note(
                "waits for its end (words without an amount, such as 'wave', end with the next target); Ctrl-C ends "
                "the wait, and not what the robot does"
            )
        ended = client.wait(answer) if wait else None
    if ended is None:
        return
    if run.as_json:
        print_json(ended.model_dump_json(exclude_none=True, indent=2))
    else:
        print_result(ended_line(ended))
    if ended.end not in ("done", "expired"):
        raise typer.Exit(CHECK_FAILED)


def _require_degrees(option: str, found: float, most: float) -> None:
    """Raise `BadParameter` for an angle beyond what the message takes, which counts in radians."""
    if not math.isfinite(found):
        raise typer.BadParameter(f"{option}: {found} is no number, expected {-most:g} to {most:g} degrees")
    if abs(found) > most:
        beyond = "a turn" if most == 360.0 else "half a turn"
        raise typer.BadParameter(f"{option}: {found:g} is beyond {beyond}, expected {-most:g} to {most:g} degrees")


@grouped
def status(
    run: RunAddress,
) -> None:
    """Print what a run does, and why it does not do as it is told; --json: all of it, for programs.

    [bold]Examples[/bold]

      flexmotion status

      flexmotion status --json
    """
    with closing(run.client()) as client:
        found = client.status()
    if run.as_json:
        print_json(json.dumps(found, indent=2))
        return
    print_result("\n".join(status_lines(found)))


@grouped
def stop(
    run: RunAddress,
) -> None:
    """Bring the robot to a balanced stand; it refuses targets until `flexmotion clear`. Needs no token.

    It goes to the stop process of the run, which works also where nothing else of it does: at --stop-port. A run on
    another --port is asked for that port, which takes a gateway that answers.

    [bold]Examples[/bold]

      flexmotion stop

      flexmotion stop --port 8800
    """
    _press("stop", run)


@grouped
def estop(
    run: RunAddress,
) -> None:
    """Stop the robot as its robot file says, then park it, torque off; the fault is latched. It is no safety function.

    `flexmotion clear` and then `flexmotion arm` lead back.

    [bold]Examples[/bold]

      flexmotion estop
    """
    _press("estop", run)


def _press(what: str, run: RunAddress) -> None:
    with closing(run.client()) as client:
        answer = client.stop() if what == "stop" else client.estop()
    if run.as_json:
        print_json(answer.model_dump_json(exclude_none=True, indent=2))
    else:
        print_result(stop_line(what, answer))
    if answer.state != "accepted":
        raise typer.Exit(CHECK_FAILED)


@grouped
def arm(
    run: RunAddress,
) -> None:
    """Switch the robot's torque on: it stands up slowly and then takes targets.

    Refused, with the reason, while a fault is latched, while the robot lies, and while its hardware is not fit for it.

    [bold]Examples[/bold]

      flexmotion arm
    """
    with run.client() as client:
        answer = client.arm()
    _present(answer, run.as_json)


@grouped
def disarm(
    run: RunAddress,
) -> None:
    """Bring the robot to a stand, lower it to its rest pose and switch its torque off; the run goes on.

    [bold]Examples[/bold]

      flexmotion disarm
    """
    with run.client() as client:
        answer = client.disarm()
    _present(answer, run.as_json)


@grouped
def clear(
    *,
    get_up: Annotated[
        bool,
        typer.Option("--get-up", help="A robot that lies on its front or back gets up; waits until it stands."),
    ] = False,
    run: RunAddress,
) -> None:
    """Release a STOP once the robot stands; it stands on until a new target arrives.

    After an emergency stop or another fault the robot is then in OFF: `flexmotion arm` stands it up. One that has
    fallen is put up by hand before, or gets up by --get-up: see that nobody is within its reach.

    [bold]Examples[/bold]

      flexmotion clear

      flexmotion clear --get-up
    """
    with run.client() as client:
        answer = client.clear(get_up=get_up)
    _present(answer, run.as_json)


@grouped
def kill(
    *,
    confirm: Annotated[bool, typer.Option("--the-robot-will-fall", help="Confirms that nobody is in its way.")] = False,
    run: RunAddress,
) -> None:
    """Switch the torque off at once: the robot falls.

    [bold]Examples[/bold]

      flexmotion kill --the-robot-will-fall
    """
    if not confirm:
        raise typer.BadParameter("the robot will fall: confirm it by --the-robot-will-fall, or use `flexmotion stop`")
    with run.client() as client:
        answer = client.kill(confirm="the robot will fall")
    _present(answer, run.as_json)
