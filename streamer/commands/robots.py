"""`flexmotion robots`: the robots that come with the project, or one of your own; `robots tune` is `robots_tune.py`."""

from __future__ import annotations

from collections import Counter
from math import degrees
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from flexmotion.streamer.commands.default_command import with_default
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_result

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot


robots = typer.Typer(cls=with_default("show"))


@robots.callback()
def _robots() -> None:
    """List the robots that come with the project, check one of your own, or tune its numbers.

    [bold]Examples[/bold]

      flexmotion robots

      flexmotion robots ./my_robot

      flexmotion robots tune ./my_robot -o tuned --numbers gait.clearance,gait.double_support_min_s
    """


@robots.command()
def show(
    robot: Annotated[
        str | None,
        typer.Argument(help="Check one robot, by name or folder, and list its joints.", show_default=False),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the robots that come with the project, or check one; `show` may be left out.

    [bold]Examples[/bold]

      flexmotion robots

      flexmotion robots ./my_robot
    """
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.bundles.repertoire import robot_repertoire
    from flexmotion.configs.robot import list_robots, load_robot
    from flexmotion.configs.robot_checks import doubtful_numbers
    from flexmotion.configs.stream import load_stream
    from flexmotion.configs.tunable import unusual_numbers
    from flexmotion.retarget.footsteps import short_sight
    from flexmotion.retarget.legs import SIDE_NAMES, Leg
    from flexmotion.retarget.stand_check import unbalanced
    from flexmotion.retarget.standing_load import overloaded

    if robot is not None:
        chosen = load_robot(robot)
        robot_repertoire(chosen)  # names of kinds are checked
        for side in SIDE_NAMES:
            Leg.of(chosen, side)
        short = short_sight(chosen, load_stream())
        found = (short, overloaded(chosen), unbalanced(chosen))
        warnings = [*unusual_numbers(chosen), *doubtful_numbers(chosen), *(one for one in found if one is not None)]
        if as_json:
            print_json(_detail(chosen) | {"warnings": warnings})
        else:
            print_result(Text(chosen.name, style="bold") + f": {chosen.config.description}\n")
            print_result(_joints(chosen))
            told = [_pace(chosen), _scale(chosen), _get_up(chosen), _kinds(chosen)]
            told += [f"Warning: {one}" for one in warnings]
            print_result("\n".join(["", *told]))
        return
    shipped = [load_robot(name) for name in list_robots()]
    if as_json:
        print_json([_summary(each) for each in shipped])
        return
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("robot", "joints", "mass", "loop", "servos", "description"):
        table.add_column(column)
    for each in shipped:
        servos = ", ".join(f"{count} {model}" for model, count in _servos(each).items())
        rate, mass = f"{each.rate_hz:g} Hz", f"{each.mass:.2f} kg"
        table.add_row(each.name, str(each.n), mass, rate, servos, each.config.description)
    print_result(table)


def _servos(robot: Robot) -> Counter[str]:
    return Counter(servo.name for servo in robot.servos)


def _summary(robot: Robot) -> dict[str, Any]:
    return {
        "name": robot.name,
        "description": robot.config.description,
        "file": str(robot.file),
        "joints": robot.n,
        "mass_kg": round(robot.mass, 4),
        "rate_hz": robot.rate_hz,
        "servos": dict(_servos(robot)),
    }


def _detail(robot: Robot) -> dict[str, Any]:
    joints = [
        {
            "name": joint.name,
            "servo": joint.servo,
            "bus": joint.bus,
            "id": joint.id,
            "limits_rad": list(joint.limits),
            "torque_limit_nm": float(robot.usable_torque[i]),
            "speed_limit_rad_s": round(float(robot.no_load_speed[i]), 6),
        }
        for i, joint in enumerate(robot.joints)
    ]
    pace = robot.gait.pace
    speeds = None
    if pace is not None:
        speeds = {f"{name}_{'rad' if name == 'turning' else 'm'}_s": speed for name, speed in pace if speed is not None}
    get_up = {"sides": list(robot.get_up.steps), "unfit": dict(robot.get_up.unfit)}
    own = robot.repertoire
    kinds = None
    if own is not None:
        kinds = {
            kind: {**found.model_dump(), "offered": found.passed, "done_as": own.done_as.get(kind)}
            for kind, found in own.kinds.items()
        }
    return _summary(robot) | {"pace": speeds, "gets_up": get_up, "kinds": kinds, "joint_list": joints}


def _pace(robot: Robot) -> str:
    pace = robot.gait.pace
    if pace is None:
        return "Pace unknown (gait.pace): generated motion is not slowed for this robot"
    reached = "" if pace.reached is None else f" (of that the robot reaches {pace.reached:g} m/s, as measured)"
    return (
        f"A motion model is asked for this robot's pace at most: {pace.ahead:g} m/s ahead{reached}, "
        f"{pace.back:g} m/s back, {pace.aside:g} m/s aside, turning {pace.turning:g} rad/s"
    )


def _scale(robot: Robot) -> str:
    from flexmotion.human.body import Body
    from flexmotion.streamer.motion.robot_pace import human_scale

    body = Body()
    own = 1.0 / human_scale(robot, body)
    return (
        f"Velocities are of the human: 1 m/s of one of {body.height:g} m is {own:.3g} m/s of this robot, by the length "
        "of the legs"
    )


def _get_up(robot: Robot) -> str:
    sides, unfit = robot.get_up.steps, robot.get_up.unfit
    told = [f"Gets up on request from its {' and '.join(sides)}" if sides else "Does not get up after a fall"]
    return "\n".join(told + [f"Does not get up from its {side}: {reason}" for side, reason in unfit.items()])


def _kinds(robot: Robot) -> str:
    from flexmotion.configs.repertoire import judging

    own = robot.repertoire
    if own is None:
        return f"Not judged which kinds of motion it does: all are offered ({judging(robot.place)})"
    done = sum(found.passed for found in own.kinds.values())
    told = (
        f"Does {done} of {len(own.kinds)} kinds of motion as judged; flexmotion bundles --robot {own.place} lists them"
    )
    refused = [f"{kind} ({own.figure(kind)})" for kind, found in own.kinds.items() if not found.passed]
    others = [f"{kind} as {made}" for kind, made in own.done_as.items()]
    by_pace = [f"At its pace it does {', '.join(others)}"] if others else []
    return "\n".join([told, *by_pace, *([f"Refuses by name: {'; '.join(refused)}"] if refused else [])])


def _joints(robot: Robot) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("joint")
    table.add_column("servo")
    for column in ("bus", "id", "limits", "torque", "speed"):
        table.add_column(column, justify="right")
    for i, joint in enumerate(robot.joints):
        low, high = map(degrees, joint.limits)
        table.add_row(
            joint.name,
            joint.servo,
            joint.bus,
            str(joint.id),
            f"{low:.0f}° … {high:.0f}°",
            f"{robot.usable_torque[i]:.2f} N·m",
            f"{robot.no_load_speed[i]:.1f} rad/s",
        )
    return table
