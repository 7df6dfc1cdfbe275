"""`ReadCycle`: once per tick, everything that the servos of a bus and its OpenCR board measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot_file import Bus as BusConfig
from flexmotion.drivers.bus.servo_bus import Measurement
from flexmotion.drivers.dynamixel.exchange import Exchange, ReadMany, ReadOne
from flexmotion.drivers.dynamixel.layout import Span, rows_of
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
        groups: the sync reads of a cycle.
        began: time at which the last cycle began [s].
        last_traffic: time of the last byte sent or received in a cycle [s].
        patience: time at which `receive` gives up the pending exchange [s].
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
        self._port, self._measured = port, measured
        self._torque_per_unit, self._speed_unit = torque_per_unit, speed_unit
        self._return_delay = config.return_delay_us * 1e-6
        self._slot = {id_: slot for slot, id_ in enumerate(ids)}
        self._slots: dict[bytes, Slots | slice] = {}
        self.groups: list[ReadMany] = []
        self._board: OpenCr | None = None
        self._exchanges: list[Exchange] = []
        self._pending: list[Exchange] = []
        self._clock = ReplyClock(m, oldest_ms)
        self._spans: list[Span] = []
        self._turn = 0
        self._learning = False
        self._complete = True
        self.began = self.patience = self.last_traffic = 0.0

    def set_up(self, groups: Sequence[ReadMany], board: OpenCr | None) -> None:
        """Set what is read from the next cycle on."""
        self.groups, self._board = list(groups), board
        self._spans = [group.span for group in groups]
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
        self._port.receive()  # discard late answers to earlier requests
        self._measured.fresh[:] = False
        if self._board is not None:
            self._board.forget()
        self._turn += 1
        watchdogs = self._turn % WATCHDOG_TURN == 0
        for group, span in zip(self.groups, self._spans, strict=True):
            group.aim(Span(span.address - 1, span.size) if watchdogs else span)
        self._pending = list(self._exchanges)
        for exchange in self._exchanges:
            exchange.forget()
        self.began = now
        self._ask(now)

    def receive(self, now: float) -> bool:
        """See `ServoBus`."""
        if not self._pending or self._port.lost is not None:
            return True
        data = self._port.receive()
        if data:
            self.last_traffic = max(self.last_traffic, now)
        if self._pending[0].take(data) or now >= self.patience:
            self._pending.pop(0)
            if self._pending:
                self._ask(now)
        return not self._pending

    def finish(self) -> None:
        """See `ServoBus`."""
        for group in self.groups:
            group.end()
            self._take_rows(group)
        if self._board is not None:
            answer = self._exchanges[-1].answers.get(self._board.id)
            if answer is not None:
                self._board.take(answer[1])
        self._complete = bool(self._measured.fresh.all()) and (self._board is None or self._board.read(self.began))

    def run(self) -> None:
        """A whole cycle that reads the torque switches, blocking; not for the control loop."""
        self._turn = 0
        self.request(self._port.now())
        while not self.receive(now := self._port.now()):
            self._port.wait_any([self._port], self.patience - now)
        self.finish()

    def answered_by(self, exchange: Exchange, slack: float = PATIENCE_S) -> float:
        """Time by which the answers to an exchange that was just sent must have come [s]."""
        answer = self._port.seconds(exchange.sizes[1]) + exchange.delays * self._return_delay
        return self._port.busy_until + answer + slack

    def _ask(self, now: float) -> None:
        exchange = self._pending[0]
        self._port.send(exchange.begin())
        self.patience = self.answered_by(exchange, PATIENCE_S if self._complete else SHORT_PATIENCE_S)
        self.last_traffic = max(self.last_traffic, now)

    def _take_rows(self, group: ReadMany) -> None:
        watchdogs, kinds = self._turn % WATCHDOG_TURN == 0, rows_of(group.span.size)
        if group.whole is not None:
            rows = np.frombuffer(group.whole, kinds.fast_watchdog if watchdogs else kinds.fast)
            slots: Slots | slice = self._slots_of(group)
        elif group.answers:
            rows = np.frombuffer(
                b"".join(data for _, data in group.answers.values()), kinds.watchdog if watchdogs else kinds.plain
            )
            slots = np.array([self._slot[id_] for id_ in group.answers], np.int64)
        else:
            return
        tick = rows["tick"].astype(np.int64)
        if self._learning:
            self._clock.learn(slots, tick, self.began)
        else:
            # Voltage 0: the servo has lost power, and with it its indirect addresses; it sends zeros.
            fresh = self._clock.accept(slots, tick, self.began) & (rows["voltage"] > 0)
            if group.whole is not None:
                fresh &= (rows["error_byte"] & ~np.uint8(ALERT)) == 0
            if not fresh.all():
                slots = np.flatnonzero(fresh) if isinstance(slots, slice) else slots[fresh]
                rows = rows[fresh]
        measured = self._measured
        measured.ticks[slots] = rows["position"]
        measured.velocity[slots] = rows["velocity"] * self._speed_unit[slots]
        measured.effort[slots] = rows["current"] * self._torque_per_unit[slots]
        measured.voltage[slots] = rows["voltage"] * VOLTAGE
        measured.temperature[slots] = rows["temperature"]
        measured.error[slots] = rows["error"]
        if watchdogs:
            measured.watchdog[slots] = rows["watchdog"]
        else:
            measured.torque[slots] = rows["torque"] == 1
        measured.fresh[slots] = True

    def _slots_of(self, group: ReadMany) -> Slots | slice:
        """Slots of the servos in a reply; a slice if they are all servos in order, which numpy reads without a copy."""
        order = bytes(group.order)
        if order not in self._slots:
            slots = np.array([self._slot[id_] for id_ in order], np.int64)
            in_order = np.array_equal(slots, np.arange(len(self._slot)))
            self._slots = {order: slice(None) if in_order else slots}
        return self._slots[order]
