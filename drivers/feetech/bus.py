"""`FeetechBus`: servos of Feetech's STS series on one port: one sync write and one sync read per tick."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.bus.attempts import attempts
from flexmotion.drivers.bus.inspection import refuse_unconfigured
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.bus.packet import BROADCAST, SumDecoder
from flexmotion.drivers.bus.servo_bus import Budget, ServoBus
from flexmotion.drivers.bus.sum_client import LATENCY_S, SumClient
from flexmotion.drivers.feetech.registers import BAUD_RATES, FORMAT, VOLTAGE, Instruction, sts
from flexmotion.drivers.feetech.setup import Found, find, prepare
from flexmotion.drivers.plant import DAMPED_SHARE
from flexmotion.drivers.port import BITS_A_BYTE, SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

PATIENCE_S = 0.003

_REFUSAL = {
    "goal_position": "does not take its goal position",
    "torque_limit": "does not take its torque limit",
    "torque_enable": "does not switch its torque on",
}
"""What is said of a servo that does not hold what was written, by register."""

_READ = ("present_position", "present_speed", "present_load", "present_voltage", "present_temperature", "status",
         "present_current")  # fmt: skip


log = logging.getLogger(__name__)


class FeetechBus(ServoBus):
    """Goals by sync write, everything else by sync read.

    These servos have no watchdog: after a crash they hold their last goal. The torque switch is not read every tick; a
    servo that switches itself off reports an error in its status.
    """

    protocol = "feetech"

    def __init__(self, robot: Robot, name: str, port: SerialPort, options: BusOptions) -> None:
        super().__init__(robot, name, port, options)
        table = sts()
        self._client, self._decoder = SumClient(port, FORMAT), SumDecoder(FORMAT)
        self._slot = {id_: slot for slot, id_ in enumerate(self.ids)}
        self._fields = [table[field] for field in _READ]
        self._first, self._size = _read_span()
        self._tick = np.array([servo.tick_rad for servo in self.servos])
        self._patience = 0.0
        self._answered: set[int] = set()
        self._on, self._limp = False, np.zeros(len(self.ids), np.bool_)
        self._order = list(self.ids)
        self._position_limits = np.stack([np.full(len(self.ids), -np.inf), np.full(len(self.ids), np.inf)])
        self._torque_limits = [table["max_torque"].initial] * len(self.ids)

    @classmethod
    def check(cls, robot: Robot, name: str) -> None:
        """See `ServoBus`. The baud rate must be one that these servos support."""
        super().check(robot, name)
        baud = robot.config.buses[name].baud
        if baud not in BAUD_RATES:
            raise ConfigError(f"{robot.file}: field buses.{name}.baud: {baud}, expected one of {list(BAUD_RATES)}")

    @classmethod
    def budget(cls, robot: Robot, name: str) -> Budget:
        """See `ServoBus`."""
        config = robot.config.buses[name]
        m = sum(joint.bus == name for joint in robot.joints)
        _, size = _read_span()
        read = FORMAT.overhead + 2 + m + m * (FORMAT.overhead + size)
        write = FORMAT.overhead + 2 + 3 * m
        byte_s = BITS_A_BYTE / config.baud
        read_s, asked_s = read * byte_s + m * config.return_delay_us * 1e-6, (FORMAT.overhead + 2 + m) * byte_s
        return Budget(read, write, read_s, write * byte_s, asked_s)

    def look(self) -> None:
        """See `ServoBus`."""
        self._find()

    def audit(self) -> None:
        """See `ServoBus`."""
        found = self._find()
        for slot, joint in enumerate(self.joints):
            prepare(self._client, self.robot, int(joint), found[slot])
            held = found[slot].held
            self.temperature_limit[slot] = held["temperature_limit"]
            self._position_limits[:, slot] = held["min_position_limit"], held["max_position_limit"]
            self.guard.limit(slot, *self._position_limits[:, slot])
            self._take_torque_limit(slot, held)
        # No position is made up for a servo that does not answer the first read of a run.
        answered = np.zeros(len(self.ids), np.bool_)
        for _ in attempts(self.port):
            self._run_cycle()
            answered |= self.measured.fresh
            if answered.all():
                return
        silent = self.joint_name(int(np.argmin(answered)))
        raise DriverError(f"{silent} on {self.port.path}: {self.port.lost or 'does not answer sync reads'}")

    def _take_torque_limit(self, slot: int, held: Mapping[str, int]) -> None:
        """Take the maximum torque in EEPROM as a servo's torque limit of a run, and warn if it lowers or replaces one.

        The limit in RAM may be that of `damp`, left by a run before.
        """
        most, full = held["max_torque"], sts()["max_torque"].initial
        self._torque_limits[slot] = most
        if most < full:
            log.warning("%s: its maximum torque is set to %g %%: kept", self.joint_name(slot), 100 * most / full)
        if held["torque_limit"] not in (most, _damped(most)):
            present = 100 * held["torque_limit"] / full
            log.warning(
                "%s: its torque limit of %g %% until power-off is replaced by its maximum torque, %g %%",
                *(self.joint_name(slot), present, 100 * most / full),
            )

    def _find(self) -> list[Found]:
        """Every servo of the bus, as it was read. Raises as `audit`."""
        found = [find(self._client, self.robot, int(joint)) for joint in self.joints]
        refuse_unconfigured([each.inspection for each in found])
        return found

    def request(self, now: float) -> None:
        """See `ServoBus`."""
        self.port.receive()
        self._decoder.clear()
        self._answered.clear()
        self.measured.fresh[:] = False
        params = bytes([self._first, self._size, *self._order])
        self.port.send(FORMAT.encode(BROADCAST, Instruction.SYNC_READ, params))
        self._patience = self.port.busy_until + self._answers_s(self._size) + PATIENCE_S

    def receive(self, now: float) -> bool:
        """See `ServoBus`."""
        for packet in self._decoder.feed(self.port.receive()):
            slot = self._slot.get(packet.id)
            if slot is not None and len(packet.params) == self._size:
                self._take(slot, packet.params)
        return len(self._answered) == len(self.ids) or now >= self._patience or self.port.lost is not None

    @property
    def patience(self) -> float:
        """See `ServoBus`."""
        return self._patience

    def finish(self) -> None:
        """See `ServoBus`. The first silent servo is asked last in the next cycle: the others may be silent for it."""
        silent = [id_ for id_ in self._order if self._slot[id_] not in self._answered]
        if silent and self._answered:
            self._order = [id_ for id_ in self._order if id_ != silent[0]] + silent[:1]

    def send_goals(self, ticks: Float, bound: Float) -> None:
        """See `ServoBus`. These servos have no torque bound."""
        if self._on:
            self._send(ticks)

    def switch_on(self) -> None:
        """See `ServoBus`. Goals, and the torque limits of `damp`, are read back before torque goes on."""
        self._limp.fill(False)
        blamed, reason = 0, "does not answer"
        for _ in attempts(self.port):
            self._run_cycle()
            if not self.measured.fresh.all():
                blamed, reason = int(np.argmin(self.measured.fresh)), "does not answer"
                continue
            # A servo outside its own limits is pinned to the nearest limit.
            pins = np.clip(self.measured.ticks, *self._position_limits)
            goals = [int(tick) for tick in pins]
            self._write_all("torque_limit", self._torque_limits)
            self._send(pins, standing=self.measured.ticks)
            wrong = self._first_without({"goal_position": goals, "torque_limit": self._torque_limits})
            if wrong is None:
                self._on = True
                self._write_all("torque_enable", [1] * len(goals))
                wrong = self._first_without({"torque_enable": [1] * len(goals)})
            if wrong is None:
                self.measured.torque[:] = True
                return
            blamed, reason = wrong[0], _REFUSAL[wrong[1]]
        self._on = False
        raise DriverError(f"{self.joint_name(blamed)} on {self.port.path}: {reason}: torque stays off")

    def repeat_on(self, off: Bool) -> None:
        """Not needed: `switch_on` verifies torque."""

    def switch(self, which: Bool, on: bool) -> None:
        """See `ServoBus`. Torque and the pinned goal go on in one packet: neither arrives without the other."""
        slots = np.flatnonzero(which)
        if not len(slots):
            return
        self._limp[slots] = not on
        if on:
            ticks = self.measured.ticks[slots]
            pins = np.round(np.clip(ticks, *self._position_limits[:, slots]))
            self.pins[slots] = self.guard.admit(slots, pins, standing=ticks)
            first, goal = sts()["torque_enable"], sts()["goal_position"]
            at_once = bytes(goal.address - first.end)  # the register between them: no bound on the acceleration
            rows = {self.ids[s]: first.pack(1) + at_once + goal.pack(int(self.pins[s])) for s in slots}
            self.port.send(_sync_write(first.address, rows))
        else:
            off = sts()["torque_enable"]
            self.port.send(_sync_write(off.address, {self.ids[slot]: off.pack(0) for slot in slots}))
        self.measured.torque[slots] = on

    def send_off(self) -> None:
        """See `ServoBus`."""
        self._on = False
        self._limp.fill(False)
        self._write_all("torque_enable", [0] * len(self.ids))

    def torque_is_off(self, asked: Bool, until: float) -> Bool:
        """See `ServoBus`. All are asked at once: silent servos cost the time of one."""
        ids = [id_ for id_, one in zip(self.ids, asked, strict=True) if one]
        held = self._read_all("torque_enable", ids, until)
        silent = [id_ for id_ in ids if id_ not in held]
        if held and len(silent) > 1:
            # Those after the first silent servo may be silent for it.
            held |= self._read_all("torque_enable", silent[1:] + silent[:1], until)
        return np.array([held.get(id_) == 0 for id_ in self.ids])

    def damp(self) -> None:
        """See `ServoBus`. The torque limit is lowered to `DAMPED_SHARE`, before the goals are pinned; sent twice."""
        for _ in range(2):
            self._write_all("torque_limit", [_damped(limit) for limit in self._torque_limits])
            self._send(self.guard.nearest(self.measured.ticks))

    # ---------------------------------------------------------------- inside

    def _take(self, slot: int, data: bytes) -> None:
        position, speed, _, voltage, temperature, status, current = (
            field.unpack(data[field.address - self._first : field.end - self._first]) for field in self._fields
        )
        measured = self.measured
        measured.ticks[slot], measured.velocity[slot] = position, speed * self._tick[slot]
        measured.effort[slot] = current * self.torque_per_unit[slot]
        measured.voltage[slot], measured.temperature[slot] = voltage * VOLTAGE, temperature
        measured.error[slot], measured.fresh[slot] = status, True
        self._answered.add(slot)

    def _answers_s(self, size: int) -> float:
        """Time on the wire of the answers of all servos to a sync read of `size` bytes [s]."""
        return len(self.ids) * (self.port.seconds(size + FORMAT.overhead) + self.config.return_delay_us * 1e-6)

    def _run_cycle(self) -> None:
        self.request(self.port.now())
        while not self.receive(now := self.port.now()):
            self.port.wait_any([self.port], self._patience - now)
        self.finish()

    def _read_all(self, name: str, ids: list[int], until: float) -> dict[int, int]:
        """Read a register of several servos in one exchange, blocking until `until` at most; answers by id."""
        register, decoder, found = sts()[name], SumDecoder(FORMAT), dict[int, int]()
        self.port.receive()
        params = bytes([register.address, register.size, *ids])
        self.port.send(FORMAT.encode(BROADCAST, Instruction.SYNC_READ, params))
        patience = min(self.port.busy_until + self._answers_s(register.size) + LATENCY_S, until)
        while len(found) < len(ids) and (now := self.port.now()) < patience and self.port.lost is None:
            for packet in decoder.feed(self.port.wait(patience - now)):
                if packet.id in ids and len(packet.params) == register.size:
                    found[packet.id] = register.unpack(packet.params)
        return found

    def _first_without(self, wanted: Mapping[str, Sequence[int]]) -> tuple[int, str] | None:
        """The first servo without a wanted value, by register, (m,) each, and that register; None: all have theirs.

        A silent servo is asked several times, and is without its first value.
        """
        for slot in range(len(self.ids)):
            held = self._read(slot, list(wanted))
            for name, values in wanted.items():
                if held.get(name) != values[slot]:
                    return slot, name
        return None

    def _read(self, slot: int, names: Sequence[str]) -> dict[str, int]:
        """Registers of a servo in one exchange, by name; empty if it does not answer."""
        registers = {name: sts()[name] for name in names}
        first = min(register.address for register in registers.values())
        size = max(register.end for register in registers.values()) - first
        answer = self._client.ask(self.ids[slot], Instruction.READ, bytes([first, size]), answer=size)
        if answer is None:
            return {}
        return {name: r.unpack(answer.params[r.address - first : r.end - first]) for name, r in registers.items()}

    def _send(self, ticks: Float, standing: Float | None = None) -> None:
        """Send goals of all servos with torque; `standing`: present positions of servos that are pinned, (m,).

        A servo that is limp on request gets none: what a goal does to its torque is not documented.
        """
        ids = [id_ for id_, limp in zip(self.ids, self._limp, strict=True) if not limp]
        packet = self._goals(ids, ticks)
        # From the bytes to send: id and goal of each servo, after header, id, length, instruction, address and size.
        goal, sent = sts()["goal_position"], packet[7:-1]
        step = goal.size + 1
        slots = np.array([self._slot[id_] for id_ in sent[::step]], np.int64)
        goals = np.array([goal.unpack(sent[at + 1 : at + step]) for at in range(0, len(sent), step)], np.float64)
        admitted = self.guard.admit(slots, goals, standing=None if standing is None else standing[slots])
        if (admitted != goals).any():
            ticks = ticks.copy()
            ticks[slots] = admitted
            packet = self._goals(ids, ticks)
        self.port.send(packet)
        if standing is not None:
            np.copyto(self.pins, ticks)

    def _goals(self, ids: list[int], ticks: Float) -> bytes:
        goal = sts()["goal_position"]
        return _sync_write(goal.address, {id_: goal.pack(int(ticks[self._slot[id_]])) for id_ in ids})

    def _write_all(self, name: str, values: Sequence[int]) -> None:
        """Set a register of all servos, to a value of each, (m,)."""
        register = sts()[name]
        rows = {id_: register.pack(value) for id_, value in zip(self.ids, values, strict=True)}
        self.port.send(_sync_write(register.address, rows))


def _damped(limit: int) -> int:
    """Torque limit of a damped servo whose own is `limit`."""
    return round(DAMPED_SHARE * limit)


def _sync_write(address: int, rows: Mapping[int, bytes]) -> bytes:
    """The bytes of a sync write of the same registers of several servos: their content, by id."""
    (size,) = {len(row) for row in rows.values()} or {0}
    params = bytes([address, size]) + b"".join(bytes([id_]) + row for id_, row in rows.items())
    return FORMAT.encode(BROADCAST, Instruction.SYNC_WRITE, params)


def _read_span() -> tuple[int, int]:
    """First address and number of the bytes that a cycle reads."""
    fields = [sts()[name] for name in _READ]
    first = min(field.address for field in fields)
    return first, max(field.end for field in fields) - first
