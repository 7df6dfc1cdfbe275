"""`flexmotion servo`: single servos at the bench."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.live import Live
from rich.table import Table

from flexmotion.configs.errors import DriverError
from flexmotion.streamer.commands.exit_codes import CHECK_FAILED, INTERRUPTED
from flexmotion.streamer.commands.options import JsonOption, RobotOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from flexmotion.configs.calibration import Calibration
    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.bus.driver import BusDriver
    from flexmotion.drivers.bus.tools import BusTools, Found
    from flexmotion.drivers.interface import RobotState

    Float = NDArray[np.float64]

ProtocolName = Literal["dynamixel2", "feetech", "lx16a"]

PortOption = Annotated[str, typer.Option("--port", "-p", help="Port of the servo bus.")]
ProtocolOption = Annotated[ProtocolName, typer.Option("--protocol", help="What the servos speak.")]
BaudOption = Annotated[int, typer.Option("--baud", "-b", help="Bit rate of the bus.")]
IdArgument = Annotated[int, typer.Argument(min=0, max=252, help="Id of the servo.")]

_SAMPLES, _PATIENCE_S = 125, 15.0
"""Samples of the IMU that a direction of gravity is the mean of, and how long they may take [s]."""
_TRIES = 25
"""Reads in which a joint has to answer."""
_SHOWN_EVERY_S = 0.1
_STILL = 0.2
"""A torso that turns faster than this is not held still [rad/s]."""

servo = typer.Typer(no_args_is_help=True)


@servo.callback()
def _servos() -> None:
    """Find, name, calibrate, restart and watch servos on a bus."""


@servo.command()
def scan(
    port: PortOption,
    protocol: ProtocolOption = "dynamixel2",
    baud: Annotated[
        list[int] | None, typer.Option("--baud", "-b", help="Bit rate to try (repeatable); all that there are if none.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find every servo on a port, at every baud rate. Exit code 1 where nobody answers.

    [bold]Examples[/bold]

      flexmotion servo scan --port /dev/ttyUSB0

      flexmotion servo scan --port /dev/ttyUSB0 --protocol feetech --baud 1000000
    """
    kind = _tools(protocol)
    with _open(kind, port, (baud or kind.baud_rates)[0]) as tools:
        found = list(tools.scan(tuple(baud or kind.baud_rates)))
    if as_json:
        print_json([vars(each) for each in found])
    elif found:
        print_result(_found(found))
    else:
        print_note("nobody answers: is the servos' power on? is it the right port and protocol?")
    if not found:
        raise typer.Exit(CHECK_FAILED)


def _found(found: Sequence[Found]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("baud", "id", "model", "firmware"):
        table.add_column(column)
    for each in found:
        table.add_row(str(each.baud), str(each.id), each.model, "" if each.firmware is None else str(each.firmware))
    return table


@servo.command("set-id")
def set_id(
    old: IdArgument,
    new: Annotated[int, typer.Argument(min=0, max=252, help="Id that it shall have.")],
    port: PortOption,
    baud: BaudOption,
    protocol: ProtocolOption = "dynamixel2",
) -> None:
    """Give a servo another id; refused where somebody has it, or while its torque is on.

    [bold]Examples[/bold]

      flexmotion servo set-id 1 14 --port /dev/ttyUSB0 --baud 57600
    """
    with _open(_tools(protocol), port, baud) as tools:
        tools.change_id(old, new)
    print_result(f"id {old} is {new} now")


@servo.command()
def reboot(
    id_: Annotated[int, typer.Argument(metavar="ID", min=0, max=252, help="Id of the servo.")],
    port: PortOption,
    baud: BaudOption,
    protocol: ProtocolOption = "dynamixel2",
) -> None:
    """Restart a servo, as one in shutdown needs: its torque goes off. Hold the robot.

    [bold]Examples[/bold]

      flexmotion servo reboot 14 --port /dev/ttyUSB0 --baud 2000000
    """
    with _open(_tools(protocol), port, baud) as tools:
        tools.reboot(id_)
    print_result(f"id {id_} has started again, its torque is off")


@servo.command()
def watch(
    port: PortOption,
    robot: RobotOption = "op3",
    seconds: Annotated[
        float | None, typer.Option("--seconds", "-s", min=0.1, help="End after this time.", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show every servo's angle, torque, supply and temperature, live; torque stays as it is.

    With --json a list of the last values, one object a joint, when it ends: after --seconds, or with Ctrl-C.

    [bold]Examples[/bold]

      flexmotion servo watch --port /dev/ttyUSB0 --robot op3
    """
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers.interface import RobotState

    chosen = load_robot(robot)
    state = RobotState(chosen.n)
    now, interrupted = time.monotonic(), False
    end, shown = now + (float("inf") if seconds is None else seconds), now
    with _looking(chosen, port) as driver, Live(auto_refresh=False, transient=as_json) as live:
        try:
            while now < end:
                driver.read(state)
                if now >= shown and not as_json:
                    live.update(_state_table(chosen, state), refresh=True)
                    shown = now + _SHOWN_EVERY_S
                # At the loop's rate, see `_heard`.
                time.sleep(1.0 / chosen.rate_hz)
                now = time.monotonic()
        except KeyboardInterrupt:
            interrupted = True
    if as_json:
        print_json(_rows(chosen, state))
    if interrupted:
        raise typer.Exit(INTERRUPTED)


@servo.command()
def calibrate(
    port: PortOption,
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot folder; the calibration is stored in it.")],
    joint: Annotated[
        list[str] | None, typer.Option("--joint", "-j", help="Only this joint (repeatable).", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell the program where every joint's zero is: you hold the joint there, it reads the servo.

    Hang the robot up, torque off. For each joint it says which way to bring the limb: the angle 0 of the robot's model,
    which `flexmotion robots` shows. Enter takes the angle, s leaves the joint as it was, q ends without storing.
    The result lies beside the robot file, with the date and the servos that it was made with.

    [bold]Examples[/bold]

      flexmotion servo calibrate --port /dev/ttyUSB0 --robot ./my_robot

      flexmotion servo calibrate --port /dev/ttyUSB0 --robot ./my_robot --joint l_knee
    """
    from flexmotion.configs.calibration import write_calibration
    from flexmotion.configs.robot import load_robot

    chosen = load_robot(robot)
    for name in joint or ():
        chosen.index(name)
    calibration = _measure_zeros(chosen, port, joint or list(chosen.joint_names))
    if calibration is None:
        print_result("ended, nothing stored")
        return
    file = write_calibration(chosen.folder, calibration)
    if as_json:
        print_json(calibration.model_dump())
    else:
        print_result(f"stored: {file}")


@servo.command("calibrate-imu")
def calibrate_imu(
    port: PortOption,
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot folder; the calibration is stored in it.")],
    imu_port: Annotated[
        str | None,
        typer.Option("--imu-port", help="Port of an IMU with one of its own; the robot file's if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell the program how the IMU sits in the torso: you show it two attitudes, it reads gravity.

    First the torso stands upright, then it leans forward, by 15 degrees or more and about its own left-right axis only,
    held still both times. Torque stays as it is. The result lies beside the robot file and wins over it.

    [bold]Examples[/bold]

      flexmotion servo calibrate-imu --port /dev/ttyUSB0 --robot ./my_robot
    """
    from datetime import UTC, datetime

    from scipy.spatial.transform import Rotation

    from flexmotion.configs.calibration import CalibratedImu, Calibration, read_calibration, write_calibration
    from flexmotion.configs.errors import ConfigError
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers.imu.mounting import mounting

    chosen = load_robot(robot)
    imu = chosen.config.imu
    if imu is None or imu.driver is None:
        raise ConfigError(f"{chosen.file}: field imu.driver: there is no IMU to calibrate")
    with _looking(chosen, port, imu=True, imu_port=imu_port) as driver:
        upright = _specific_force(driver, "bring the torso upright and hold it still")
        leaning = _specific_force(driver, "lean it forward and hold it still")
    sits = mounting(Rotation.from_quat(imu.quaternion, scalar_first=True), upright, leaning)
    w, x, y, z = (round(float(part), 6) for part in sits.as_quat(canonical=True, scalar_first=True))
    known = read_calibration(chosen.folder) or Calibration(date="", joints={})
    measured = CalibratedImu(quaternion=(w, x, y, z), driver=imu.driver)
    date = datetime.now(UTC).isoformat(timespec="seconds")
    file = write_calibration(chosen.folder, known.model_copy(update={"imu": measured, "date": date}))
    if as_json:
        print_json(measured.model_dump())
    else:
        print_result(f"the IMU's frame in the torso, w x y z: {w:g} {x:g} {y:g} {z:g}; stored: {file}")


def _specific_force(driver: BusDriver, what: str) -> Float:
    """Mean over a second or so at rest, (3,) [m/s²]. Raises `DriverError` where the IMU is silent, or turned."""
    import numpy as np

    from flexmotion.drivers.interface import RobotState

    typer.prompt(f"{what}, then Enter", default="", show_default=False, err=True)
    state = RobotState(driver.robot.n)
    forces: list[Float] = []
    end = time.monotonic() + _PATIENCE_S
    while len(forces) < _SAMPLES:
        if time.monotonic() > end:
            raise DriverError("IMU: does not answer")
        time.sleep(1.0 / driver.robot.rate_hz)
        driver.read(state)
        if state.imu_stale == 0:
            forces.append(state.accel.copy())
            if float(np.linalg.norm(state.gyro)) > _STILL:
                raise DriverError(f"IMU: turns at {float(np.linalg.norm(state.gyro)):.2f} rad/s: hold it still")
    return np.asarray(np.mean(forces, axis=0))


def _measure_zeros(robot: Robot, port: str, names: list[str]) -> Calibration | None:
    """Zeros as a person shows them, over the ones known; None where the person ends it."""
    from datetime import UTC, datetime

    from flexmotion.configs.calibration import CalibratedJoint, Calibration, read_calibration
    from flexmotion.drivers.interface import RobotState

    zeros = {joint.name: joint.zero for joint in robot.joints}
    state = RobotState(robot.n)
    with _looking(robot, port) as driver:
        for name in names:
            index = robot.index(name)
            answer = typer.prompt(
                f"{name} (id {robot.joints[index].id}): bring it to 0, then Enter [s skip, q end]",
                default="",
                show_default=False,
                err=True,
            )
            if answer == "q":
                return None
            if answer == "s":
                continue
            if not _heard(driver, state, index):
                raise DriverError(f"servo of {name} (id {robot.joints[index].id}): does not answer")
            # What it calls the joint's angle now is the error of its zero.
            zeros[name] += float(robot.direction[index] * state.position[index])
            print_note(f"{name}: zero at {zeros[name]:+.4f} rad of the servo")
    joints = {
        joint.name: CalibratedJoint(zero=round(zeros[joint.name], 6), servo=joint.servo, id=joint.id)
        for joint in robot.joints
    }
    known = read_calibration(robot.folder)
    imu = None if known is None else known.imu
    return Calibration(date=datetime.now(UTC).isoformat(timespec="seconds"), joints=joints, imu=imu)


def _heard(driver: BusDriver, state: RobotState, index: int) -> bool:
    """Read until a joint has answered: of what it has not heard for a while the driver cannot tell an old answer."""
    for _ in range(_TRIES):
        driver.read(state)
        if not state.stale[index]:
            return True
        time.sleep(1.0 / driver.robot.rate_hz)
    return False


@contextmanager
def _open(kind: type[BusTools], port: str, baud: int) -> Iterator[BusTools]:
    from flexmotion.drivers.port import SerialPort

    line = SerialPort(port, baud)
    try:
        yield kind(line)
    finally:
        line.close()


def _tools(protocol: ProtocolName) -> type[BusTools]:
    # Heavy imports wait until the command runs: help and completion answer at once.
    from flexmotion.drivers.dynamixel.tools import DynamixelTools
    from flexmotion.drivers.feetech.tools import FeetechTools
    from flexmotion.drivers.lx16a.tools import Lx16aTools

    return {kind.protocol: kind for kind in (DynamixelTools, FeetechTools, Lx16aTools)}[protocol]


@contextmanager
def _looking(robot: Robot, port: str, *, imu: bool = False, imu_port: str | None = None) -> Iterator[BusDriver]:
    """An open driver that leaves torque as it is."""
    from flexmotion.drivers.bus.finder import bus_driver_of
    from flexmotion.drivers.bus.options import BusOptions

    driver = bus_driver_of(robot)(robot, options=BusOptions(port=port, imu=imu, imu_port=imu_port))
    driver.open()
    try:
        yield driver
    finally:
        driver.let_go()


def _rows(robot: Robot, state: RobotState) -> list[dict[str, Any]]:
    def number(value: float) -> float | None:
        return round(float(value), 4) if value == value else None

    return [
        {
            "joint": joint.name,
            "id": joint.id,
            "position_rad": number(state.position[index]),
            "torque_nm": number(state.effort[index]),
            "voltage": number(state.voltage[index]),
            "temperature": number(state.temperature[index]),
            "hardware_error": int(state.hardware_error[index]),
            "missed_reads": int(state.stale[index]),
        }
        for index, joint in enumerate(robot.joints)
    ]


def _state_table(robot: Robot, state: RobotState) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    rows = _rows(robot, state)
    for column in rows[0]:
        table.add_column(column.replace("_", " "))
    for row in rows:
        table.add_row(*("" if value is None else str(value) for value in row.values()))
    return table
