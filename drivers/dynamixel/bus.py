"""`DynamixelBus`: servos of Protocol 2.0 on one port."""

from __future__ import annotations

import logging
import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import TRIES, attempts
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.bus.servo_bus import Budget, ServoBus
from flexmotion.drivers.dynamixel.cycle import Exchange, ReadMany, ReadOne
from flexmotion.drivers.dynamixel.layout import FAST_ROW, ROW, Layout, Span, goal_row, layout_of
from flexmotion.drivers.dynamixel.opencr import OpenCr
from flexmotion.drivers.dynamixel.packet import BROADCAST, Instruction, encode, sync_write_rows
from flexmotion.drivers.dynamixel.registers import BAUD_RATES, VELOCITY_RPM, VOLTAGE, WATCHDOG_S, table_of
from flexmotion.drivers.dynamixel.sdk import Client
from flexmotion.drivers.dynamixel.setup import audit
from flexmotion.drivers.dynamixel.staleness import ReplyClock
from flexmotion.drivers.imu.interface import do_without
from flexmotion.drivers.plant import DAMPED_SHARE
from flexmotion.drivers.port import BITS_A_BYTE, SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]
Slots = NDArray[np.int64]

PATIENCE_S, SHORT_PATIENCE_S = 0.003, 0.0015
"""Time beyond that on the wire that answers may take; the short one while something is missing anyway [s]."""

LEARNING_CYCLES = 8
"""Cycles at `open` from which the servos' clocks are learnt."""

RECENT_SHARE = 0.5
"""Share of a tick for which the last cycle's positions are recent enough to pin goals to."""

_RAD_S = VELOCITY_RPM * 2 * math.pi / 60

log = logging.getLogger(__name__)


class DynamixelBus(ServoBus):
    """Sync write of goals, fast sync read of everything else, one of each a tick for each family of servos.

    The bus watchdog of every servo is armed while torque is on: a servo that hears nothing for the time that the robot
    file says stays where it is, with torque on, and takes no goals until the watchdog is cleared.

    Attributes:
        current_limit: the greatest goal current that each servo takes, as it told, (m,) in its units.
        position_limits: least and greatest goal position, as it told, (2, m) in its units.
    """

    protocol = "dynamixel2"

    def __init__(self, robot: Robot, name: str, port: SerialPort, options: BusOptions) -> None:
        super().__init__(robot, name, port, options)
        m = len(self.joints)
        self._client = Client(port)
        self._slot = {id_: slot for slot, id_ in enumerate(self.ids)}
        self._slot_of = np.zeros(256, np.int64)
        self._slot_of[self.ids] = np.arange(m)
        self._layouts = [layout_of(table_of(s.name), current_bound=self.config.current_bound) for s in self.servos]
        self._board = _board(robot, name)
        self._units = round(self.config.watchdog_ms * 1e-3 / WATCHDOG_S)
        self._torque_per_unit = np.array(
            [
                (s.current_unit or math.nan) * (s.torque_constant or s.stall_torque / s.stall_current)
                for s in self.servos
            ]
        )
        self._gains = np.array([robot.joints[i].p_gain or robot.servos[i].gain_register for i in self.joints])
        self.current_limit = np.full(m, np.inf)
        self.position_limits = np.stack([np.full(m, -np.inf), np.full(m, np.inf)])
        self._slots: dict[bytes, Slots | slice] = {}
        self._goals = [_Goals(self, layout) for layout in dict.fromkeys(self._layouts)]
        self._groups: list[ReadMany] = []
        self._exchanges: list[Exchange] = []
        self._pending: list[Exchange] = []
        self._clock = ReplyClock(m, oldest_ms=max(600.0 / robot.rate_hz, 2.0))
        self._learning = False
        self._begun = self._patience = self._heard_at = self._spoke_at = 0.0
        self._complete = True
        self._on = self._damped = False
        self._rearm = 0

    @classmethod
    def check(cls, robot: Robot, name: str) -> None:
        """See `ServoBus`; and the baud rate must be one that these servos have."""
        super().check(robot, name)
        baud = robot.config.buses[name].baud
        if baud not in BAUD_RATES:
            raise ConfigError(f"{robot.file}: field buses.{name}.baud: {baud}, expected one of {list(BAUD_RATES)}")

    @classmethod
    def bounds_torque(cls, robot: Robot) -> bool:
        """Where the robot file asks for it on every bus, and every servo controls its current."""
        return all(bus.current_bound for bus in robot.config.buses.values()) and all(
            servo.current_unit is not None for servo in robot.servos
        )

    @classmethod
    def carries_imu(cls, robot: Robot, name: str) -> bool:
        """OP3's OpenCR board."""
        return _board(robot, name) is not None

    @classmethod
    def budget(cls, robot: Robot, name: str) -> Budget:
        """See `ServoBus`; all that can answer fast sync reads does."""
        config = robot.config.buses[name]
        delay = config.return_delay_us * 1e-6
        tables: dict[tuple[Span, bool], list[int]] = {}
        writes: dict[Span, int] = {}
        for joint, servo in zip(robot.joints, robot.servos, strict=True):
            if joint.bus == name:
                table = table_of(servo.name)
                layout = layout_of(table, current_bound=config.current_bound)
                fast = table.fast_sync_read_firmware is not None
                tables.setdefault((layout.read, fast), []).append(joint.id)
                writes[layout.write] = writes.get(layout.write, 0) + 1
        reads: list[Exchange] = [ReadMany(ids, span, fast=fast, where=name) for (span, fast), ids in tables.items()]
        board = _board(robot, name)
        if board is not None:
            reads.append(ReadOne(board.id, board.span))
        byte_s = BITS_A_BYTE / config.baud
        write_bytes = sum(len(_sync_write(span, bytes((span.size + 1) * many))) for span, many in writes.items())
        read_bytes = sum(sum(exchange.sizes) for exchange in reads)
        delays = sum(exchange.delays for exchange in reads) * delay
        return Budget(read_bytes, write_bytes, read_bytes * byte_s + delays, write_bytes * byte_s)

    # ---------------------------------------------------------------- before the first tick

    def audit(self) -> None:
        """See `ServoBus`."""
        if self._board is not None:
            # Only its silence can be done without: another device at its address, or a power switch that does not
            # switch, is a fault of the robot.
            missing = self._board.find(self._client)
            if missing is None:
                self._board.audit(self._client)
            else:
                do_without(self._board.config, missing)
                self._board = None
        self.imu = self._board
        fast: dict[tuple[Span, bool], list[int]] = {}
        changes: dict[int, tuple[str, ...]] = {}
        for joint, id_, layout in zip(self.joints, self.ids, self._layouts, strict=True):
            found = audit(self._client, self.robot, int(joint), layout, configure=self.options.configure)
            slot = self._slot[id_]
            changes[slot] = found.changes
            self.current_limit[slot], self.position_limits[:, slot] = found.current_limit, found.position_limits
            self.witness.limit(slot, *found.position_limits, found.current_limit)
            fast.setdefault((layout.read, found.fast), []).append(id_)
        self.tell_changes(changes)
        self._groups = [
            ReadMany(ids, span, fast=quick, where=f"bus {self.name}") for (span, quick), ids in fast.items()
        ]
        self._exchanges = [*self._groups]
        if self._board is not None:
            self._exchanges.append(ReadOne(self._board.id, self._board.span))
        self._learn_clocks()

    def _learn_clocks(self) -> None:
        """Cycles of a bus at rest, from which the clocks of the servos are known. Raises where one is silent."""
        self._clock.begin()
        self._learning = True
        heard = np.zeros(len(self.ids), np.bool_)
        for _ in range(LEARNING_CYCLES):
            self._run_cycle()
            heard |= self.measured.fresh
        self._learning = False
        if not heard.all():
            raise DriverError(f"{self.joint_name(int(np.argmin(heard)))} on {self.port.path}: answers no sync read")

    # ---------------------------------------------------------------- the cycle

    def request(self, now: float) -> None:
        """See `ServoBus`."""
        self.port.receive()  # late answers to what was asked before
        self.measured.fresh[:] = False
        if self._board is not None:
            self._board.forget()
        self._pending = list(self._exchanges)
        for exchange in self._exchanges:
            exchange.forget()
        self._begun = now
        self._ask(now)

    def receive(self, now: float) -> bool:
        """See `ServoBus`."""
        if not self._pending or self.port.lost is not None:
            return True
        data = self.port.receive()
        if data:
            self._heard_at = now
        if self._pending[0].take(data) or now >= self._patience:
            self._pending.pop(0)
            if self._pending:
                self._ask(now)
        return not self._pending

    @property
    def patience(self) -> float:
        """See `ServoBus`."""
        return self._patience

    def finish(self) -> None:
        """See `ServoBus`."""
        for group in self._groups:
            group.end()
            self._take_rows(group)
        if self._board is not None:
            answer = self._exchanges[-1].answers.get(self._board.id)
            if answer is not None:
                self._board.take(answer[1])
        self._complete = bool(self.measured.fresh.all()) and (self._board is None or self._board.read(self._begun))

    def _ask(self, now: float) -> None:
        exchange = self._pending[0]
        self.port.send(exchange.begin())
        slack = PATIENCE_S if self._complete else SHORT_PATIENCE_S
        answer = self.port.seconds(exchange.sizes[1]) + exchange.delays * self.config.return_delay_us * 1e-6
        self._patience = self.port.busy_until + answer + slack
        self._spoke_at = now

    def _take_rows(self, group: ReadMany) -> None:
        if group.whole is not None:
            rows = np.frombuffer(group.whole, FAST_ROW)
            slots: Slots | slice = self._slots_of(group)
        elif group.answers:
            rows = np.frombuffer(b"".join(data for _, data in group.answers.values()), ROW)
            slots = np.array([self._slot[id_] for id_ in group.answers], np.int64)
        else:
            return
        tick = rows["tick"].astype(np.int64)
        if self._learning:
            self._clock.learn(slots, tick, self._begun)
        else:
            # No supply: a servo that has lost power has forgotten what its indirect addresses meant, and sends zeros.
            fresh = self._clock.accept(slots, tick, self._begun) & (rows["voltage"] > 0)
            if not fresh.all():
                slots = np.flatnonzero(fresh) if isinstance(slots, slice) else slots[fresh]
                rows = rows[fresh]
        measured = self.measured
        measured.ticks[slots] = rows["position"]
        measured.velocity[slots] = rows["velocity"] * _RAD_S
        measured.effort[slots] = rows["current"] * self._torque_per_unit[slots]
        measured.voltage[slots] = rows["voltage"] * VOLTAGE
        measured.temperature[slots] = rows["temperature"]
        measured.error[slots] = rows["error"]
        measured.torque[slots] = rows["torque"] == 1
        measured.fresh[slots] = True

    def _slots_of(self, group: ReadMany) -> Slots | slice:
        """Where the servos of a reply lie; a slice if it is all of them in order, which numpy takes without a copy."""
        order = bytes(group.order)
        if order not in self._slots:
            slots = np.array([self._slot[id_] for id_ in order], np.int64)
            in_order = np.array_equal(slots, np.arange(len(self.ids)))
            self._slots = {order: slice(None) if in_order else slots}
        return self._slots[order]

    def _run_cycle(self) -> None:
        """A whole cycle at once, outside the loop."""
        self.request(self.port.now())
        while not self.receive(now := self.port.now()):
            self.port.wait_any([self.port], self._patience - now)
        self.finish()

    # ---------------------------------------------------------------- goals and torque

    def send_goals(self, ticks: Float, bound: Float) -> None:
        """See `ServoBus`; while torque is off nothing is sent."""
        if not self._on:
            return
        now = self.port.now()
        if now - max(self._spoke_at, self._heard_at) > self._units * WATCHDOG_S * 0.9:
            log.warning("bus %s: the loop was silent for longer than the bus watchdog: cleared", self.name)
            self._rearm = 2
        if self._rearm:
            # Twice: a sync write is not acknowledged.
            self._rearm -= 1
            self._write_all("bus_watchdog", 0)
            self._write_all("bus_watchdog", self._units)
        self._send(ticks, bound)
        self._spoke_at = now

    def switch_on(self) -> None:
        """See `ServoBus`; goals and watchdogs are read back before torque goes on."""
        measured, everyone = self.measured, np.ones(len(self.ids), np.bool_)
        recent = self.port.now() - self._begun < RECENT_SHARE / self.robot.rate_hz
        if self._damped:
            self._set_softness(1.0)
        for _ in attempts(self.port):
            if not (recent and measured.fresh.all()):
                self._run_cycle()
            recent = False
            if not measured.fresh.all():
                continue
            self._write_all("bus_watchdog", 0)
            self._write_all("bus_watchdog", self._units)
            self._pin()
            pinned = self._pinned()
            if pinned.all():
                self._on = True
                self._rearm = 0
                self._switch(everyone, on=True)
                return
        wrong = int(np.argmin(measured.fresh & (self._pinned() if measured.fresh.all() else True)))
        what = "does not take the goal to stay where it is" if measured.fresh[wrong] else "does not answer"
        raise DriverError(f"{self.joint_name(wrong)} on {self.port.path}: {what}: torque stays off")

    def repeat_on(self, off: Bool) -> None:
        """See `ServoBus`."""
        if off.any():
            ticks = np.clip(self.measured.ticks, *self.position_limits)
            self._send(np.where(off, ticks, self._last_ticks), self._last_bound, np.where(off, ticks, np.nan))
            self._switch(off, on=True)

    def switch_off(self) -> None:
        """See `ServoBus`."""
        self._on = False
        everyone = np.ones(len(self.ids), np.bool_)
        for _ in range(TRIES):
            self._switch(everyone, on=False)
            if self.port.lost is not None:
                return
            self._run_cycle()
            if self.measured.fresh.all() and not self.measured.torque.any():
                break
        self._write_all("bus_watchdog", 0)

    def damp(self) -> None:
        """See `ServoBus`; position gain and PWM limit go down to `DAMPED_SHARE`, told twice."""
        self._damped = True
        for _ in range(2):
            self._send(self.witness.nearest(self.measured.ticks), np.full(len(self.ids), np.nan))
            self._set_softness(DAMPED_SHARE)

    # ---------------------------------------------------------------- packets

    def _pin(self) -> None:
        """Every servo is to stay where it is; one that stands past its own limits, at these."""
        ticks = self.measured.ticks
        self._send(np.clip(ticks, *self.position_limits), np.full(len(ticks), np.nan), standing=ticks)

    def _send(self, ticks: Float, bound: Float, standing: Float | None = None) -> None:
        """Goals of the whole bus; `standing` is where servos that are pinned stand, NaN for the others, (m,)."""
        ticks = ticks.copy()
        for goals in self._goals:
            packet = goals.packet(ticks, bound)
            sent = np.frombuffer(sync_write_rows(packet), goal_row(bounded=goals.bounded))
            slots = self._slot_of[sent["id"]]
            admitted = self.witness.admit(
                slots,
                sent["position"],
                sent["current"] if goals.bounded else None,
                None if standing is None else standing[slots],
            )
            if (admitted != sent["position"]).any():
                ticks[slots] = admitted
                packet = goals.packet(ticks, bound)
            self.port.send(packet)
        self._last_ticks, self._last_bound = ticks, bound.copy()
        if standing is not None:
            np.copyto(self.pins, ticks, where=np.isfinite(standing))

    def _write_all(self, name: str, value: int, which: Bool | None = None) -> None:
        """Set a register of all servos, or of some, to one value, in one packet for each place that it lies at."""
        rows: dict[Span, bytearray] = {}
        for slot, servo in enumerate(self.servos):
            if which is None or which[slot]:
                register = table_of(servo.name)[name]
                row = rows.setdefault(Span(register.address, register.size), bytearray())
                row += bytes([self.ids[slot]]) + register.pack(value)
        for span, content in rows.items():
            self.port.send(_sync_write(span, bytes(content)))
        self._spoke_at = self.port.now()

    def _switch(self, which: Bool, *, on: bool) -> None:
        self._write_all("torque_enable", int(on), which)

    def _set_softness(self, share: float) -> None:
        for slot, servo in enumerate(self.servos):
            table = table_of(servo.name)
            one = np.arange(len(self.ids)) == slot
            self._write_all("position_p_gain", round(share * self._gains[slot]), one)
            self._write_all("goal_pwm", round(share * table["pwm_limit"].initial), one)
        self._damped = share < 1.0

    def _pinned(self) -> Bool:
        """Which servos hold the goal that `_pin` has sent, and an armed watchdog."""
        table = table_of(self.servos[0].name)
        span = Span(table["bus_watchdog"].address, table["goal_position"].end - table["bus_watchdog"].address)
        check = ReadMany(self.ids, span, fast=False, where=f"bus {self.name}")
        self.port.receive()
        self.port.send(check.begin())
        answer = self.port.seconds(check.sizes[1]) + check.delays * self.config.return_delay_us * 1e-6
        patience = self.port.busy_until + answer + PATIENCE_S
        while (now := self.port.now()) < patience and self.port.lost is None:
            if check.take(self.port.wait(patience - now)):
                break
        pinned = np.zeros(len(self.ids), np.bool_)
        for id_, (_, data) in check.answers.items():
            slot = self._slot[id_]
            goal = table["goal_position"].unpack(data[-4:])
            pinned[slot] = data[0] == self._units and goal == int(self._last_ticks[slot])
        return pinned


class _Goals:
    """The sync write of goals to the servos of one layout.

    Args:
        bus: their bus.
        layout: theirs.

    Attributes:
        bounded: a current goes with every position.
    """

    def __init__(self, bus: DynamixelBus, layout: Layout) -> None:
        self._span = layout.write
        self._slots = np.array([slot for slot, other in enumerate(bus._layouts) if other == layout], np.int64)
        self._rows = np.zeros(len(self._slots), goal_row(bounded=layout.bounded))
        self._rows["id"] = [bus.ids[slot] for slot in self._slots]
        self.bounded = layout.bounded
        if layout.bounded:
            self._most = bus.current_limit
            self._unit = bus._torque_per_unit[self._slots]

    def packet(self, ticks: Float, bound: Float) -> bytes:
        """The packet for goals of the whole bus; a bound that is no number is the servo's own limit, (m,) each."""
        self._rows["position"] = ticks[self._slots]
        if self.bounded:
            most = self._most[self._slots]
            units = np.minimum(bound[self._slots] / self._unit, most)
            self._rows["current"] = np.where(np.isnan(units), most, units)
        return _sync_write(self._span, self._rows.tobytes())


def _sync_write(span: Span, rows: bytes) -> bytes:
    params = span.address.to_bytes(2, "little") + span.size.to_bytes(2, "little") + rows
    return encode(BROADCAST, Instruction.SYNC_WRITE, params)


def _board(robot: Robot, bus: str) -> OpenCr | None:
    imu = robot.config.imu
    if imu is None or imu.driver != OpenCr.name or imu.bus != bus or imu.id is None:
        return None
    return OpenCr(imu)
