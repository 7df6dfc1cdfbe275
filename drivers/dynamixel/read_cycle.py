"""`ReadCycle`: once per tick, everything that the servos of a bus and its OpenCR board measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Bus as BusConfig
from flexmotion.drivers.bus.servo_bus import Measurement
from flexmotion.drivers.dynamixel.columns import Columns
from flexmotion.drivers.dynamixel.exchange import FAST_HEAD, Exchange, ReadMany, ReadOne
from flexmotion.drivers.dynamixel.layout import SHIFT, Span
from flexmotion.drivers.dynamixel.opencr import OpenCr
from flexmotion.drivers.dynamixel.packet import ALERT
from flexmotion.drivers.dynamixel.registers import VOLTAGE
from flexmotion.drivers.dynamixel.staleness import ReplyClock
from flexmotion.drivers.port import SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]
Slots = NDArray[np.int64]

PATIENCE_S, SHORT_PATIENCE_S = 0.003, 0.0015
"""Time beyond that on the wire that answers may take; the short one if the last cycle was incomplete [s]."""

WATCHDOG_TURN = 4
"""Of so many cycles one reads the watchdogs, the others the torque switches."""

LEARNING_CYCLES = 8
"""Cycles at `open` from which the offsets of the servos' clocks are learnt."""

_ALL = slice(None)
_NO_ERROR = bytes([0, ALERT])
"""Error bytes of an answer that has data."""


class _Group:
    """The read of servos with the same layout.

    Attributes:
        read: the exchange.
        spans: that it reads, without and with the watchdog.
        columns: of a complete fast reply to each of them.
        asked: order for which `slots` and `where` hold.
        slots: places of its servos among those of the bus, in the order asked.
        where: the same for numpy; a slice if they are all servos in order, which is read without a copy.
    """

    def __init__(self, read: ReadMany) -> None:
        span, many = read.span, len(read.ids)
        self.read = read
        self.spans = span, Span(span.address - SHIFT, span.size)
        self.columns = tuple(
            Columns(many, span.size, head=FAST_HEAD, before=2, after=2, watchdog=watchdog) for watchdog in (False, True)
        )
        self.asked = b""
        self.slots: list[int] = []
        self.where: Slots | slice = _ALL


class ReadCycle:
    """One exchange for each group of servos with the same layout, then one for the board, without blocking.

    Args:
        port: of the bus.
        config: the bus in the robot file.
        ids: of the servos, in the order of `measured`.
        measured: is filled in place.
        torque_per_unit: torque of one unit of measured current, (m,) [N·m]; NaN without current measurement.
        speed_unit: one unit of velocity, (m,) [rad/s].
        oldest_ms: an answer that is older than usual by this is refused [ms].

    Attributes:
        port: of the bus.
        groups: the sync reads of a cycle.
        read_watchdogs: whether the last cycle read the watchdogs in the place of the torque switches.
        began: time at which the last cycle began [s].
        last_traffic: time of the last byte sent or received in a cycle [s].
        patience: time at which `receive` gives up the pending exchange [s].
        due: time before which the answers of which a part has come cannot be complete [s]; 0: nothing has come.
    """

    def __init__(
        self,
        port: SerialPort,
        config: BusConfig,
        ids: Sequence[int],
        measured: Measurement,
        torque_per_unit: Float,
        speed_unit: Float,
        oldest_ms: float,
    ) -> None:
        m = len(ids)
        self.port, self._measured = port, measured
        self._return_delay = config.return_delay_us * 1e-6
        self._slot = {id_: slot for slot, id_ in enumerate(ids)}
        self.groups: list[ReadMany] = []
        self._groups: list[_Group] = []
        self._board: OpenCr | None = None
        self._exchanges: list[Exchange] = []
        self._at = 0  # of the pending exchange
        self._clock = ReplyClock(m, oldest_ms)
        self._motion_units = np.stack([speed_unit, torque_per_unit])
        self._supply_units = np.array([[VOLTAGE], [1.0]])
        # Views: velocity and effort, voltage and temperature.
        self._motion, self._supply = measured.values[1:3], measured.values[3:]
        self._turn = 0
        self._learning = False
        self._complete = True
        self.read_watchdogs = False
        self.began = self.patience = self.due = self.last_traffic = 0.0

    def set_up(self, groups: Sequence[ReadMany], board: OpenCr | None) -> None:
        """Set what is read from the next cycle on."""
        self.groups, self._board = list(groups), board
        self._groups = [_Group(group) for group in groups]
        self._exchanges = [*self.groups]
        if board is not None:
            self._exchanges.append(ReadOne(board.id, board.span))

    def learn_clocks(self) -> Bool:
        """Run cycles on a bus at rest to learn the servos' clocks; which servos answered, (m,)."""
        self._clock.begin()
        self._learning = True
        answered = np.zeros(len(self._slot), np.bool_)
        for _ in range(LEARNING_CYCLES):
            self.run()
            answered |= self._measured.fresh
        self._learning = False
        return answered

    def request(self, now: float) -> None:
        """See `ServoBus`."""
        self.port.receive()  # discard late answers to earlier requests
        self._measured.fresh.fill(False)
        if self._board is not None:
            self._board.forget()
        self._turn += 1
        self.read_watchdogs = self._turn % WATCHDOG_TURN == 0
        for group in self._groups:
            group.read.aim(group.spans[self.read_watchdogs])
        for exchange in self._exchanges:
            exchange.forget()
        self.began = now
        self._at = 0
        self._ask(now)

    def receive(self, now: float) -> bool:
        """See `ServoBus`. An answer is decoded while the next is on the wire."""
        at, exchanges = self._at, self._exchanges
        if at == len(exchanges) or self.port.lost is not None:
            return True
        data = self.port.receive()
        if data:
            self.last_traffic = max(self.last_traffic, now)
        if exchanges[at].take(data) or now >= self.patience:
            self._at = at + 1
            if self._at < len(exchanges):
                self._ask(now)
            self._conclude(at)
        elif data:
            self.due = self.answered_by(exchanges[at], 0.0)
        return self._at == len(exchanges)

    def finish(self) -> None:
        """See `ServoBus`."""
        if self._at < len(self._exchanges):
            self._conclude(self._at)
            self._at = len(self._exchanges)
        self._complete = self._measured.complete and (self._board is None or self._board.read(self.began))

    def run(self) -> None:
        """A whole cycle that reads the torque switches, blocking; not for the control loop."""
        self._turn = 0
        self.request(self.port.now())
        while not self.receive(now := self.port.now()):
            self.port.wait_any([self.port], self.patience - now)
        self.finish()

    def answered_by(self, exchange: Exchange, slack: float = PATIENCE_S) -> float:
        """Time by which the answers to an exchange that was just sent must have come [s]."""
        answer = self.port.seconds(exchange.sizes[1]) + exchange.delays * self._return_delay
        return self.port.busy_until + answer + slack

    def _ask(self, now: float) -> None:
        exchange = self._exchanges[self._at]
        self.due = 0.0
        self.port.send(exchange.begin())
        self.patience = self.answered_by(exchange, PATIENCE_S if self._complete else SHORT_PATIENCE_S)
        self.last_traffic = max(self.last_traffic, now)

    def _conclude(self, at: int) -> None:
        """Take what an exchange has received; no more is taken for it."""
        self._exchanges[at].end()
        if at < len(self._groups):
            self._take_group(self._groups[at])
        elif self._board is not None:
            answer = self._exchanges[at].answers.get(self._board.id)
            if answer is not None:
                self._board.take(answer[1])

    def _take_group(self, group: _Group) -> None:
        read, statuses = group.read, b""
        if read.whole is not None:
            rows = group.columns[self.read_watchdogs]
            rows.fill(read.whole)
            if group.asked != read.asked:
                self._arrange(group)
            slots, where, statuses = group.slots, group.where, rows.statuses
        elif read.answers:
            rows = Columns(len(read.answers), read.span.size, watchdog=self.read_watchdogs)
            rows.fill(b"".join(data for _, data in read.answers.values()))
            slots = [self._slot[id_] for id_ in read.answers]
            where = np.array(slots, np.int64)
        else:
            return
        if self._learning:
            self._clock.learn(slots, rows.ticks, self.began)
            self._store(rows, where)
            return
        fresh = self._clock.accept(slots, rows.ticks, self.began)
        # Voltage 0: the servo has lost power, and with it its indirect addresses; it sends zeros.
        if all(fresh) and all(rows.voltages) and not statuses.strip(_NO_ERROR):
            self._store(rows, where)
            return
        good = np.array(fresh) & (np.frombuffer(rows.voltages, np.uint8) > 0)
        if statuses:
            good &= (np.frombuffer(statuses, np.uint8) & ~np.uint8(ALERT)) == 0
        self._store(rows, np.array(slots, np.int64)[good], np.flatnonzero(good))

    def _arrange(self, group: _Group) -> None:
        """Set the slots of a group for the order in which it was asked."""
        group.asked = group.read.asked
        group.slots = [self._slot[id_] for id_ in group.asked]
        group.where = _ALL if group.slots == list(range(len(self._slot))) else np.array(group.slots, np.int64)

    def _store(self, rows: Columns, where: Slots | slice, which: Slots | slice = _ALL) -> None:
        """Copy the rows `which` to `measured`, at `where`."""
        measured, errors, turn = self._measured, rows.errors, rows.turn
        if where is _ALL:
            np.copyto(measured.ticks, rows.position)
            np.multiply(rows.motion, self._motion_units, out=self._motion)
            np.multiply(rows.supply, self._supply_units, out=self._supply)
        else:
            measured.ticks[where] = rows.position[which]
            self._motion[:, where] = rows.motion[:, which] * self._motion_units[:, where]
            self._supply[:, where] = rows.supply[:, which] * self._supply_units
        measured.error[where] = np.frombuffer(errors, np.uint8)[which] if any(errors) else 0
        if self.read_watchdogs:
            measured.watchdog[where] = np.frombuffer(turn, np.int8)[which]
        else:
            measured.torque[where] = np.frombuffer(turn, np.uint8)[which] == 1 if turn.strip(b"\1") else True
        measured.fresh[where] = True
