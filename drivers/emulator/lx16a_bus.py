"""`EmulatedLx16aBus`: LX-16A servos that receive and answer packets."""

from __future__ import annotations

import numpy as np

from flexmotion.configs.servo import Servo
from flexmotion.drivers.bus.packet import BROADCAST, SumPacket
from flexmotion.drivers.emulator.servo import Joints
from flexmotion.drivers.emulator.sum_bus import SumBus, SumServo
from flexmotion.drivers.emulator.wire import Reply
from flexmotion.drivers.lx16a.protocol import BAUD, FORMAT, MILLIVOLT, Command
from flexmotion.drivers.random_errors import ServoError


class Lx16aServo(SumServo):
    """One servo. The duration of a move is ignored: a goal acts at once.

    Attributes:
        id: its address.
        loaded: whether torque is on.
        goal: last goal in servo units.
    """

    def __init__(self, joints: Joints, index: int, id_: int, servo: Servo) -> None:
        super().__init__("lx16a")
        self.joints, self.index, self.id, self.servo = joints, index, id_, servo
        self.loaded = False
        joints.refresh()
        self.goal = int(joints.ticks[index])

    @property
    def address(self) -> int:
        """See `SumServo`."""
        return self.id

    @property
    def baud(self) -> int:
        """See `SumServo`. It is fixed."""
        return BAUD

    def restart(self, now: float) -> None:
        """See `SumServo`."""
        self.load(False)
        self.off_until = now + 0.2

    def load(self, on: bool) -> None:
        """Switch the torque."""
        self.ram_writes += 1
        self.loaded = on
        body = self.joints.body
        body.set_torque(np.arange(body.robot.n) == self.index, on)

    def move(self, tick: int) -> None:
        """Take a goal."""
        self.goal = min(max(tick, self.servo.min_tick), self.servo.max_tick)
        if self.goal != tick:
            self.refusals.note("goal_clipped")
        self.ram_writes += 1
        robot, joints, index = self.joints.body.robot, self.joints, self.index
        angle = (self.goal - self.servo.centre_tick) * robot.tick_rad[index]
        joints.goal[index] = (angle - robot.zero[index]) * robot.direction[index]
        joints.fresh[index] = True
        joints.touch()

    def watch(self) -> None:
        """See `SumServo`. Overheating switches torque off."""
        if self.loaded and self.joints.body.plant.temperature[self.index] > self.servo.temperature_limit:
            self.load(False)

    def answer(self, command: int) -> bytes | None:
        """Params of the answer to a command; None: no answer."""
        plant = self.joints.body.plant
        error = self.joints.false_readings.of_servo(self.index) or ServoError()
        if command == Command.READ_POSITION:
            self.joints.refresh()
            tick = round(self.joints.ticks[self.index] + error.position)
            return min(max(tick, -32768), 32767).to_bytes(2, "little", signed=True)
        if command == Command.READ_LIMITS:
            return self.servo.min_tick.to_bytes(2, "little") + self.servo.max_tick.to_bytes(2, "little")
        if command == Command.READ_VOLTAGE:
            volts = round((plant.voltage + error.voltage) / MILLIVOLT)
            return min(max(volts, 0), 0xFFFF).to_bytes(2, "little")
        if command == Command.READ_TEMPERATURE:
            return bytes([min(max(round(plant.temperature[self.index] + error.temperature), 0), 255)])
        if command == Command.READ_LOAD:
            return bytes([self.loaded])
        return bytes([self.id]) if command == Command.READ_ID else None


class EmulatedLx16aBus(SumBus[Lx16aServo]):
    """LX-16A servos."""

    form = FORMAT

    def answer(self, packet: SumPacket, listening: dict[int, Lx16aServo]) -> list[Reply]:
        """See `SumBus`."""
        replies = []
        for servo in listening.values():
            if packet.id not in (servo.id, BROADCAST):
                continue
            params = packet.params
            if packet.code == Command.MOVE and len(params) == 4:
                servo.move(int.from_bytes(params[:2], "little"))
            elif packet.code == Command.LOAD and len(params) == 1:
                servo.load(params[0] == 1)
            elif packet.code == Command.SET_ID and len(params) == 1:
                servo.id = params[0]
                servo.eeprom_writes += 1
            else:
                answer = servo.answer(packet.code)
                if answer is not None:
                    replies.append(Reply(servo.id, 0.0, FORMAT.encode(servo.id, packet.code, answer)))
        return replies
