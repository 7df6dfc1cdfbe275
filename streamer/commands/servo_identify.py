"""`flexmotion servo identify`: figures of a joint's servo, from a short motion on a stand or from a log."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.streamer.commands.bus_readout import PORTS_HELP, open_bench, refuse_shipped
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.identification.excitation import Excitation
    from flexmotion.drivers.identification.identify import Identified
    from flexmotion.drivers.identification.record import RobotRecord

_READS = 20
"""Reads of the pose, whose mean gives the direction of gravity."""


def identify(
    joint: Annotated[list[str], typer.Option("--joint", "-j", help="Joint to identify (repeatable).")],
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot folder; the result is stored in it.")],
    port: Annotated[
        str | None,
        typer.Option("--port", "-p", metavar="PORT", help=f"{PORTS_HELP} The joint moves.", show_default=False),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option("--log", exists=True, help="Log of a run, instead of a motion.", show_default=False),
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option("--amplitude", help="Largest angle from the centre \\[rad]; 0.4, or the room that there is."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show what would move; nothing is written.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Move without asking.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure delay, stiffness, friction, back-EMF and armature of a joint, each with its uncertainty.

    Suspend the robot on a stand, limp, feet in the air. What will move, how far and how fast is shown before you are
    asked. All servos hold while the joint moves for some 15 s, at 0.25 m/s or less at its farthest point; then torque
    is off again, as it is after any failure and Ctrl-C. The result, with date, servo and id, is stored beside the robot
    file as identification.yaml and used by every later run and simulation. A figure that the motion does not determine
    is named with what would show it, and not stored. Exit code 1 where no figure of a joint is determined.

    [bold]Examples[/bold]

      flexmotion servo identify --joint l_knee --port /dev/ttyUSB0 --robot ./my_robot --dry-run

      flexmotion servo identify --joint l_knee --port /dev/ttyUSB0 --robot ./my_robot

      flexmotion servo identify --joint l_el --log walk.mcap --robot ./my_robot
    """
    from flexmotion.configs.robot import load_robot

    if (port is None) == (log is None):
        raise ConfigError("expected either --port (the joint moves) or --log (a run that was recorded)")
    if log is not None and (amplitude is not None or dry_run):
        raise ConfigError("--amplitude and --dry-run are for a motion, not for --log")
    if amplitude is not None and not (math.isfinite(amplitude) and amplitude > 0.0):
        raise ConfigError(f"--amplitude {amplitude:g}: expected an angle above 0 [rad]")
    chosen = load_robot(robot)
    if not dry_run:
        refuse_shipped(chosen)
    indices = [chosen.index(name) for name in dict.fromkeys(joint)]
    if log is not None:
        _finish(chosen, _from_log(chosen, indices, log), as_json=as_json)
        return
    assert port is not None
    planned = _plans(chosen, indices, port, amplitude)
    if as_json and dry_run:
        print_json({"schema": "flexmotion.identify_plan/1", "joints": [_plan_row(chosen, each) for each in planned]})
        return
    note = print_note if as_json else print_result
    for each in planned:
        note(_announcement(chosen, each))
    if dry_run:
        return
    question = "the robot hangs on its stand, limp, feet in the air, nobody is in reach; all servos hold; move it?"
    if not yes and not typer.confirm(question, err=True):
        print_note("nothing was moved")
        raise typer.Exit(CHECK_FAILED)
    _finish(chosen, _by_motion(chosen, planned, port), as_json=as_json)


def _plans(robot: Robot, indices: Sequence[int], port: str, amplitude: float | None) -> list[Excitation]:
    """The motion of each joint from the present pose. Raises `DriverError` where one must not move."""
    import numpy as np

    from flexmotion.drivers.bus.inspection import refuse_unconfigured
    from flexmotion.drivers.identification.excitation import plan
    from flexmotion.drivers.interface import RobotState

    state, forces = RobotState(robot.n), []
    with open_bench(robot, port, imu=True) as bench:
        refuse_unconfigured(bench.inspect())
        on = bench.torque_on()
        if on:
            names = ", ".join(robot.joint_names[each] for each in on)
            raise DriverError(
                f"torque is on in: {names}; the robot must hang limp: park it, or switch its power off and on"
            )
        bench.read(state)
        for _ in range(_READS):
            bench.read_imu(state)
            if state.imu_stale == 0:
                forces.append(state.accel.copy())
        for _ in range(robot.safety.max_stale_reads):
            if not state.stale.any():
                break
            bench.read(state)
    silent = np.flatnonzero(state.stale)
    if len(silent):
        config = robot.joints[int(silent[0])]
        raise DriverError(f"servo of {config.name} (id {config.id}): does not answer")
    margin = robot.safety.standing_margin
    outside = (state.position < robot.lower - margin) | (state.position > robot.upper + margin)
    if outside.any():
        index = int(np.flatnonzero(outside)[0])
        config = robot.joints[index]
        raise DriverError(
            f"servo of {config.name} (id {config.id}): hangs at {state.position[index]:.2f} rad, more than {margin:g} "
            f"rad outside [{robot.lower[index]:.2f}, {robot.upper[index]:.2f}]: move it by hand"
        )
    up = np.mean(forces, axis=0) if forces else None
    if up is None:
        print_note("no IMU answers: the torso is taken for upright")
    return [plan(robot, each, state.position, amplitude=amplitude, up=up) for each in indices]


def _by_motion(robot: Robot, planned: Sequence[Excitation], port: str) -> list[Identified]:
    from flexmotion.drivers.bus.driver import BusDriver
    from flexmotion.drivers.bus.finder import bus_driver_of
    from flexmotion.drivers.bus.options import ports_in
    from flexmotion.drivers.identification.experiment import Experiment
    from flexmotion.drivers.registry import create

    driver = create(bus_driver_of(robot).name, robot, **ports_in(port))
    assert isinstance(driver, BusDriver)
    budgets = [driver.Bus.budget(robot, name) for name in robot.config.buses]
    bus_s = max(budget.write_s - budget.asked_s for budget in budgets)
    records: list[RobotRecord] = []
    with _asked_to_stop() as stopped, driver:
        experiment = Experiment(driver, bus_s=bus_s, stopped=stopped)
        for each in planned:
            print_note(f"{robot.joint_names[each.joint]} moves")
            records.append(experiment.run(each))
    print_note("torque is off; fitting")
    return _fitted(robot, [(each.joint, record) for each, record in zip(planned, records, strict=True)])


def _from_log(robot: Robot, indices: Sequence[int], file: Path) -> list[Identified]:
    from flexmotion.streamer.log.motion_record import motion_record
    from flexmotion.streamer.log.reader import read_log

    found = read_log(file)
    when = datetime.fromtimestamp(found.header.start_ns * 1e-9, UTC)
    return _fitted(robot, [(index, motion_record(found, robot, index)) for index in indices], when)


def _fitted(robot: Robot, records: Sequence[tuple[int, RobotRecord]], when: datetime | None = None) -> list[Identified]:
    from flexmotion.drivers.identification.identify import identify as fit

    date = (datetime.now(UTC) if when is None else when).isoformat(timespec="seconds")
    return [fit(robot, joint, record, date) for joint, record in records]


def _finish(robot: Robot, found: Sequence[Identified], *, as_json: bool) -> None:
    """Store what was determined and show it."""
    from flexmotion.configs.identification import read_identification, write_identification
    from flexmotion.drivers.identification.identify import merged

    known = read_identification(robot.folder)
    for each in found:
        known = merged(known, robot, each)
    file = write_identification(robot.folder, known) if any(each.figures for each in found) else None
    if as_json:
        content: dict[str, Any] = {"schema": "flexmotion.identification/1", "robot": robot.name}
        print_json(content | {"stored": file and str(file), "joints": [_row(robot, each) for each in found]})
    else:
        print_result(_table(robot, found))
        for each in found:
            for figure, reason in each.refused.items():
                print_result(f"{each.joint}: {figure}: {reason}")
        print_result("nothing stored" if file is None else f"stored: {file}")
    if not all(each.figures for each in found):
        raise typer.Exit(CHECK_FAILED)


@contextmanager
def _asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Context in which signals ask the motion to end: torque off must not be interrupted by a second one."""
    asked: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda given, _frame: asked.append(given)) for number in numbers}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _announcement(robot: Robot, planned: Excitation) -> str:
    config, row = robot.joints[planned.joint], _plan_row(robot, planned)
    low, high = (f"{angle:.2f} rad ({math.degrees(angle):.0f}°)" for angle in row["between_rad"])
    return (
        f"{config.name} ({config.servo}, id {config.id}): moves between {low} and {high} for {row['seconds']:.0f} s, "
        f"from {planned.start:.2f} rad and back; at most {row['speed_rad_s']:.2f} rad/s and {row['tip_speed_m_s']:.2f} "
        f"m/s at its farthest point; torque by the model {row['torque_nm']:.2f} of "
        f"{robot.usable_torque[planned.joint]:.2f} N·m"
    )


def _plan_row(robot: Robot, planned: Excitation) -> dict[str, Any]:
    return {
        "joint": robot.joint_names[planned.joint],
        "start_rad": round(planned.start, 4),
        "between_rad": [round(planned.lowest, 4), round(planned.highest, 4)],
        "amplitude_rad": round(planned.amplitude, 4),
        "seconds": round(planned.seconds(robot), 1),
        "speed_rad_s": round(planned.speed, 3),
        "tip_speed_m_s": round(planned.speed * planned.reach, 3),
        "torque_nm": round(planned.torque, 3),
    }


def _row(robot: Robot, found: Identified) -> dict[str, Any]:
    from flexmotion.drivers.identification.identify import UNITS, present

    servo = robot.servo(found.joint)
    return {
        "joint": found.joint,
        "figures": {
            name: {
                "value": each.value,
                "uncertainty": each.uncertainty,
                "unit": UNITS[name],
                "before": present(servo, name),
            }
            for name, each in found.figures.items()
        },
        "refused": dict(found.refused),
        "error_rad": found.estimate.error,
        "samples": found.estimate.samples,
    }


def _table(robot: Robot, found: Sequence[Identified]) -> Table:
    from flexmotion.drivers.identification.identify import UNITS, present

    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("joint", "figure", "value", "±", "unit", "so far"):
        table.add_column(column)
    for each in found:
        for name, figure in each.figures.items():
            before = present(robot.servo(each.joint), name)
            known = "" if before is None else f"{before:.4g}"
            table.add_row(each.joint, name, f"{figure.value:.4g}", f"{figure.uncertainty:.2g}", UNITS[name], known)
    return table
