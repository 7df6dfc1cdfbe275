"""`Lx16aBus`: LX-16A servos on one port, one packet per servo and value."""

from __future__ import annotations

import logging
import math

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import DAMAGED
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.bus.packet import SumDecoder
from flexmotion.drivers.bus.servo_bus import Budget, ServoBus
from flexmotion.drivers.bus.sum_client import LATENCY_S, SumClient
from flexmotion.drivers.lx16a.protocol import ANSWER_SIZE, BAUD, FORMAT, MILLIVOLT, Command
from flexmotion.drivers.port import BITS_A_BYTE, SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

PATIENCE_S = 0.003
READ_SHARE, WRITE_SHARE = 0.4, 0.4
"""Shares of a tick for reading and for writing; servos that do not fit have their turn in the next tick."""

log = logging.getLogger(__name__)


class Lx16aBus(ServoBus):
    """Positions are read in turns, as many per tick as fit; speeds are their differences.

    These servos have no current measurement, torque bound, watchdog or adjustable gain: after a crash they hold their
    last goal, and damping switches torque off.
    """

    protocol = "lx16a"

    def __init__(self, robot: Robot, name: str, port: SerialPort, options: BusOptions) -> None:
        super().__init__(robot, name, port, options)
        m = len(self.ids)
        self._client, self._decoder = SumClient(port, FORMAT), SumDecoder(FORMAT)
        self._position_limits = np.array([[s.min_tick for s in self.servos], [s.max_tick for s in self.servos]])
        self._tick = np.array([servo.tick_rad for servo in self.servos])
        self._read_at = np.full(m, -np.inf)  # a first reading has no speed
        self._sent, self._age = np.full(m, np.nan), np.zeros(m, np.int64)  # last goals, and the ticks since then
        self._repeat = self.turns(robot, name)
        self._next_read = self._next_write = self._next_status = 0
        self._queue: list[tuple[int, Command]] = []
        self._patience = 0.0
        self._on, self._limp = False, np.zeros(m, np.bool_)

    @classmethod
    def check(cls, robot: Robot, name: str) -> None:
        """See `ServoBus`. The baud rate is fixed."""
        super().check(robot, name)
        if robot.config.buses[name].baud != BAUD:
            raise ConfigError(
                f"{robot.file}: field buses.{name}.baud: {robot.config.buses[name].baud}, expected {BAUD}: "
                "it is fixed in these servos"
            )

    @classmethod
    def budget(cls, robot: Robot, name: str) -> Budget:
        """See `ServoBus`. For a tick in which every servo is read and written."""
        m = sum(joint.bus == name for joint in robot.joints)
        read = m * (2 * FORMAT.overhead + ANSWER_SIZE[Command.READ_POSITION])
        write = m * (FORMAT.overhead + 4)
        read_s, write_s = read * BITS_A_BYTE / BAUD, write * BITS_A_BYTE / BAUD
        return Budget(read, write, read_s, write_s, asked_s=min(0.5 * read_s, 0.3 / robot.rate_hz))

    @classmethod
    def turns(cls, robot: Robot, name: str) -> int:
        """See `ServoBus`. Once more where a servo does not answer in its turn."""
        m = sum(joint.bus == name for joint in robot.joints)
        return 2 * math.ceil(m / _positions_a_cycle(m, robot.rate_hz))

    def look(self) -> None:
        """See `ServoBus`."""
        self.audit()  # it writes nothing

    def audit(self) -> None:
        """See `ServoBus`. There is no model number to check."""
        for slot in range(len(self.ids)):
            if self._ask(slot, Command.READ_POSITION) is None:
                reason = self.port.lost or (DAMAGED if self._client.damaged else "does not answer; is its power on?")
                raise DriverError(f"{self.joint_name(slot)} on {self.port.path}: {reason}")
            limits = self._ask(slot, Command.READ_LIMITS)
            if limits is None:
                raise DriverError(f"{self.joint_name(slot)} on {self.port.path}: does not report its position limits")
            lower, upper = (int.from_bytes(limits[at : at + 2], "little") for at in (0, 2))
            self._position_limits[:, slot] = lower, upper
            self.guard.limit(slot, lower, upper)
            for command in (Command.READ_VOLTAGE, Command.READ_TEMPERATURE, Command.READ_LOAD):
                self._ask(slot, command)

    def request(self, now: float) -> None:
        """See `ServoBus`."""
        self.port.receive()
        self._decoder.clear()
        measured, m = self.measured, len(self.ids)
        measured.fresh[:] = measured.asked[:] = False
        many = _positions_a_cycle(m, self.robot.rate_hz)
        turn = [(self._next_read + k) % m for k in range(many)]
        self._next_read = (self._next_read + many) % m
        self._queue = [(slot, Command.READ_POSITION) for slot in turn]
        self._next_status = (self._next_status + 1) % (3 * m)
        status = (Command.READ_VOLTAGE, Command.READ_TEMPERATURE, Command.READ_LOAD)[self._next_status % 3]
        self._queue.append((self._next_status // 3, status))
        measured.asked[turn] = True
        self._send_next()

    def receive(self, now: float) -> bool:
        """See `ServoBus`."""
        if self.port.lost is not None:
            self._queue.clear()
        for packet in self._decoder.feed(self.port.receive()):
            if self._queue and packet.id == self.ids[self._queue[0][0]] and packet.code == self._queue[0][1]:
                slot, command = self._queue.pop(0)
                self._take(slot, command, packet.params, now)
                self._send_next()
        if self._queue and now >= self._patience:
            self._queue.pop(0)
            self._send_next()
        return not self._queue

    @property
    def patience(self) -> float:
        """See `ServoBus`."""
        return self._patience

    def finish(self) -> None:
        """See `ServoBus`. Servos that the cycle had no time for count as not asked."""
        for slot, command in self._queue:
            if command is Command.READ_POSITION:
                self.measured.asked[slot] = False
        self._queue.clear()

    def send_goals(self, ticks: Float, bound: Float) -> None:
        """See `ServoBus`. Goals that changed are sent in turns, as many as fit the tick.

        So are, once within `turns`, those that did not change: a lost one would stay lost, as nothing acknowledges it.
        """
        if not self._on:
            return
        m, end = len(self.ids), self.port.now() + WRITE_SHARE / self.robot.rate_hz
        self._age += 1
        due = (ticks != self._sent) | (self._age >= self._repeat)
        for _ in range(m):
            if self.port.busy_until > end:
                return
            slot = self._next_write
            self._next_write = (slot + 1) % m
            if due[slot] and not self._limp[slot]:
                self._move(slot, int(ticks[slot]))

    def switch_on(self) -> None:
        """See `ServoBus`. Goals are not read back; every servo is asked whether torque is on.

        Nothing is written before all servos have answered: whether a goal alone switches torque on is not documented.
        """
        self._limp.fill(False)
        every = range(len(self.ids))
        for slot in every:
            if self._ask(slot, Command.READ_POSITION) is None:
                raise DriverError(f"{self.joint_name(slot)} on {self.port.path}: does not answer: torque stays off")
        for slot in every:
            # Read once more: the joint may have moved since.
            if self._ask(slot, Command.READ_POSITION) is None:
                raise DriverError(f"{self.joint_name(slot)} on {self.port.path}: does not answer: all torque goes off")
            for _ in range(2):
                self._move(slot, int(self.measured.ticks[slot]), pinned=True)
            self.port.send(FORMAT.encode(self.ids[slot], Command.LOAD, b"\x01"))
            if self._ask(slot, Command.READ_LOAD) is None or not self.measured.torque[slot]:
                raise DriverError(f"{self.joint_name(slot)} on {self.port.path}: torque does not go on: all goes off")
        self._on = True

    def repeat_on(self, off: Bool) -> None:
        """Not needed: `switch_on` verifies torque."""

    def switch(self, which: Bool, on: bool) -> None:
        """See `ServoBus`. A limp servo gets no goals: they may switch it on (not documented)."""
        self._limp[which] = not on
        for slot in np.flatnonzero(which):
            if on:
                for _ in range(2):
                    self._move(int(slot), int(self.measured.ticks[slot]), pinned=True)
            self.port.send(FORMAT.encode(self.ids[slot], Command.LOAD, bytes([on])))
        self.measured.torque[which] = on

    def send_off(self) -> None:
        """See `ServoBus`."""
        self._on = False
        for id_ in self.ids:
            self.port.send(FORMAT.encode(id_, Command.LOAD, b"\x00"))

    def torque_is_off(self, asked: Bool, until: float) -> Bool:
        """See `ServoBus`. One by one, each with the patience of a cycle; an adapter may deliver answers later."""
        off, waiting = np.zeros(len(self.ids), np.bool_), dict[int, int]()
        self.port.receive()
        self._decoder.clear()
        for slot in np.flatnonzero(asked):
            id_ = self.ids[slot]
            waiting[id_] = int(slot)
            self.port.send(FORMAT.encode(id_, Command.READ_LOAD))
            answer = self.port.seconds(FORMAT.overhead + ANSWER_SIZE[Command.READ_LOAD])
            patience = min(self.port.busy_until + answer + PATIENCE_S, until)
            while id_ in waiting and self._take_torque(waiting, off, patience):
                pass
        patience = min(self.port.now() + LATENCY_S, until)
        while waiting and self._take_torque(waiting, off, patience):
            pass
        return off

    def _take_torque(self, waiting: dict[int, int], off: Bool, patience: float) -> bool:
        """Wait for answers, and mark the servos of `waiting`, slots by id, that are off; False: no time is left."""
        left = patience - self.port.now()
        if left <= 0 or self.port.lost is not None:
            return False
        for packet in self._decoder.feed(self.port.wait(left)):
            if packet.code == Command.READ_LOAD and len(packet.params) == 1 and packet.id in waiting:
                off[waiting.pop(packet.id)] = packet.params[0] == 0
        return True

    def damp(self) -> None:
        """See `ServoBus`. Sent twice."""
        for _ in range(2):
            self.send_off()

    # ---------------------------------------------------------------- inside

    def _move(self, slot: int, tick: int, *, pinned: bool = False) -> None:
        # A servo outside its own limits is pinned to the nearest limit.
        goal = int(np.clip(tick, *self._position_limits[:, slot]))
        packet = self._packet(slot, goal)
        # From the bytes to send: header, id, length, command, goal.
        slots, sent = np.array([self.ids.index(packet[2])]), float(int.from_bytes(packet[5:7], "little"))
        standing = self.measured.ticks[slots] if pinned else None
        admitted = float(self.guard.admit(slots, np.array([sent]), standing=standing)[0])
        self.port.send(packet if admitted == sent else self._packet(slot, int(admitted)))
        self._sent[slot], self._age[slot] = tick, 0
        if pinned:
            self.pins[slot] = admitted

    def _packet(self, slot: int, goal: int) -> bytes:
        at_once = 0
        return FORMAT.encode(self.ids[slot], Command.MOVE, goal.to_bytes(2, "little") + at_once.to_bytes(2, "little"))

    def _send_next(self) -> None:
        if self._queue:
            slot, command = self._queue[0]
            self.port.send(FORMAT.encode(self.ids[slot], command))
            answer = self.port.seconds(FORMAT.overhead + ANSWER_SIZE[command])
            self._patience = self.port.busy_until + answer + PATIENCE_S

    def _ask(self, slot: int, command: Command) -> bytes | None:
        """Read one value, blocking; not during a cycle."""
        answer = self._client.ask(self.ids[slot], command, answer=ANSWER_SIZE[command])
        if answer is None:
            return None
        self._take(slot, command, answer.params, self.port.now())
        return answer.params

    def _take(self, slot: int, command: Command, params: bytes, now: float) -> None:
        measured = self.measured
        if len(params) != ANSWER_SIZE[command]:
            return
        if command is Command.READ_POSITION:
            tick = int.from_bytes(params, "little", signed=True)
            since = now - self._read_at[slot]
            moved = (tick - measured.ticks[slot]) * self._tick[slot]
            measured.velocity[slot] = moved / since if 0 < since < 0.5 else 0.0
            measured.ticks[slot], self._read_at[slot] = tick, now
            measured.fresh[slot] = True
        elif command is Command.READ_VOLTAGE:
            measured.voltage[slot] = int.from_bytes(params, "little") * MILLIVOLT
        elif command is Command.READ_TEMPERATURE:
            measured.temperature[slot] = params[0]
        elif command is Command.READ_LOAD:
            measured.torque[slot] = params[0] == 1


def _positions_a_cycle(m: int, rate_hz: float) -> int:
    """How many of m servos are asked for their position in a tick; one more answer is a status."""
    each = (2 * FORMAT.overhead + 2) * BITS_A_BYTE / BAUD
    return min(m, max(1, int(READ_SHARE / rate_hz / each) - 1))
