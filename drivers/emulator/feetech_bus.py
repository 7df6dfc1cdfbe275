"""`EmulatedFeetechBus`: servos of Feetech's STS series that receive and answer packets."""

from __future__ import annotations

import math

import numpy as np

from flexmotion.configs.servo import Servo
from flexmotion.drivers.bus.packet import BROADCAST, SumPacket
from flexmotion.drivers.emulator.servo import Joints
from flexmotion.drivers.emulator.sum_bus import SumBus, SumServo
from flexmotion.drivers.emulator.wire import Reply
from flexmotion.drivers.feetech.registers import BAUD_RATES, FORMAT, VOLTAGE, Instruction, sts
from flexmotion.drivers.feetech.setup import SEVERAL_TURNS
from flexmotion.drivers.random_errors import ServoError

RETURN_DELAY_US = 2.0
INPUT_VOLTAGE, OVERHEATING = 0x01, 0x04


class StsServo(SumServo):
    """One servo. Torque limit, lock, position limits, homing offset, resolution and turns are emulated, profiles not.

    Present position = actual position - homing offset; goals are in the same frame.

    Attributes:
        memory: the control table, byte by byte.
    """

    def __init__(self, joints: Joints, index: int, id_: int, servo: Servo) -> None:
        super().__init__("feetech")
        self.joints, self.index, self.servo = joints, index, servo
        self.memory = bytearray(128)
        for name, register in sts().registers.items():
            self.put(name, register.initial)
        self.put("id", id_)
        self.put("model_number", servo.model_number or 0)
        self._pin()

    @property
    def address(self) -> int:
        """See `SumServo`."""
        return self.get("id")

    @property
    def baud(self) -> int:
        """See `SumServo`."""
        return BAUD_RATES[self.get("baud_rate")]

    def get(self, name: str) -> int:
        """A register's value."""
        register = sts()[name]
        return register.unpack(self.memory[register.address : register.end])

    def put(self, name: str, value: int) -> None:
        """Set a register, without the rules for writes."""
        register = sts()[name]
        self.memory[register.address : register.end] = register.pack(value)

    def refresh(self) -> None:
        """Update the measurements in the table."""
        plant, index, robot = self.joints.body.plant, self.index, self.joints.body.robot
        direction = robot.direction[index]
        error = self.joints.false_readings.of_servo(index) or ServoError()
        torque = direction * plant.torque[index] + error.torque
        speed = direction * self.joints.body.velocity[index] + error.speed
        constant = self.servo.torque_constant or self.servo.stall_torque / self.servo.stall_current
        self._report("present_position", self._present() + error.position)
        self._report("present_speed", speed / self.servo.tick_rad)
        self._report("present_load", 1000 * torque / self.servo.stall_torque)
        self._report("present_voltage", (plant.voltage + error.voltage) / VOLTAGE)
        self._report("present_temperature", plant.temperature[index] + error.temperature)
        self._report("present_current", torque / constant / (self.servo.current_unit or math.inf))

    def write(self, address: int, data: bytes) -> None:
        """Write data; read-only registers and locked EEPROM keep their values."""
        table = sts()
        end = address + len(data)
        for name, register in table.registers.items():
            if not (register.address < end and address < register.end):
                continue
            kept = register.address < table.eeprom_end
            if register.access == "r":
                self.refusals.note("read_only")
                continue
            if register.address < address or register.end > end:
                self.refusals.note("written_in_part")
                continue
            if kept and self.get("lock"):
                self.refusals.note("eeprom_locked")
                continue
            self.eeprom_writes += kept
            self.ram_writes += not kept
            at = register.address - address
            self.memory[register.address : register.end] = data[at : at + register.size]
            self._act(name)

    def watch(self) -> None:
        """See `SumServo`."""
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
        """See `SumServo`."""
        self.put("torque_enable", 0)
        self._act("torque_enable")
        self.put("torque_limit", self.get("max_torque"))
        self._act("torque_limit")
        self._pin()
        self.off_until = now + 0.2

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
            lower, upper = self.get("min_position_limit"), self.get("max_position_limit")
            ticks = self.get(name)
            if (lower or upper) and not lower <= ticks <= upper:  # both 0: no limits, several turns
                ticks = min(max(ticks, lower), upper)
                self.refusals.note("goal_clipped")
            ticks = (ticks + self.get("homing_offset")) * max(self.get("angle_resolution"), 1)
            robot = body.robot
            angle = (ticks - self.servo.centre_tick) * robot.tick_rad[index]
            joints.goal[index] = (angle - robot.zero[index]) * robot.direction[index]
            joints.fresh[index] = True
            joints.touch()

    def _present(self) -> float:
        """Position in its own units: of one turn, or over several with that bit of the phase."""
        ticks = float(self.joints.ticks[self.index])
        if not self.get("phase") & SEVERAL_TURNS:
            ticks %= self.servo.ticks_per_turn
        return ticks / max(self.get("angle_resolution"), 1) - self.get("homing_offset")

    def _report(self, name: str, value: float) -> None:
        """Set a measured register to the nearest value that it can hold."""
        register = sts()[name]
        signed = register.sign_bit is not None
        largest = (1 << (register.sign_bit if register.sign_bit is not None else 8 * register.size)) - 1
        self.put(name, min(max(round(value), -largest if signed else 0), largest))

    def _pin(self) -> None:
        self.joints.refresh()
        self.put("goal_position", int(self._present()))


class EmulatedFeetechBus(SumBus[StsServo]):
    """Servos of the STS series."""

    form = FORMAT

    def answer(self, packet: SumPacket, listening: dict[int, StsServo]) -> list[Reply]:
        """See `SumBus`."""
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
