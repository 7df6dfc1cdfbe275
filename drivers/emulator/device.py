"""`Device`: a device with a control table on a Protocol 2.0 bus, and the rules for reads and writes of the table."""

from __future__ import annotations

from dataclasses import dataclass

from flexmotion.drivers.dynamixel.packet import Error
from flexmotion.drivers.dynamixel.registers import BAUD_RATES, RETURN_DELAY_US, Register, Table
from flexmotion.drivers.emulator.rules import Refusals

RAM_LIMIT_PWM, RAM_LIMIT_CURRENT = ("goal_pwm", "pwm_limit"), ("goal_current", "current_limit")
"""Goals that take the value of a limit at power-up, and the limit (e-Manual: Goal PWM(100), Operating Mode(11))."""

IDENTITY = ("id", "baud_rate", "secondary_id")
STEERING = (*IDENTITY, "homing_offset", "operating_mode", "min_position_limit", "max_position_limit")
NO_SECONDARY_ID = 253
"""From this value on, a secondary id is not used (e-Manual, Secondary(Shadow) ID(12))."""


@dataclass(frozen=True)
class _Part:
    """A register that a write covers.

    Attributes:
        sources: indices of its bytes in the data of the write.
        run: the same as a slice, if they are consecutive.
        kept: whether it is in EEPROM.
        steers: whether `_identify` must see a change of it, or it is an indirect address.
    """

    name: str
    register: Register
    sources: tuple[int, ...]
    run: slice | None
    kept: bool
    steers: bool


class Device:
    """A device with a control table.

    Subclasses update measurements (`refresh`) and act on writes (`written`).

    Attributes:
        memory: the control table, byte by byte.
        id, baud: address on the bus and bit rate, from the table.
        secondary_id: a second address, of a group that is not answered; None: there is none.
        renamed: whether id, secondary id or baud rate have changed since the bus looked.
        refusals: number of refusals by the name of their rule.
        eeprom_writes, ram_writes: number of registers that were written by packets.
        registered: a write that waits for an action instruction, or None.
        off_until: time until which it receives nothing, while it reboots [s].
    """

    def __init__(self, table: Table, id_: int, model_number: int, firmware: int) -> None:
        self.table = table
        self.memory = bytearray(table.size)
        self.id = self.baud = 0
        self.secondary_id: int | None = None
        self.renamed = True
        self.refusals = Refusals("dynamixel2")
        self.eeprom_writes = self.ram_writes = 0
        self._fields = {name: (r.address, r.end, r.signed) for name, r in table.registers.items()}
        self.registered: tuple[int, bytes] | None = None
        self.off_until = 0.0
        self._parts: dict[tuple[int, int], tuple[_Part, ...] | str] = {}
        self._targets: dict[tuple[int, int], list[int] | None] = {}
        self._by_address = {
            address: (name, register)
            for name, register in self._all_registers().items()
            for address in range(register.address, register.end)
        }
        self._factory()
        self.put("model_number", model_number)
        self.put("firmware_version", firmware)
        self.put("id", id_)

    @property
    def return_delay(self) -> float:
        """Time from the end of an instruction to the answer [s]."""
        return self.get("return_delay_time") * RETURN_DELAY_US * 1e-6

    @property
    def alert(self) -> bool:
        """Whether its status packets carry the alert bit."""
        return False

    @property
    def locked(self) -> bool:
        """Whether the EEPROM may not be written."""
        return False

    def get(self, name: str) -> int:
        """A register's value."""
        first, end, signed = self._fields[name]
        return int.from_bytes(self.memory[first:end], "little", signed=signed)

    def put(self, name: str, value: int) -> None:
        """Set a register, without the rules for writes."""
        register = self.table[name]
        self.memory[register.address : register.end] = register.pack(value)
        self._identify(name)
        if name.startswith("indirect"):
            self._parts.clear()
            self._targets.clear()

    def refuse(self, rule: str) -> int:
        """Count a refusal by a rule of `rules.yaml`; its error number."""
        error = self.refusals.note(rule).error
        return int(Error.NONE if error is None else Error[error])

    def refresh(self, now: float) -> None:
        """Update the measurements in the table to time `now` [s]."""

    def written(self, name: str, value: int) -> int:
        """Check and act on a write of `value` to a register; after an error the register keeps its value."""
        return Error.NONE

    def read(self, address: int, size: int) -> tuple[int, bytes]:
        """(error, data) from `address` on; indirect data are read from their addresses."""
        key = (address, size)
        if key not in self._targets:
            self._targets[key] = self._resolve(address, size)
        targets = self._targets[key]
        if address + size > len(self.memory) or not size:
            return self.refuse("undefined_address"), b""
        if targets is None:
            return Error.NONE, bytes(self.memory[address : address + size])
        return Error.NONE, bytes([self.memory[target] for target in targets])

    def write(self, address: int, data: bytes, *, group: bool = False) -> int:
        """Write data from `address` on; the error of the first register that refuses, else 0.

        `group`: through the secondary id, by which EEPROM cannot be written.
        """
        parts = self._plan(address, len(data))
        if isinstance(parts, str):
            return self.refuse(parts)
        for part in parts:
            register = part.register
            content = data[part.run] if part.run else bytes([data[source] for source in part.sources])
            value = register.unpack(content)
            if part.kept and group:
                return self.refuse("eeprom_by_secondary_id")
            if part.kept and self.locked:
                return self.refuse("eeprom_locked")
            if register.range is not None and not register.range[0] <= value <= register.range[1]:
                return self.refuse("out_of_range")
            error = self.written(part.name, value)
            if error:
                return error
            self.eeprom_writes += part.kept
            self.ram_writes += not part.kept
            self.memory[register.address : register.end] = content
            if part.steers:
                self._identify(part.name)
                self._parts.clear()
                self._targets.clear()
        return Error.NONE

    def register(self, address: int, data: bytes) -> None:
        """Keep a write until an action instruction."""
        self.registered = (address, data)
        self._flag(1)

    def act(self) -> int:
        """Carry out the registered write; its error."""
        if self.registered is None:
            return self.refuse("action_without_reg_write")
        error = self.write(*self.registered)
        self.registered = None
        self._flag(0)
        return error

    @property
    def moving(self) -> bool:
        """Whether it reports that it moves."""
        return "moving" in self.table and self.get("moving") == 1

    def reboot(self, now: float, seconds: float = 0.2) -> None:
        """Reset RAM to its initial values; the device is off for `seconds` (assumption)."""
        self._initialise(lambda register: register.address >= self.table.eeprom_end)
        self.registered = None
        self._take_limits()
        self.off_until = now + seconds

    def factory_reset(self, mode: int, now: float) -> None:
        """Reset EEPROM to its initial values; mode 0xFF: all, 1: all but the id, 2: all but id and baud rate."""
        kept = {"model_number", "model_information", "firmware_version"}
        kept |= {0xFF: set(), 1: {"id"}, 2: {"id", "baud_rate"}}[mode]
        values = {name: self.get(name) for name in kept if name in self.table}
        self._factory()
        for name, value in values.items():
            self.put(name, value)
        self.reboot(now)

    # ---------------------------------------------------------------- inside

    def _identify(self, changed: str) -> None:
        """Take over the new value of a register of `STEERING`."""
        self.renamed |= changed in IDENTITY
        if changed == "id":
            self.id = self.get("id")
        elif changed == "secondary_id":
            value = self.get("secondary_id")
            self.secondary_id = value if value < NO_SECONDARY_ID else None
        elif changed == "baud_rate":
            self.baud = BAUD_RATES[self.get("baud_rate")]

    def _flag(self, registered: int) -> None:
        if "registered_instruction" in self.table:
            self.put("registered_instruction", registered)

    def _take_limits(self) -> None:
        """Set goal PWM and goal current to their limits."""
        for goal, limit in (RAM_LIMIT_PWM, RAM_LIMIT_CURRENT):
            if goal in self.table:
                self.put(goal, self.get(limit))

    def _all_registers(self) -> dict[str, Register]:
        registers = dict(self.table.registers)
        for run in self.table.indirect:
            for slot in range(run.count):
                address = run.address + 2 * slot
                last = self.table.size - 1
                registers[f"indirect_address_{address}"] = Register(
                    address=address, size=2, range=(self.table.eeprom_end, last)
                )
        return registers

    def _factory(self) -> None:
        self._initialise(lambda register: True)

    def _initialise(self, which: object) -> None:
        assert callable(which)
        for name, register in self.table.registers.items():
            if which(register) and register.access == "rw":
                self.put(name, register.initial)
        first = 0
        for run in self.table.indirect:
            kept = not which(Register(address=run.address, size=2))
            for slot in range(0 if kept else run.count):
                # Initial indirect addresses are consecutive; it only matters that they are in the table.
                target = self.table.indirect[0].data + first + slot
                at = run.address + 2 * slot
                self.memory[at : at + 2] = min(target, len(self.memory) - 1).to_bytes(2, "little")
            first += run.count
        self._parts.clear()
        self._targets.clear()

    def _resolve(self, address: int, size: int) -> list[int] | None:
        """Addresses that `size` bytes from `address` on refer to; None if to themselves."""
        targets = [self._target(at) for at in range(address, address + size)]
        return None if targets == list(range(address, address + size)) else targets

    def _target(self, address: int) -> int:
        for run in self.table.indirect:
            if run.data <= address < run.data + run.count:
                at = run.address + 2 * (address - run.data)
                target = int.from_bytes(self.memory[at : at + 2], "little")
                return target if target < len(self.memory) else address
        return address

    def _plan(self, address: int, size: int) -> tuple[_Part, ...] | str:
        """The registers that a write covers, or the rule that forbids it."""
        key = (address, size)
        if key not in self._parts:
            self._parts[key] = self._make_plan(address, size)
        return self._parts[key]

    def _make_plan(self, address: int, size: int) -> tuple[_Part, ...] | str:
        found: dict[str, dict[int, int]] = {}
        for source in range(size):
            target = self._target(address + source)
            if target not in self._by_address:
                return "read_only"
            name, register = self._by_address[target]
            if register.access != "rw":
                return "read_only"
            found.setdefault(name, {})[target - register.address] = source
        parts = []
        for name, places in found.items():
            register = self._by_address_name(name)
            if len(places) != register.size:
                return "written_in_part"
            sources = tuple(places[at] for at in range(register.size))
            end = sources[0] + len(sources)
            run = slice(sources[0], end) if sources == tuple(range(sources[0], end)) else None
            steers = name in STEERING or name.startswith("indirect")
            kept = register.address < self.table.eeprom_end
            parts.append(_Part(name, register, sources, run, kept, steers))
        return tuple(parts)

    def _by_address_name(self, name: str) -> Register:
        return next(register for known, register in self._by_address.values() if known == name)
