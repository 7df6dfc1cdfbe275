"""`flexmotion servo calibrate` and `calibrate-imu`: zeros of the joints and the mounting of the IMU."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Annotated

import typer

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.streamer.commands.bus_readout import PortsOption, angle_at_rest, open_bench, refuse_shipped
from flexmotion.streamer.commands.options import JsonOption
from flexmotion.streamer.commands.output import print_json, print_note, print_result

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flexmotion.configs.calibration import Calibration
    from flexmotion.configs.robot import Robot
    from flexmotion.drivers.bench import Bench

    Float = NDArray[np.float64]

_SAMPLES, _PATIENCE_S = 125, 15.0
"""IMU samples whose mean is the direction of gravity, and how long they may take [s]."""
_SHIFTING = {"homing_offset", "drive_mode"}
"""Settings of a servo that change which angle it reports."""
_STILL_RAD_S = 0.2
"""A torso that turns faster than this is not held still [rad/s]."""


def calibrate(
    port: PortsOption,
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot folder; the calibration is stored in it.")],
    joint: Annotated[
        list[str] | None, typer.Option("--joint", "-j", help="Only this joint (repeatable).", show_default=False)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate every joint's zero: you hold the joint there, the program reads the servo.

    Hang the robot up. The program switches torque off where it is on, and asks for one joint after another: bring it to
    the angle 0 of the robot's model, which `flexmotion robots` shows. Enter takes the angle and shows
    its distance from the zero before, s leaves the joint as it was, q ends without storing. A zero with which the servo
    could not reach the joint's limits is not taken. The result is stored beside the robot file, with the date and the
    servos; nothing else is written to the servos.

    [bold]Examples[/bold]

      flexmotion servo calibrate --port /dev/ttyUSB0 --robot ./my_robot

      flexmotion servo calibrate --port /dev/ttyUSB0 --robot ./my_robot --joint l_knee
    """
    from flexmotion.configs.calibration import write_calibration
    from flexmotion.configs.robot import load_robot

    chosen = load_robot(robot)
    refuse_shipped(chosen)
    for name in joint or ():
        chosen.index(name)
    calibration = _measure_zeros(chosen, port, joint or list(chosen.joint_names))
    if calibration is None:
        print_result("ended, nothing stored")
        return
    file = write_calibration(chosen.folder, calibration)
    if any(servo.protocol == "dynamixel2" for servo in chosen.servos):
        print_note("position limits in the servos follow the zeros: run `flexmotion servo configure` again")
    if as_json:
        print_json(calibration.model_dump())
    else:
        print_result(f"stored: {file}")


def calibrate_imu(
    port: PortsOption,
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot folder; the calibration is stored in it.")],
    imu_port: Annotated[
        str | None,
        typer.Option("--imu-port", help="Port of an IMU on a port of its own; the robot file's if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate how the IMU is mounted in the torso: you hold the torso in two attitudes, the program reads gravity.

    First hold the torso upright, then leaning forward by 15 degrees or more, about its own left-right axis only; still
    both times. Torque stays as it is. The result is stored beside the robot file and overrides it.

    [bold]Examples[/bold]

      flexmotion servo calibrate-imu --port /dev/ttyUSB0 --robot ./my_robot
    """
    from datetime import UTC, datetime

    from scipy.spatial.transform import Rotation

    from flexmotion.configs.calibration import CalibratedImu, Calibration, read_calibration, write_calibration
    from flexmotion.configs.robot import load_robot
    from flexmotion.drivers.imu.mounting import mounting

    chosen = load_robot(robot)
    refuse_shipped(chosen)
    imu = chosen.config.imu
    if imu is None or imu.driver is None:
        raise ConfigError(f"{chosen.file}: field imu.driver: there is no IMU to calibrate")
    with open_bench(chosen, port, imu=True, imu_port=imu_port) as bench:
        upright = _specific_force(bench, "bring the torso upright and hold it still")
        leaning = _specific_force(bench, "lean it forward and hold it still")
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


def _specific_force(bench: Bench, what: str) -> Float:
    """Mean specific force over `_SAMPLES` at rest, (3,) [m/s²]. Raises `DriverError` if the IMU is silent or moves."""
    import numpy as np

    from flexmotion.drivers.interface import RobotState

    typer.prompt(f"{what}, then Enter", default="", show_default=False, err=True)
    state = RobotState(bench.robot.n)
    forces: list[Float] = []
    end = time.monotonic() + _PATIENCE_S
    while len(forces) < _SAMPLES:
        if time.monotonic() > end:
            raise DriverError("IMU: does not answer")
        time.sleep(1.0 / bench.robot.rate_hz)
        bench.read_imu(state)
        if state.imu_stale == 0:
            forces.append(state.accel.copy())
            if float(np.linalg.norm(state.gyro)) > _STILL_RAD_S:
                raise DriverError(f"IMU: turns at {float(np.linalg.norm(state.gyro)):.2f} rad/s: hold it still")
    return np.asarray(np.mean(forces, axis=0))


def _measure_zeros(robot: Robot, port: str, names: list[str]) -> Calibration | None:
    """The robot's zeros with those that the user shows; None if the user ends it."""
    from datetime import UTC, datetime

    from flexmotion.configs.calibration import CalibratedJoint, Calibration, check_zero, read_calibration

    zeros = {joint.name: joint.zero for joint in robot.joints}
    with open_bench(robot, port) as bench:
        _refuse_offsets(bench, names)
        _relax(bench)
        for name in names:
            index = robot.index(name)
            while True:
                answer = typer.prompt(
                    f"{name} (id {robot.joints[index].id}): bring it to 0, then Enter [s skip, q end]",
                    default="",
                    show_default=False,
                    err=True,
                ).strip()
                if answer == "q":
                    return None
                if answer == "s":
                    break
                if answer:
                    print_note(f"{answer!r}: expected Enter, s or q; nothing was taken")
                    continue
                angle = angle_at_rest(bench, index)
                if angle is None:
                    print_note(f"{name}: moves: hold it still")
                    continue
                # The joint is at 0: the angle that is read is the error of its zero.
                zero = zeros[name] + float(robot.direction[index] * angle)
                try:
                    check_zero(robot.joints[index], robot.servos[index], zero)
                except ConfigError as error:
                    print_note(f"{error}: not taken")
                    continue
                moved = math.degrees(zero - zeros[name])
                print_note(f"{name}: zero at {zero:+.4f} rad of the servo, {moved:+.1f}° from the zero before")
                zeros[name] = zero
                break
    joints = {
        joint.name: CalibratedJoint(zero=round(zeros[joint.name], 6), servo=joint.servo, id=joint.id)
        for joint in robot.joints
    }
    known = read_calibration(robot.folder)
    imu = None if known is None else known.imu
    return Calibration(date=datetime.now(UTC).isoformat(timespec="seconds"), joints=joints, imu=imu)


def _refuse_offsets(bench: Bench, names: list[str]) -> None:
    """Raise `NotConfiguredError` if a servo to be calibrated adds an offset or counts in another way than in a run."""
    from flexmotion.drivers.bus.inspection import refuse_unconfigured

    refuse_unconfigured([each for each in bench.inspect() if each.joint in names and _SHIFTING & set(each.changes)])


def _relax(bench: Bench) -> None:
    """Switch torque off where it is on, once the user holds the robot."""
    on = bench.torque_on()
    if not on:
        return
    joints = ", ".join(bench.robot.joint_names[joint] for joint in on)
    typer.prompt(f"torque is on in: {joints}; hold the robot, then Enter", default="", show_default=False, err=True)
    for joint in on:
        bench.torque_off(joint)
