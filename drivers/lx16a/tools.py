"""Bench tools for LX-16A servos."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import DAMAGED, TRIES
from flexmotion.drivers.bus.inspection import Inspection
from flexmotion.drivers.bus.packet import MAX_ID
from flexmotion.drivers.bus.sum_client import SumClient
from flexmotion.drivers.bus.tools import BusTools, Found, Reading
from flexmotion.drivers.lx16a.protocol import ANSWER_SIZE, BAUD, FORMAT, MILLIVOLT, Command
from flexmotion.drivers.port import SerialPort


class Lx16aTools(BusTools):
    """Tools for LX-16A and compatible servos, which report no model."""

    protocol = "lx16a"
    baud_rates = (BAUD,)
    new_baud = BAUD

    def __init__(self, port: SerialPort) -> None:
        super().__init__(port)
        self._client = SumClient(port, FORMAT)

    def scan_here(self) -> Iterator[Found]:
        """See `BusTools`. Every id is asked once."""
        for id_ in range(MAX_ID + 1):
            if self._ask(id_, once=True):
                yield Found(self.port.baud, id_, "LX-16A")

    def answers(self, id_: int) -> bool:
        """See `BusTools`."""
        return self._ask(id_)

    def inspect(self, robot: Robot, joint: int, present_id: int | None = None) -> Inspection:
        """See `BusTools`. The robot file determines no setting of these servos."""
        config = robot.joints[joint]
        id_ = config.id if present_id is None else present_id
        load = self._client.ask(id_, Command.READ_LOAD, answer=ANSWER_SIZE[Command.READ_LOAD])
        if load is None:
            reason = self.port.lost or (DAMAGED if self._client.damaged else "does not answer; is its power on?")
            raise DriverError(f"servo of {config.name} (id {id_}) on {self.port.path}: {reason}")
        on = load.params[0] == 1
        return Inspection(config.name, id_, config.servo, self.port.path, {}, {}, on)

    def write_settings(self, robot: Robot, joint: int, settings: Mapping[str, int]) -> None:
        """See `BusTools`."""
        if settings:
            raise DriverError(f"port {self.port.path}: an LX-16A has no setting of: {', '.join(settings)}")

    def look(self, robot: Robot, joint: int) -> Reading | None:
        """See `BusTools`. Four requests."""
        id_, values = robot.joints[joint].id, {}
        wanted = (Command.READ_POSITION, Command.READ_VOLTAGE, Command.READ_TEMPERATURE, Command.READ_LOAD)
        for command in wanted:
            answer = self._client.ask(id_, command, answer=ANSWER_SIZE[command], once=True)
            if answer is None:
                return None
            values[command] = int.from_bytes(answer.params, "little", signed=command is Command.READ_POSITION)
        position, voltage, temperature, load = (values[command] for command in wanted)
        return Reading(position, math.nan, math.nan, voltage * MILLIVOLT, temperature, 0, load == 1)

    def torque_off(self, robot: Robot, joint: int) -> None:
        """See `BusTools`. Not acknowledged: it is asked whether torque is off."""
        config, size = robot.joints[joint], ANSWER_SIZE[Command.READ_LOAD]
        for _ in range(TRIES):
            self.port.send(FORMAT.encode(config.id, Command.LOAD, b"\x00"))
            held = self._client.ask(config.id, Command.READ_LOAD, answer=size)
            if held is not None and held.params[0] == 0:
                return
        raise DriverError(f"servo of {config.name} (id {config.id}) on {self.port.path}: torque does not go off")

    def write_baud(self, robot: Robot, joint: int, baud: int) -> None:
        """See `BusTools`. The rate is fixed."""

    def is_alone(self, id_: int) -> bool:
        """See `BusTools`. Angle, supply and temperature."""
        for command in (Command.READ_POSITION, Command.READ_VOLTAGE, Command.READ_TEMPERATURE):
            self._client.ask(id_, command, answer=ANSWER_SIZE[command])
            if self._client.damaged:
                return False
        return True

    def write_id(self, old: int, new: int) -> None:
        """See `BusTools`."""
        self.port.send(FORMAT.encode(old, Command.SET_ID, bytes([new])))

    def _ask(self, id_: int, *, once: bool = False) -> bool:
        answer = self._client.ask(id_, Command.READ_ID, answer=ANSWER_SIZE[Command.READ_ID], once=once)
        return answer is not None
