"""Builds the emulated buses of a robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import parse
from flexmotion.drivers.dynamixel.opencr import OpenCr as BoardDriver
from flexmotion.drivers.dynamixel.registers import BAUD_RATES, RETURN_DELAY_US
from flexmotion.drivers.dynamixel.setup import kept_settings as dynamixel_settings
from flexmotion.drivers.dynamixel.tools import DynamixelTools
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.device import Device
from flexmotion.drivers.emulator.dynamixel_bus import EmulatedDynamixelBus
from flexmotion.drivers.emulator.emulator import Emulator
from flexmotion.drivers.emulator.false_readings import FalseReadings
from flexmotion.drivers.emulator.faults import Damage, Fault
from flexmotion.drivers.emulator.feetech_bus import EmulatedFeetechBus, StsServo
from flexmotion.drivers.emulator.line import BusLine, EmulatedBus, Line, Port
from flexmotion.drivers.emulator.lx16a_bus import EmulatedLx16aBus, Lx16aServo
from flexmotion.drivers.emulator.opencr import OpenCr
from flexmotion.drivers.emulator.servo import Joints, XServo
from flexmotion.drivers.emulator.terminal import Terminal
from flexmotion.drivers.emulator.wire import Wire
from flexmotion.drivers.emulator.witmotion import WitMotionLine
from flexmotion.drivers.feetech.registers import BAUD_RATES as STS_BAUD_RATES
from flexmotion.drivers.feetech.setup import kept_settings as feetech_settings
from flexmotion.drivers.feetech.tools import FeetechTools
from flexmotion.drivers.imu.witmotion.sensor import WitMotion, WitOptions
from flexmotion.drivers.lx16a.tools import Lx16aTools

IMU_PORT = "imu"
"""Name of an IMU's port."""


def build_emulator(
    body: Body,
    *,
    link: Path | None = None,
    timed: bool = True,
    faults: Sequence[Fault] = (),
    bad_packets: float = 0.0,
    false_readings: float = 0.0,
    factory: bool = False,
    new: Sequence[str] = (),
    seed: int = 0,
) -> Emulator:
    """Build one pseudo-terminal for every bus of the body's robot, and one for its IMU if that has a port of its own.

    Args:
        link: symbolic link to the port; `.NAME` is appended if there are several buses, `.imu` for the IMU.
        timed: whether bytes take time on the wire, at the baud rate.
        faults, bad_packets, seed: see `flexmotion.drivers.emulator.faults`.
        factory: whether servos have their factory settings, except for id, baud rate and return delay; otherwise those
            that `flexmotion servo configure` writes.
        new: joints whose servos are as they come from the shop, with the id and the baud rate of a new one.
        false_readings: share of readings that are false at random, see `flexmotion.drivers.emulator.false_readings`.

    Raises `ConfigError` if a bus mixes protocols, a link exists, a fault names an unknown servo, or `new` an unknown
    joint.
    """
    for joint in new:
        body.robot.index(joint)
    buses = body.robot.config.buses
    ports: dict[str, Terminal] = {}
    try:
        for name in port_names(body.robot):
            alone = name in buses and len(buses) == 1
            ports[name] = Terminal(link if link is None or alone else link.with_name(f"{link.name}.{name}"))
        return assemble(
            body,
            ports,
            timed=timed,
            faults=faults,
            bad_packets=bad_packets,
            false_readings=false_readings,
            factory=factory,
            new=new,
            seed=seed,
        )
    except BaseException:
        for terminal in ports.values():
            terminal.close()
        raise


def assemble(
    body: Body,
    ports: Mapping[str, Port],
    *,
    timed: bool = True,
    faults: Sequence[Fault] = (),
    bad_packets: float = 0.0,
    false_readings: float = 0.0,
    factory: bool = False,
    new: Sequence[str] = (),
    seed: int = 0,
) -> Emulator:
    """Build the same on existing ports, by the names of `port_names`."""
    false = FalseReadings(false_readings, seed)
    joints = Joints(body, false)
    lines: list[Line] = []
    for number, (name, port) in enumerate(ports.items()):
        wire, damage = Wire(timed=timed), Damage(bad_packets, seed + number)
        if name in body.robot.config.buses:
            lines.append(BusLine(name, make_bus(joints, name, factory=factory, new=new), port, wire, damage))
        else:
            lines.append(_imu_line(body, name, port, wire, damage, false))
    return Emulator(body, lines, faults, false)


def port_names(robot: Robot) -> list[str]:
    """Names of a robot's ports: its buses, and `imu` if the IMU has a port of its own. Raises `ConfigError`."""
    imu, names = robot.config.imu, list(robot.config.buses)
    if imu is not None and imu.driver == WitMotion.name:
        if IMU_PORT in names:
            raise ConfigError(f"{robot.file}: field buses.{IMU_PORT}: the name is reserved for the port of the IMU")
        names.append(IMU_PORT)
    return names


def make_bus(joints: Joints, name: str, *, factory: bool = False, new: Sequence[str] = ()) -> EmulatedBus:
    """The devices of one bus, set up as in the robot file. Raises `ConfigError` if it mixes protocols.

    Args:
        factory: only id, baud rate and return delay are as in the robot file.
        new: joints whose servos have the id and the baud rate of a new one too.
    """
    robot = joints.body.robot
    protocols = {servo.protocol for joint, servo in zip(robot.joints, robot.servos, strict=True) if joint.bus == name}
    if len(protocols) != 1:
        raise ConfigError(f"{robot.file}: bus {name!r}: expected servos of one protocol, found {sorted(protocols)}")
    servos = [
        (index, joint.id, servo)
        for index, (joint, servo) in enumerate(zip(robot.joints, robot.servos, strict=True))
        if joint.bus == name
    ]
    protocol = protocols.pop()
    if protocol == "feetech":
        bus = EmulatedFeetechBus(joints, [StsServo(joints, *servo) for servo in servos])
        for sts in bus.servos:
            sts.put("baud_rate", _code(robot.config.buses[name].baud, STS_BAUD_RATES))
            sts.put("return_delay", round(robot.config.buses[name].return_delay_us / RETURN_DELAY_US))
            is_new = robot.joint_names[sts.index] in new
            if not (factory or is_new):
                for setting, value in feetech_settings(robot, sts.index).items():
                    sts.put(setting, value)
            if is_new:
                sts.put("id", FeetechTools.new_id)
                sts.put("baud_rate", _code(FeetechTools.new_baud, STS_BAUD_RATES))
        return bus
    if protocol == "lx16a":
        return EmulatedLx16aBus(
            joints,
            [
                Lx16aServo(joints, index, Lx16aTools.new_id if robot.joint_names[index] in new else id_, servo)
                for index, id_, servo in servos
            ],
        )
    return EmulatedDynamixelBus(joints, _dynamixels(joints, robot, name, factory=factory, new=new))


def _dynamixels(joints: Joints, robot: Robot, name: str, *, factory: bool, new: Sequence[str]) -> list[Device]:
    bus, devices = robot.config.buses[name], []
    for index, (joint, servo) in enumerate(zip(robot.joints, robot.servos, strict=True)):
        if joint.bus == name:
            is_new = joint.name in new
            device = XServo(joints, index, DynamixelTools.new_id if is_new else joint.id, servo)
            if not (factory or is_new):
                for setting, value in dynamixel_settings(robot, index).items():
                    device.put(setting, value)
            if is_new:
                device.put("baud_rate", _code(DynamixelTools.new_baud, BAUD_RATES))
            devices.append(device if is_new else _set_up(device, bus.baud, bus.return_delay_us))
    imu = robot.config.imu
    if imu is not None and imu.driver == BoardDriver.name and imu.bus == name and imu.id is not None:
        board = OpenCr(joints.body, imu.id, imu.quaternion, false_readings=joints.false_readings)
        devices.append(_set_up(board, bus.baud, bus.return_delay_us))
    return devices


def _imu_line(body: Body, name: str, port: Port, wire: Wire, damage: Damage, false: FalseReadings) -> WitMotionLine:
    imu = body.robot.config.imu
    assert imu is not None
    options = parse(WitOptions, {"port": name} | imu.options, f"{body.robot.file}: field imu.options")
    return WitMotionLine(name, body, imu.quaternion, options.baud, port, wire, damage, false)


def _set_up(device: Device, baud: int, return_delay_us: float) -> Device:
    device.put("baud_rate", _code(baud, BAUD_RATES))
    device.put("return_delay_time", round(return_delay_us / RETURN_DELAY_US))
    return device


def _code(baud: int, rates: Sequence[int]) -> int:
    if baud not in rates:
        raise ConfigError(f"baud {baud}: expected one of {list(rates)}")
    return rates.index(baud)
