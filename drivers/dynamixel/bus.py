"""`DynamixelBus`: servos of Protocol 2.0 on one port."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import attempts
from flexmotion.drivers.bus.inspection import refuse_unconfigured
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.bus.servo_bus import WATCHDOG_TRIPS, Budget, ServoBus
from flexmotion.drivers.dynamixel import setup
from flexmotion.drivers.dynamixel.budget import cycle_budget
from flexmotion.drivers.dynamixel.exchange import ReadMany
from flexmotion.drivers.dynamixel.goals import GoalPacket
from flexmotion.drivers.dynamixel.layout import Layout, Span, layout_of
from flexmotion.drivers.dynamixel.opencr import board_of
from flexmotion.drivers.dynamixel.read_cycle import PATIENCE_S, ReadCycle
from flexmotion.drivers.dynamixel.register_read import read_registers
from flexmotion.drivers.dynamixel.register_write import write_registers
from flexmotion.drivers.dynamixel.registers import VOLTAGE, WATCHDOG_S, table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.imu.interface import do_without
from flexmotion.drivers.plant import DAMPED_SHARE
from flexmotion.drivers.port import SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

LATE_S = 0.05
"""Time beyond that on the wire that the confirmation of torque off may take: answers that are late count there [s]."""

TRIPPED, MOST_TRIPS = -1, 3
"""Value of a watchdog that has tripped, and times that it is cleared before it is an error."""

RECENT_SHARE = 0.5
"""Age up to which the positions of the last cycle are used to pin goals [ticks]."""

_READ_BACK = ("position_p_gain", "bus_watchdog", "goal_pwm", "goal_position")
"""Registers that are read back before torque goes on, in the order of their addresses."""

log = logging.getLogger(__name__)


class DynamixelBus(ServoBus):
    """Sync write of goals, fast sync read of everything else, one of each per tick for each layout of registers.

    The bus watchdog of every servo is armed while torque is on: a servo that receives nothing for `watchdog_ms` of the
    robot file stops where it is, with torque on, and takes no goals until the watchdog is cleared.

    Attributes:
        cycle: reads the servos.
        current_limit: greatest goal current that each servo takes, read from the servo, (m,) [servo units].
        position_limits: least and greatest goal position, read from the servos, (2, m) [servo units].
    """

    protocol = "dynamixel2"
    restarts = True

    def __init__(self, robot: Robot, name: str, port: SerialPort, options: BusOptions) -> None:
        super().__init__(robot, name, port, options)
        m = len(self.joints)
        self._client = Client(port)
        self._slot = {id_: slot for slot, id_ in enumerate(self.ids)}
        self._tables = [table_of(servo.name) for servo in self.servos]
        self._layouts = [layout_of(table, current_bound=self.config.current_bound) for table in self._tables]
        self._board = board_of(robot, name)
        self._units = round(self.config.watchdog_ms * 1e-3 / WATCHDOG_S)
        self._gains = np.array([robot.joints[i].p_gain or robot.servos[i].gain_register for i in self.joints])
        self._pwm = np.array([table.full_pwm for table in self._tables])
        self.current_limit = np.full(m, np.inf)
        self.position_limits = np.stack([np.full(m, -np.inf), np.full(m, np.inf)])
        self._goals = [
            GoalPacket(layout, self._slots_with(layout), self.ids, self.torque_per_unit)
            for layout in dict.fromkeys(self._layouts)
        ]
        self._bounded, self._last_bound = any(goals.bounded for goals in self._goals), np.full(m, np.nan)
        self.cycle = ReadCycle(
            port,
            self.config,
            self.ids,
            self.measured,
            self.torque_per_unit,
            np.array([table.velocity_unit for table in self._tables]),
            max(600.0 / robot.rate_hz, 2.0),
        )
        self._wrote_at = 0.0
        self._on = False
        self._trips = np.zeros(m, np.int64)
        self._rearm = 0

    @classmethod
    def check(cls, robot: Robot, name: str) -> None:
        """See `ServoBus`. The baud rate must be one that these servos support."""
        super().check(robot, name)
        setup.check_settings(robot, name)

    @classmethod
    def bounds_torque(cls, robot: Robot) -> bool:
        """True if the robot file asks for it on every bus and every servo controls its current."""
        return all(bus.current_bound for bus in robot.config.buses.values()) and all(
            servo.current_unit is not None for servo in robot.servos
        )

    @classmethod
    def carries_imu(cls, robot: Robot, name: str) -> bool:
        """True if the robot's IMU is the OpenCR board on this bus."""
        return board_of(robot, name) is not None

    @classmethod
    def budget(cls, robot: Robot, name: str) -> Budget:
        """See `ServoBus`. Servos that support fast sync reads are assumed to answer them."""
        return cycle_budget(robot, name)

    # ---------------------------------------------------------------- before the first tick

    def look(self) -> None:
        """See `ServoBus`."""
        board = self._board
        if board is None or board.find(self._client) is not None or board.powered(self._client):
            with contextlib.suppress(setup.UnreadableError):
                self._find()

    def audit(self) -> None:
        """See `ServoBus`."""
        if self._board is not None:
            # Only a silent board is tolerated: another device at its address, or a power switch that does not switch,
            # is an error.
            missing = self._board.find(self._client)
            if missing is None:
                self._board.audit(self._client)
            else:
                do_without(self._board.config, missing)
                self._board = None
        self.imu = self._board
        # First of all, so that reads and writes are answered; this write itself is not.
        self._write_all("status_return_level", setup.ANSWER_ALL)
        found = self._find()
        fast: dict[tuple[Span, bool], list[int]] = {}
        for slot, (joint, layout) in enumerate(zip(self.joints, self._layouts, strict=True)):
            ready = setup.prepare(self._client, self.robot, int(joint), layout, found[slot])
            self.current_limit[slot], self.position_limits[:, slot] = ready.current_limit, ready.position_limits
            self.temperature_limit[slot] = found[slot].value("temperature_limit")
            self.voltage_limit[slot] = found[slot].value("min_voltage_limit") * VOLTAGE
            self.guard.limit(slot, *ready.position_limits, ready.current_limit)
            fast.setdefault((layout.read, ready.fast), []).append(self.ids[slot])
        groups = [ReadMany(ids, span, fast=quick, where=f"bus {self.name}") for (span, quick), ids in fast.items()]
        self.cycle.set_up(groups, self._board)
        answered = self.cycle.learn_clocks()
        if not answered.all():
            silent = self.joint_name(int(np.argmin(answered)))
            raise DriverError(f"{silent} on {self.port.path}: does not answer sync reads")

    def _find(self) -> list[setup.Found]:
        """Every servo of the bus, as it was read. Raises as `audit`."""
        found = [setup.find(self._client, self.robot, int(joint)) for joint in self.joints]
        refuse_unconfigured([each.inspection for each in found])
        return found

    # ---------------------------------------------------------------- the cycle

    def request(self, now: float) -> None:
        """See `ServoBus`."""
        self.cycle.request(now)

    def receive(self, now: float) -> bool:
        """See `ServoBus`."""
        return self.cycle.receive(now)

    @property
    def patience(self) -> float:
        """See `ServoBus`."""
        return self.cycle.patience

    @property
    def due(self) -> float:
        """See `ServoBus`."""
        return self.cycle.due

    def finish(self) -> None:
        """See `ServoBus`. Watchdogs that have tripped are cleared: their servos refuse goals."""
        self.cycle.finish()
        tripped = self.measured.watchdog == TRIPPED if self._on and self.cycle.read_watchdogs else None
        if tripped is None or not tripped.any():
            return
        self.measured.watchdog[tripped] = 0  # until they are read again
        self._trips[tripped] += 1
        self._rearm = 2
        # They have stopped where they were; the next goals begin there, inside the envelope.
        np.copyto(self.pins, self.guard.nearest(self.measured.ticks), where=tripped & self.measured.fresh)
        for slot in np.flatnonzero(tripped):
            log.warning("%s: its bus watchdog has tripped, goals were refused: cleared", self.joint_name(int(slot)))
        self.measured.error[self._trips > MOST_TRIPS] |= WATCHDOG_TRIPS

    # ---------------------------------------------------------------- goals and torque

    def send_goals(self, ticks: Float, bound: Float) -> None:
        """See `ServoBus`. Nothing is sent while torque is off."""
        if not self._on:
            return
        now = self.port.now()
        if now - max(self._wrote_at, self.cycle.last_traffic) > self._units * WATCHDOG_S * 0.9:
            log.warning("bus %s: the loop was silent for longer than the bus watchdog: watchdogs cleared", self.name)
            self._rearm = 2
        if self._rearm:
            # Sent twice: a sync write is not acknowledged.
            self._rearm -= 1
            self._write_all("bus_watchdog", 0)
            self._write_all("bus_watchdog", self._units)
        self._send(ticks, bound)
        self._wrote_at = now

    def switch_on(self) -> None:
        """See `ServoBus`. Goals, watchdogs, gains and PWM limits are read back before torque goes on."""
        measured, every = self.measured, np.ones(len(self.ids), np.bool_)
        recent = self.port.now() - self.cycle.began < RECENT_SHARE / self.robot.rate_hz
        held = np.ones((len(self.ids), len(_READ_BACK)), np.bool_)
        for _ in attempts(self.port):
            if not (recent and measured.fresh.all()):
                self.cycle.run()
            recent = False
            if not measured.fresh.all():
                continue
            self._write_all("bus_watchdog", 0)
            self._write_all("bus_watchdog", self._units)
            self._set_softness(1.0)  # a servo whose watchdog has tripped refuses the goal PWM until it is cleared
            self._pin()
            held = self._held()
            if held.all():
                self._on = True
                self._rearm = 0
                self._trips.fill(0)
                self.measured.watchdog.fill(0)
                self._switch(every, on=True)
                return
        if measured.fresh.all():
            wrong = int(np.argmin(held.all(axis=1)))
            what = f"does not confirm {_READ_BACK[int(np.argmin(held[wrong]))]}"
        else:
            wrong, what = int(np.argmin(measured.fresh)), "does not answer"
        raise DriverError(f"{self.joint_name(wrong)} on {self.port.path}: {what}: torque stays off")

    def repeat_on(self, off: Bool) -> None:
        """See `ServoBus`."""
        if off.any():
            ticks = np.clip(self.measured.ticks, *self.position_limits)
            self._send(np.where(off, ticks, self.guard.last), self._last_bound, np.where(off, ticks, np.nan))
            self._switch(off, on=True)

    def switch(self, which: Bool, on: bool) -> None:
        """See `ServoBus`. Goals to a servo without torque are kept, and do not switch it on."""
        if not which.any():
            return
        if on:
            self.repeat_on(which)
        else:
            self._switch(which, on=False)
        self.measured.torque[which] = on

    def restart(self, slot: int) -> Iterator[None]:
        """See `ServoBus`."""
        return setup.restart(self._client, self.robot, int(self.joints[slot]), self._layouts[slot])

    def send_off(self) -> None:
        """See `ServoBus`."""
        self._on = False
        self._switch(np.ones(len(self.ids), np.bool_), on=False)

    def torque_is_off(self, asked: Bool, until: float) -> Bool:
        """See `ServoBus`. All are asked at once."""
        return self._registers(("torque_enable",), min(LATE_S, until - self.port.now()))[:, 0] == 0

    def confirm_off(self, until: float) -> None:
        """See `ServoBus`. Watchdogs are switched off after it: they would trip."""
        super().confirm_off(until)
        self._write_all("bus_watchdog", 0)

    def damp(self) -> None:
        """See `ServoBus`. Position gain and PWM limit are lowered to `DAMPED_SHARE`; sent twice.

        They come first: on a bus that does not answer, the positions to which goals are pinned are old.
        """
        for _ in range(2):
            self._set_softness(DAMPED_SHARE)
            self._send(self.guard.nearest(self.measured.ticks), np.full(len(self.ids), np.nan))

    # ---------------------------------------------------------------- packets

    def _slots_with(self, layout: Layout) -> NDArray[np.int64]:
        return np.array([slot for slot, other in enumerate(self._layouts) if other == layout], np.int64)

    def _pin(self) -> None:
        """Set every goal to the present position, clipped to the servo's own limits."""
        ticks = self.measured.ticks
        self._send(np.clip(ticks, *self.position_limits), np.full(len(ticks), np.nan), standing=ticks)

    def _send(self, ticks: Float, bound: Float, standing: Float | None = None) -> None:
        """Send goals of the whole bus; `standing`: position of servos that are pinned, NaN for the others, (m,)."""
        for goals in self._goals:
            packet = goals.encode(ticks, bound, self.current_limit)
            slots, position, current = goals.decode(packet)
            if standing is not None or not self.guard.admits(slots, position, current):
                at = np.array(slots)
                admitted = self.guard.admit(
                    at,
                    np.array(position, np.float64),
                    np.array(current, np.float64) if current else None,
                    None if standing is None else standing[at],
                )
                if (admitted != position).any():
                    ticks = ticks.copy()
                    ticks[at] = admitted
                    packet = goals.encode(ticks, bound, self.current_limit)
            self.port.send(packet)
        if self._bounded:
            np.copyto(self._last_bound, bound)
        if standing is not None:
            np.copyto(self.pins, ticks, where=np.isfinite(standing))

    def _write_all(self, name: str, value: int | NDArray[np.int64], which: Bool | None = None) -> None:
        """Set a register of all servos, or of those in `which`; one value, or one of each, (m,)."""
        write_registers(self.port, self.ids, self._tables, name, value, which)
        self._wrote_at = self.port.now()

    def _switch(self, which: Bool, *, on: bool) -> None:
        self._write_all("torque_enable", int(on), which)

    def _set_softness(self, share: float) -> None:
        """Set position gain and PWM limit of all servos to a share of those of a run."""
        self._write_all("position_p_gain", np.rint(share * self._gains).astype(np.int64))
        self._write_all("goal_pwm", np.rint(share * self._pwm).astype(np.int64))

    def _held(self) -> Bool:
        """Which registers have the values of a run, with an armed watchdog and the goals of `_pin`, (m, _READ_BACK)."""
        m = len(self.ids)
        wanted = np.stack([self._gains, np.full(m, self._units), self._pwm, self.guard.last], axis=1)
        return self._registers(_READ_BACK, PATIENCE_S) == wanted

    def _registers(self, names: Sequence[str], slack: float) -> Float:
        """Read registers of all servos, from the first named to the last, blocking; (m, names), NaN without an answer.

        Args:
            slack: time beyond that on the wire that the answers may take [s].
        """
        return read_registers(self.cycle, self.port, self.ids, self._tables, names, slack)
