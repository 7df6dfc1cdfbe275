"""`XServo`: one emulated Dynamixel of the X, MX or P series. Its registers act on one joint of a `Body`.

Emulated: operating modes 3 and 5 (position, current-based position), PWM and current limits, position gain, position
limits, homing offset, shutdown on hardware errors, bus watchdog, indirect registers, torque at start-up; what is
refused: `rules.yaml`. Without effect: profiles, reverse mode, integral, derivative and feed-forward gains.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import numpy as np

from flexmotion.configs.servo import Servo
from flexmotion.drivers.dynamixel.packet import Error
from flexmotion.drivers.dynamixel.registers import VOLTAGE, WATCHDOG_S, table_of
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.emulator.device import IDENTITY, STEERING, Device
from flexmotion.drivers.emulator.false_readings import FalseReadings

POSITION, CURRENT_POSITION = 3, 5
MODES = (POSITION, CURRENT_POSITION)

INPUT_VOLTAGE, OVERHEATING, OVERLOAD = 0x01, 0x04, 0x20
"""Bits of the hardware error status."""

TRIPPED = -1
"""Value of the bus watchdog register after it has tripped."""

MULTI_TURN = 1_048_575
"""Largest goal position in current-based position mode (e-Manual, Goal Position(116)) [servo units]."""

LARGEST_OFFSET = 0.25
"""Largest homing offset that position mode uses (e-Manual, Homing Offset(20)) [turns]."""

STARTUP_TORQUE = 0x01
"""Bit of the startup configuration: torque goes on at power-up (e-Manual, Startup Configuration(60))."""

RESET_BY_MODE = (
    *("velocity_i_gain", "velocity_p_gain", "position_d_gain", "position_i_gain", "position_p_gain"),
    *("feedforward_2nd_gain", "feedforward_1st_gain", "profile_acceleration", "profile_velocity"),
)
"""Registers that a change of the operating mode resets (e-Manual, Operating Mode(11), note)."""

FIRMWARE = 46

TICK_WRAP = 32768
"""The realtime tick counts milliseconds modulo this."""


class Joints:
    """State shared by all servos of a bus: the body, and goals that are not yet passed to it.

    Attributes:
        goal, bound: goals [rad] and torque bounds [N·m] in the servos' registers, (n,).
        fresh: servos with a new goal since the last `commit`, (n,) bool.
        ticks: positions at the last `refresh`, (n,) [servo units].
        present: of every joint at the last `measure`: position [ticks], velocity [rad/s], torque in the
            servo's direction [N·m], temperature [°C]. Plain numbers, because they are written to registers one by one.
        false_readings: what servos report wrongly.
    """

    def __init__(self, body: Body, false_readings: FalseReadings | None = None) -> None:
        self.body = body
        self.false_readings = FalseReadings() if false_readings is None else false_readings
        n = body.robot.n
        self.goal = body.receiver.goal.copy()
        self.bound = np.full(n, np.inf)
        self.fresh = np.zeros(n, np.bool_)
        self.gain_share, self.drive_share = np.ones(n), np.ones(n)
        self._changed = False
        self.ticks = np.zeros(n)
        self.present: list[tuple[int, float, float, int]] = []

    def touch(self) -> None:
        """Mark that a goal or a bound has changed."""
        self._changed = True

    def commit(self) -> None:
        """Pass changes to the body; called once per instruction, so that a sync write acts on all servos at once."""
        if self._changed:
            self.body.receive(self.goal, self.fresh, self.bound)
            self.fresh[:] = False
            self._changed = False

    def refresh(self) -> None:
        """Update `ticks`."""
        self.body.robot.to_ticks(self.body.position, out=self.ticks)

    def measure(self) -> None:
        """Update `present`."""
        self.refresh()
        body, plant = self.body, self.body.plant
        direction = body.robot.direction
        ticks, temperature = (np.rint(a).astype(int).tolist() for a in (self.ticks, plant.temperature))
        speed = (direction * body.velocity).tolist()
        self.present = list(zip(ticks, speed, (direction * plant.torque).tolist(), temperature, strict=True))


class XServo(Device):
    """The servo of joint `index`.

    Attributes:
        fed: time of the last instruction, for the bus watchdog [s].
    """

    def __init__(self, joints: Joints, index: int, id_: int, servo: Servo, *, firmware: int = FIRMWARE) -> None:
        self.joints, self.index, self.servo = joints, index, servo
        self.fed = -math.inf
        self._booted = False
        self._homing, self._goals = 0, (0, 0)
        super().__init__(table_of(servo.name), id_, servo.model_number or 0, firmware)
        self._booted = True
        self.put("temperature_limit", int(servo.temperature_limit))
        self._current = servo.current_unit
        # Consecutive in every series: PWM, current, velocity, position; supply, temperature; tick, moving.
        self._dynamic, self._supply, self._clock = (
            self.table[name].address for name in ("present_pwm", "present_input_voltage", "realtime_tick")
        )
        self._speed_unit, self._full_pwm = self.table.velocity_unit, self.table.full_pwm
        self._errors, self._watchdog = self.table["hardware_error_status"].address, self.table["bus_watchdog"].address
        self._torque_enable = self.table["torque_enable"].address
        self._newton_metre = servo.torque_constant or servo.stall_torque / servo.stall_current
        # Present load is a current if the servo measures it, else per mille of the stall torque.
        amperes = self._current
        self._load_per_torque = 1000 / servo.stall_torque if amperes is None else 1 / (self._newton_metre * amperes)
        self._pwm_per_torque = self._full_pwm / servo.stall_torque
        self._largest_torque = 32767 / max(self._pwm_per_torque, self._load_per_torque)
        robot = joints.body.robot
        direction = float(robot.direction[index])
        self._angle_per_tick = float(robot.tick_rad[index]) * direction
        self._angle_at_zero = -servo.centre_tick * self._angle_per_tick - float(robot.zero[index]) * direction
        prefix = "_on_"
        self._handlers: dict[str, Callable[[int], int]] = {
            name.removeprefix(prefix): getattr(self, name) for name in dir(type(self)) if name.startswith(prefix)
        }
        self._moving_threshold = self.get("moving_threshold")
        self._pin()

    @property
    def torque(self) -> bool:
        """Whether torque is on."""
        return self.memory[self._torque_enable] == 1

    @property
    def _tripped(self) -> bool:
        """Whether the bus watchdog has tripped; goals are refused until it is cleared."""
        return self.memory[self._watchdog] == TRIPPED & 0xFF

    @property
    def locked(self) -> bool:
        """See `Device`. The EEPROM is locked while torque is on."""
        return self.torque

    @property
    def alert(self) -> bool:
        """See `Device`. Set while the hardware error status is not 0."""
        return self.memory[self._errors] != 0

    def feed(self, now: float) -> None:
        """Reset the bus watchdog: an instruction was received."""
        self.fed = now

    def refresh(self, now: float) -> None:
        """See `Device`."""
        ticks, speed, torque, temperature = self.joints.present[self.index]
        ticks += self._homing
        volts = round(self.joints.body.plant.voltage / VOLTAGE)
        error = self.joints.false_readings.of_servo(self.index)
        if error is not None:
            ticks, speed = ticks + round(error.position), speed + error.speed
            torque += error.torque
            volts = max(volts + round(error.voltage / VOLTAGE), 0)
            torque = min(max(torque, -self._largest_torque), self._largest_torque)
            temperature = min(max(temperature + round(error.temperature), 0), 255)
        pwm, load = round(torque * self._pwm_per_torque), round(torque * self._load_per_torque)
        units = round(speed / self._speed_unit)
        struct.pack_into("<hhii", self.memory, self._dynamic, pwm, load, units, ticks)
        struct.pack_into("<HB", self.memory, self._supply, volts, temperature)
        struct.pack_into(
            "<HB", self.memory, self._clock, int(now * 1000) % TICK_WRAP, abs(units) > self._moving_threshold
        )

    def written(self, name: str, value: int) -> int:
        """See `Device`."""
        handler = self._handlers.get(name)
        return handler(value) if handler is not None else Error.NONE

    def watch(self, now: float) -> None:
        """Update hardware errors and the bus watchdog."""
        plant, index = self.joints.body.plant, self.index
        known = self.get("hardware_error_status")
        error = known & ~INPUT_VOLTAGE
        if plant.temperature[index] > self.get("temperature_limit"):
            error |= OVERHEATING
        volts = round(plant.voltage / VOLTAGE)
        if not self.get("min_voltage_limit") <= volts <= self.get("max_voltage_limit"):
            error |= INPUT_VOLTAGE
        if error != known:
            self.fail(error)
        units = self.get("bus_watchdog")
        if units > 0 and self.torque and now - self.fed > units * WATCHDOG_S:
            self.trip()

    def trip(self) -> None:
        """Let the bus watchdog trip: the servo holds its position and refuses goals."""
        self.put("bus_watchdog", TRIPPED)
        self._stop_here()

    def fail(self, error: int) -> None:
        """Set the hardware error status; errors in the shutdown register switch torque off until a reboot."""
        self.put("hardware_error_status", error)
        if error & self.get("shutdown") and self.torque:
            self._set_torque(False)
            self.put("torque_enable", 0)

    def reboot(self, now: float, seconds: float = 0.2) -> None:
        """See `Device`. Torque goes off and hardware errors are cleared."""
        self._set_torque(False)
        super().reboot(now, seconds)
        self.put("hardware_error_status", 0)
        self._pin()
        self._apply_shares()
        if "startup_configuration" in self.table and self.get("startup_configuration") & STARTUP_TORQUE:
            self.put("torque_enable", 1)
            self._set_torque(True)

    # ---------------------------------------------------------------- writing registers

    def _on_torque_enable(self, value: int) -> int:
        if value and self.get("hardware_error_status") & self.get("shutdown"):
            return self.refuse("in_shutdown")
        self._set_torque(bool(value))
        return Error.NONE

    def _on_operating_mode(self, value: int) -> int:
        if value not in self.table.modes:
            return self.refuse("out_of_range")
        if value not in MODES or (value == CURRENT_POSITION and "goal_current" not in self.table):
            return self.refuse("mode_not_emulated")
        if value != self.get("operating_mode"):
            for name in RESET_BY_MODE:
                if name in self.table:
                    self.put(name, self.table[name].initial)
            self._take_limits()
            self._apply_shares()
        return Error.NONE

    def _on_bus_watchdog(self, value: int) -> int:
        return self.refuse("cleared_by_zero") if self._tripped and value else int(Error.NONE)

    def _on_goal_velocity(self, value: int) -> int:
        if self._tripped:
            return self.refuse("tripped")
        return self.refuse("over_limit") if abs(value) > self.get("velocity_limit") else int(Error.NONE)

    def _on_goal_position(self, value: int) -> int:
        if self._tripped:
            return self.refuse("tripped")
        joints, index = self.joints, self.index
        if not self._goals[0] <= value <= self._goals[1]:
            if self.get("operating_mode") == CURRENT_POSITION:
                return self.refuse("out_of_range")
            joints.body.receiver.position_violations += int(self.torque)
            return self.refuse("over_limit")
        joints.goal[index] = (value - self._homing) * self._angle_per_tick + self._angle_at_zero
        joints.fresh[index] = True
        joints.touch()
        return Error.NONE

    def _on_goal_current(self, value: int) -> int:
        if self._tripped:
            return self.refuse("tripped")
        if abs(value) > self.get("current_limit"):
            return self.refuse("over_limit")
        self._bound(value)
        return Error.NONE

    def _on_goal_pwm(self, value: int) -> int:
        if self._tripped:
            return self.refuse("tripped")
        if abs(value) > self.get("pwm_limit"):
            return self.refuse("over_limit")
        self.joints.drive_share[self.index] = abs(value) / self._full_pwm
        self.joints.body.plant.set_drive_share(self.joints.drive_share)
        return Error.NONE

    def _on_position_p_gain(self, value: int) -> int:
        joints = self.joints
        joints.gain_share[self.index] = value / self.servo.gain_register
        joints.body.plant.set_gain(joints.body.robot.kp * joints.gain_share)
        return Error.NONE

    # ---------------------------------------------------------------- acting

    def _identify(self, changed: str) -> None:
        """See `Device`. Present position = actual position + homing offset.

        Position mode ignores large offsets, and it alone uses the position limits (e-Manual, Homing Offset(20), Min/Max
        Position Limit(52, 48)).
        """
        super()._identify(changed)
        if changed in STEERING and changed not in IDENTITY:
            offset, mode = self.get("homing_offset"), self.get("operating_mode")
            ignored = mode == POSITION and abs(offset) > LARGEST_OFFSET * self.servo.ticks_per_turn
            self._homing = 0 if ignored else offset
            limits = self.get("min_position_limit"), self.get("max_position_limit")
            self._goals = (-MULTI_TURN, MULTI_TURN) if mode == CURRENT_POSITION else limits

    def _set_torque(self, on: bool) -> None:
        if not self._booted:
            return
        which = np.zeros(self.joints.body.robot.n, np.bool_)
        which[self.index] = True
        if on:
            self._bound(self.get("goal_current") if "goal_current" in self.table else 0)
            self._apply_shares()
        self.joints.body.set_torque(which, on)

    def _bound(self, units: int) -> None:
        """Set the torque bound from a goal current, if the operating mode uses it."""
        if self._current is None or self.get("operating_mode") != CURRENT_POSITION:
            bound = math.inf
        else:
            bound = abs(units) * self._current * self._newton_metre
        self.joints.bound[self.index] = bound
        self.joints.touch()

    def _apply_shares(self) -> None:
        self._on_position_p_gain(self.get("position_p_gain"))
        self.joints.drive_share[self.index] = abs(self.get("goal_pwm")) / self._full_pwm
        self.joints.body.plant.set_drive_share(self.joints.drive_share)

    def _stop_here(self) -> None:
        """Hold the present position, as after the bus watchdog has tripped."""
        self._pin()
        self.joints.touch()

    def _pin(self) -> None:
        """Set the goal to the present position, as after power-up."""
        joints, index = self.joints, self.index
        joints.goal[index] = joints.body.position[index]
        joints.refresh()
        self.put("goal_position", int(joints.ticks[index]) + self._homing)
