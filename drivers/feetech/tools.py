"""Bench tools for Feetech servos."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.inspection import Inspection
from flexmotion.drivers.bus.packet import MAX_ID
from flexmotion.drivers.bus.servo_bus import torque_per_unit
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.bus.tools import BusTools, Found, Reading, model_name
from flexmotion.drivers.feetech.registers import BAUD_RATES, FORMAT, VOLTAGE, Instruction, sts
from flexmotion.drivers.feetech.setup import find, write, write_kept
from flexmotion.drivers.port import SerialPort


class FeetechTools(BusTools):
    """Tools for the STS series."""

    protocol = "feetech"
    baud_rates = BAUD_RATES
    new_baud = 1_000_000  # memory table of the STS series

    def __init__(self, port: SerialPort) -> None:
        super().__init__(port)
        self._client = SumClient(port, FORMAT)

    def scan_here(self) -> Iterator[Found]:
        """See `BusTools`. Every id is asked once."""
        model = sts()["model_number"]
        for id_ in range(MAX_ID + 1):
            params = bytes([model.address, model.size])
            answer = self._client.ask(id_, Instruction.READ, params, answer=model.size, once=True)
            if answer is not None:
                yield Found(self.port.baud, id_, model_name(model.unpack(answer.params)))

    def answers(self, id_: int) -> bool:
        """See `BusTools`."""
        return self._client.ask(id_, Instruction.PING, answer=0) is not None

    def inspect(self, robot: Robot, joint: int, present_id: int | None = None) -> Inspection:
        """See `BusTools`."""
        return find(self._client, robot, joint, present_id).inspection

    def write_settings(self, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
        """See `BusTools`."""
        write_kept(self._client, robot, joint, settings)

    def look(self, robot: Robot, joint: int) -> Reading | None:
        """See `BusTools`. All registers in one read."""
        servo, table = robot.servos[joint], sts()
        size = max(register.end for register in table.registers.values())
        answer = self._client.ask(robot.joints[joint].id, Instruction.READ, bytes([0, size]), answer=size, once=True)
        if answer is None:
            return None
        value = {name: r.unpack(answer.params[r.address : r.end]) for name, r in table.registers.items()}
        return Reading(
            ticks=value["present_position"],
            velocity=value["present_speed"] * servo.tick_rad,
            effort=value["present_current"] * torque_per_unit(servo),
            voltage=value["present_voltage"] * VOLTAGE,
            temperature=value["present_temperature"],
            error=value["status"],
            torque_on=value["torque_enable"] == 1,
        )

    def torque_off(self, robot: Robot, joint: int) -> None:
        """See `BusTools`."""
        write(self._client, robot, joint, "torque_enable", 0)

    def write_baud(self, robot: Robot, joint: int, baud: int) -> None:
        """See `BusTools`. Locked again at the new rate; acknowledged at neither, perhaps."""
        config, table = robot.joints[joint], sts()
        write(self._client, robot, joint, "lock", 0)
        code = bytes([table["baud_rate"].address, BAUD_RATES.index(baud)])
        self._client.ask(config.id, Instruction.WRITE, code, answer=0, once=True)
        self.port.set_baud(baud)
        write(self._client, robot, joint, "lock", 1)

    def is_alone(self, id_: int) -> bool:
        """See `BusTools`. All registers."""
        size = max(register.end for register in sts().registers.values())
        self._client.ask(id_, Instruction.READ, bytes([0, size]), answer=size)
        return not self._client.damaged

    def write_id(self, old: int, new: int) -> None:
        """See `BusTools`."""
        lock, address = sts()["lock"].address, sts()["id"].address
        self._client.ask(old, Instruction.WRITE, bytes([lock, 0]), answer=0)
        self._client.ask(old, Instruction.WRITE, bytes([address, new]), answer=0, once=True)
        for id_ in (new, old):  # the servo has one of them
            if self._client.ask(id_, Instruction.WRITE, bytes([lock, 1]), answer=0) is not None:
                break
