"""`EmulatedFeetechBus`: servos of Feetech's STS series that hear instructions in bytes and answer in bytes."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from configs.servo import Servo
from drivers.bus.packet import BROADCAST, SumDecoder, SumPacket
from drivers.emulator.servo import Joints
from drivers.emulator.wire import Reply
from drivers.feetech.registers import BAUD_RATES, FORMAT, VOLTAGE, Instruction, sts

RETURN_DELAY_US = 2.0
INPUT_VOLTAGE, OVERHEATING = 0x01, 0x04


class StsServo:
    """One servo and its memory; torque limit, lock and limits act, profiles do not.

    Attributes:
        memory: the control table, byte by byte.
        dark_until: time until which it hears nothing, after it lost power [s].
    """

    def __init__(self, joints: Joints, index: int, id_: int, servo: Servo) -> None:
        self.joints, self.index, self.servo = joints, index, servo
        self.dark_until = 0.0
        self.memory = bytearray(128)
        for name, register in sts().registers.items():
            self.put(name, register.initial)
        self.put("id", id_)
        self.put("model_number", servo.model_number or 0)
        self._pin()

    def get(self, name: str) -> int:
        """A register's value."""
        register = sts()[name]
        return register.unpack(self.memory[register.address : register.end])

    def put(self, name: str, value: int) -> None:
        """Set a register, whatever the rules for writing it."""
        register = sts()[name]
        self.memory[register.address : register.end] = register.pack(value)

    def refresh(self) -> None:
        """Write what is measured now into the table."""
        plant, index, robot = self.joints.body.plant, self.index, self.joints.body.robot
        direction = robot.direction[index]
        torque = direction * plant.torque[index]
        self.put("present_position", int(self.joints.ticks[index]))
        self.put("present_speed", round(direction * self.joints.body.velocity[index] / self.servo.tick_rad))
        self.put("present_load", round(1000 * torque / self.servo.stall_torque))
        self.put("present_voltage", round(plant.voltage / VOLTAGE))
        self.put("present_temperature", min(round(plant.temperature[index]), 255))
        constant = self.servo.torque_constant or self.servo.stall_torque / self.servo.stall_current
        self.put("present_current", round(torque / constant / (self.servo.current_unit or math.inf)))

    def write(self, address: int, data: bytes) -> None:
        """Take data; read-only registers and a locked EEPROM stay as they are."""
        table = sts()
        for name, register in table.registers.items():
            if not address <= register.address or register.end > address + len(data) or register.access == "r":
                continue
            if register.address < table.eeprom_end and self.get("lock"):
                continue
            at = register.address - address
            self.memory[register.address : register.end] = data[at : at + register.size]
            self._act(name)

    def watch(self) -> None:
        """Let heat and voltage act."""
        plant = self.joints.body.plant
        status = 0
        if plant.temperature[self.index] > self.get("temperature_limit"):
            status |= OVERHEATING
            if self.get("torque_enable"):
                self.put("torque_enable", 0)
                self._act("torque_enable")
        if not self.servo.min_voltage <= plant.voltage <= self.servo.max_voltage:
            status |= INPUT_VOLTAGE
        self.put("status", status)

    def restart(self, now: float) -> None:
        """Lose power for a moment."""
        self.put("torque_enable", 0)
        self._act("torque_enable")
        self._pin()
        self.dark_until = now + 0.2

    def _act(self, name: str) -> None:
        joints, index = self.joints, self.index
        body = joints.body
        if name == "torque_enable":
            body.set_torque(np.arange(body.robot.n) == index, bool(self.get(name)))
        elif name == "torque_limit":
            joints.drive_share[index] = min(self.get(name) / 1000, 1.0)
            body.plant.set_drive_share(joints.drive_share)
        elif name == "p_gain":
            joints.gain_share[index] = self.get(name) / self.servo.gain_register
            body.plant.set_gain(body.robot.kp * joints.gain_share)
        elif name == "goal_position":
            ticks = min(max(self.get(name), self.get("min_position_limit")), self.get("max_position_limit"))
            robot = body.robot
            angle = (ticks - self.servo.centre_tick) * robot.tick_rad[index]
            joints.goal[index] = (angle - robot.zero[index]) * robot.direction[index]
            joints.fresh[index] = True
            joints.touch()

    def _pin(self) -> None:
        self.joints.refresh()
        self.put("goal_position", int(self.joints.ticks[self.index]))


class EmulatedFeetechBus:
    """See `drivers.emulator.line.EmulatedBus`."""

    def __init__(self, joints: Joints, servos: Iterable[StsServo]) -> None:
        self.joints, self.servos = joints, list(servos)
        self.dead: set[int] = set()
        self.heard = 0
        self.imu_ids: frozenset[int] = frozenset()
        self._decoder = SumDecoder(FORMAT)

    @property
    def bad(self) -> int:
        """Packets with a wrong sum."""
        return self._decoder.bad

    def hear(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """See `EmulatedBus`."""
        heard = []
        for packet in self._decoder.feed(data):
            self.heard += 1
            heard.append((packet.size, self._handle(packet, baud, now)))
            self.joints.commit()
        return heard

    def silence(self) -> None:
        """See `EmulatedBus`."""
        self._decoder.clear()

    def watch(self, now: float) -> None:
        """See `EmulatedBus`."""
        for servo in self.servos:
            servo.watch()

    def reset(self, id_: int, now: float) -> None:
        """See `EmulatedBus`."""
        for servo in self.servos:
            if servo.get("id") == id_:
                servo.restart(now)

    def _handle(self, packet: SumPacket, baud: int, now: float) -> list[Reply]:
        listening = {
            id_: servo
            for servo in self.servos
            if (id_ := servo.get("id")) not in self.dead
            and BAUD_RATES[servo.get("baud_rate")] == baud
            and now >= servo.dark_until
        }
        params = packet.params
        if packet.code == Instruction.SYNC_WRITE and len(params) > 2:
            address, step = params[0], params[1] + 1
            for at in range(2, len(params) - step + 1, step):
                if params[at] in listening:
                    listening[params[at]].write(address, params[at + 1 : at + step])
            return []
        if packet.code == Instruction.SYNC_READ and len(params) > 2:
            self.joints.refresh()
            return [self._read(listening[id_], params[0], params[1]) for id_ in params[2:] if id_ in listening]
        servo = listening.get(packet.id)
        if servo is None:
            return []
        if packet.code == Instruction.READ and len(params) == 2:
            self.joints.refresh()
            return [self._read(servo, params[0], params[1])]
        if packet.code == Instruction.WRITE and len(params) > 1:
            reply = self._reply(servo)
            servo.write(params[0], params[1:])
            return [] if packet.id == BROADCAST else [reply]
        return [self._reply(servo)] if packet.code == Instruction.PING else []

    def _read(self, servo: StsServo, address: int, size: int) -> Reply:
        servo.refresh()
        return self._reply(servo, bytes(servo.memory[address : address + size]))

    def _reply(self, servo: StsServo, data: bytes = b"") -> Reply:
        id_ = servo.get("id")
        delay = servo.get("return_delay") * RETURN_DELAY_US * 1e-6
        return Reply(id_, delay, FORMAT.encode(id_, servo.get("status"), data))
