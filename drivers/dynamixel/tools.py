"""Bench tools for Dynamixel servos."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.inspection import Inspection
from flexmotion.drivers.bus.servo_bus import torque_per_unit
from flexmotion.drivers.bus.tools import BusTools, Found, Reading, model_name
from flexmotion.drivers.dynamixel.goals import sync_write
from flexmotion.drivers.dynamixel.layout import Span
from flexmotion.drivers.dynamixel.opencr import OpenCr, board_of
from flexmotion.drivers.dynamixel.registers import BAUD_RATES, VOLTAGE, open_cr, table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.dynamixel.setup import ANSWER_ALL, find, write_kept
from flexmotion.drivers.imu.interface import Imu
from flexmotion.drivers.port import SerialPort

_REBOOT_S = 3.0
"""Longest restart of a servo [s]; some tenths are usual."""
_ANY = table_of("XM430-W350")
"""Id, torque and firmware version have the same address in every table of the X series."""


class DynamixelTools(BusTools):
    """Tools for Protocol 2.0."""

    protocol = "dynamixel2"
    baud_rates = BAUD_RATES[:7]  # the SDK and most adapters do not support 4.5 M and more
    new_baud = 57_600  # e-Manual: ID(7), Baud Rate(8)

    def __init__(self, port: SerialPort) -> None:
        super().__init__(port)
        self._client = Client(port)

    def scan_here(self) -> Iterator[Found]:
        """See `BusTools`."""
        for id_, (model, firmware) in sorted(self._client.find().items()):
            name = "OpenCR board" if model == open_cr().model_number else model_name(model)
            yield Found(self.port.baud, id_, name, firmware)

    def answers(self, id_: int) -> bool:
        """See `BusTools`."""
        return self._client.ping(id_) is not None

    def is_alone(self, id_: int) -> bool:
        """See `BusTools`. The registers from the counter of milliseconds to the temperature of an X servo."""
        first, end = _ANY["realtime_tick"].address, _ANY["present_temperature"].end
        with contextlib.suppress(DriverError):
            self._client.read_block(id_, first, end - first)
        return not self._client.damaged

    def write_id(self, old: int, new: int) -> None:
        """See `BusTools`. Raises `DriverError` while torque is on."""
        if self._client.read(old, _ANY["torque_enable"]):
            raise DriverError(f"port {self.port.path}: id {old}: torque is on, which locks the id")
        self._client.write(old, _ANY["id"], new)

    def inspect(self, robot: Robot, joint: int, present_id: int | None = None) -> Inspection:
        """See `BusTools`."""
        return find(self._client, robot, joint, present_id).inspection

    def write_settings(self, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
        """See `BusTools`."""
        write_kept(self._client, robot, joint, settings)

    def look(self, robot: Robot, joint: int) -> Reading | None:
        """See `BusTools`. The registers from torque enable to present temperature, in one read."""
        id_, servo = robot.joints[joint].id, robot.servos[joint]
        table = table_of(servo.name)
        first = table["torque_enable"].address
        try:
            data = self._client.read_block(id_, first, table["present_temperature"].end - first, once=True)
        except DriverError:
            return None

        def value(name: str) -> int:
            register = table[name]
            return register.unpack(data[register.address - first : register.end - first])

        return Reading(
            ticks=value("present_position"),
            velocity=value("present_velocity") * table.velocity_unit,
            effort=value("present_current") * torque_per_unit(servo),
            voltage=value("present_input_voltage") * VOLTAGE,
            temperature=value("present_temperature"),
            error=value("hardware_error_status"),
            torque_on=value("torque_enable") == 1,
        )

    def torque_off(self, robot: Robot, joint: int) -> None:
        """See `BusTools`."""
        self._client.write(robot.joints[joint].id, table_of(robot.servos[joint].name)["torque_enable"], 0)

    def write_baud(self, robot: Robot, joint: int, baud: int) -> None:
        """See `BusTools`."""
        register = table_of(robot.servos[joint].name)["baud_rate"]
        self._client.write(robot.joints[joint].id, register, BAUD_RATES.index(baud))

    def acknowledge(self, robot: Robot, joints: Sequence[int]) -> None:
        """See `BusTools`. Not acknowledged: at a low status return level a servo does not answer a write."""
        for joint in joints:
            register = table_of(robot.servos[joint].name)["status_return_level"]
            row = bytes([robot.joints[joint].id]) + register.pack(ANSWER_ALL)
            self.port.send(sync_write(Span(register.address, register.size), row))

    def find_board(self, robot: Robot, name: str) -> OpenCr | None:
        """See `BusTools`."""
        board = board_of(robot, name)
        if board is None or board.find(self._client) is not None:
            return None
        if not board.powered(self._client):
            raise DriverError(
                f"port {self.port.path}: OpenCR (id {board.id}) has the power of the servos switched off; "
                "`flexmotion servo configure` switches it on"
            )
        return board

    def read_board(self, board: Imu) -> bool:
        """See `BusTools`."""
        assert isinstance(board, OpenCr)
        board.forget()
        with contextlib.suppress(DriverError):
            board.take(self._client.read_block(board.id, board.span.address, board.span.size, once=True))
        return board.read(self.port.now())

    def switch_power(self, robot: Robot, name: str) -> None:
        """See `BusTools`."""
        board = board_of(robot, name)
        if board is not None and board.find(self._client) is None:
            board.audit(self._client)

    def reboot(self, id_: int) -> None:
        """See `BusTools`. Returns once the servo answers again."""
        self._client.reboot(id_)
        end = time.monotonic() + _REBOOT_S
        while self._client.ping(id_, once=True) is None:
            if time.monotonic() > end:
                raise DriverError(f"port {self.port.path}: id {id_}: does not answer {_REBOOT_S:g} s after a reboot")
