"""`EmulatedDynamixelBus`: devices on one bus that receive and answer packets of Protocol 2.0."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from flexmotion.drivers.dynamixel.packet import (
    ALERT,
    BROADCAST,
    Decoder,
    Error,
    Instruction,
    Packet,
    encode_fast_status,
    encode_status,
)
from flexmotion.drivers.emulator.device import Device
from flexmotion.drivers.emulator.opencr import OpenCr
from flexmotion.drivers.emulator.servo import Joints, XServo
from flexmotion.drivers.emulator.wire import Reply, mix

CLEAR_KEY = b"\x44\x58\x4c\x22"

MISSED_SLOT_S = 0.0002
"""Time that servos wait for a missing one before them in a sync read (assumption) [s]."""

_LENGTH = slice(5, 7)
"""Position of the length field in a packet; the instruction follows it."""
_READS = frozenset(
    {
        *(Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ),
        *(Instruction.BULK_READ, Instruction.FAST_BULK_READ),
    }
)
_WRITES = frozenset({Instruction.WRITE, Instruction.SYNC_WRITE, Instruction.BULK_WRITE})
_WRITES_TO_MANY = tuple(bytes([kind]) for kind in (Instruction.SYNC_WRITE, Instruction.BULK_WRITE))


class EmulatedDynamixelBus:
    """All devices of one bus.

    Args:
        joints: of its servos.
        devices: servos and boards.

    Attributes:
        dead: ids of devices that neither receive nor answer.
        received, bad: number of intact and of broken packets from the host.
        imu_ids: ids of boards with an inertial sensor.
    """

    def __init__(self, joints: Joints, devices: Iterable[Device]) -> None:
        self.joints = joints
        self.devices = list(devices)
        self.servos = [device for device in self.devices if isinstance(device, XServo)]
        self._board = next((device for device in self.devices if isinstance(device, OpenCr)), None)
        self._powered = self._board is None or self._board.powered
        self.dead: set[int] = set()
        self.received = self.bad = 0
        self.imu_ids = frozenset(device.id for device in self.devices if isinstance(device, OpenCr))
        self._decoder = Decoder()
        self._by_id: dict[int, Device] = {}
        self._twins: list[dict[int, Device]] = []
        self._groups: dict[int, list[Device]] = {}
        self._index()

    @property
    def refusals(self) -> Counter[str]:
        """See `EmulatedBus`."""
        return sum((device.refusals for device in self.devices), Counter())

    def may_be_answered(self, data: bytes) -> bool:
        """See `EmulatedBus`. A single sync or bulk write is not answered."""
        whole = _LENGTH.stop + int.from_bytes(data[_LENGTH], "little") == len(data)
        return not (whole and data[_LENGTH.stop : _LENGTH.stop + 1] in _WRITES_TO_MANY)

    def receive(self, data: bytes, baud: int, now: float) -> list[tuple[int, list[Reply]]]:
        """See `EmulatedBus`."""
        return [(packet.size, self._handle(packet, baud, now)) for packet in self._decoder.feed(data)]

    def drop_incomplete(self) -> None:
        """See `EmulatedBus`."""
        self._decoder.clear()

    def watch(self, now: float) -> None:
        """See `EmulatedBus`."""
        for servo in self.servos:
            servo.watch(now)
        self.joints.commit()

    def reset(self, id_: int, now: float) -> None:
        """See `EmulatedBus`."""
        device = self._by_id.get(id_)
        if device is not None:
            device.reboot(now)

    def trip(self, id_: int) -> None:
        """See `EmulatedBus`."""
        device = self._by_id.get(id_)
        if isinstance(device, XServo):
            device.trip()

    # ---------------------------------------------------------------- instructions

    def _index(self) -> None:
        """Sort the devices by id; those whose id another one has too go to `_twins`, a further layer for each."""
        if not any(device.renamed for device in self.devices):
            return
        layers: list[dict[int, Device]] = [{}]
        self._groups = {}
        for device in self.devices:
            device.renamed = False
            layer = next((layer for layer in layers if device.id not in layer), None)
            if layer is None:
                layers.append(layer := {})
            layer[device.id] = device
            if device.secondary_id is not None:
                self._groups.setdefault(device.secondary_id, []).append(device)
        self._by_id, *self._twins = layers

    def _listening(self, device: Device, baud: int, now: float) -> bool:
        if device.id in self.dead or device.baud != baud or now < device.off_until:
            return False
        return self._powered or not isinstance(device, XServo)

    def _heard_by(self, layer: dict[int, Device], baud: int, now: float) -> dict[int, Device]:
        return {id_: device for id_, device in layer.items() if self._listening(device, baud, now)}

    def _handle(self, packet: Packet, baud: int, now: float) -> list[Reply]:
        """Answers of all devices; those of devices with the same id collide."""
        self._index()
        self.received += packet.intact
        self.bad += not packet.intact
        first = self._heard_by(self._by_id, baud, now)
        replies = self._answers(packet, first, now)
        for layer in self._twins:
            # A request is answered among all others; a write must not act twice.
            twins = self._heard_by(layer, baud, now)
            others = self._answers(packet, first | twins if packet.instruction in _READS else twins, now)
            replies = mix([replies, others])
        if packet.intact and self._groups and packet.instruction in _WRITES:
            self._tell_groups(packet, baud, now)
        if self._board is not None and self._board.powered != self._powered:
            self._powered = self._board.powered
            for servo in self.servos:
                servo.reboot(now)
        self.joints.commit()
        return replies

    def _tell_groups(self, packet: Packet, baud: int, now: float) -> None:
        """Writes to a secondary id act on its whole group, except where that is a device's own id; no answer."""
        for id_, address, data in _writes(packet):
            for device in self._groups.get(id_, ()):
                if device.id != id_ and self._listening(device, baud, now):
                    device.write(address, data, group=True)

    def _answers(self, packet: Packet, listening: dict[int, Device], now: float) -> list[Reply]:
        if not packet.intact:
            device = listening.get(packet.id)
            return [] if device is None else self._status(device, packet.instruction, device.refuse("crc_error"))
        if packet.instruction == Instruction.STATUS:
            return []
        for id_, device in listening.items():
            if isinstance(device, XServo) and packet.id in (id_, BROADCAST):
                device.feed(now)
        handlers = {
            Instruction.SYNC_READ: self._sync_read,
            Instruction.FAST_SYNC_READ: self._fast_sync_read,
            Instruction.BULK_READ: self._bulk_read,
            Instruction.FAST_BULK_READ: self._fast_bulk_read,
        }
        if packet.id == BROADCAST and packet.instruction in (Instruction.SYNC_WRITE, Instruction.BULK_WRITE):
            replies = self._write_many(packet, listening)
        elif packet.id == BROADCAST and packet.instruction in handlers:
            replies = handlers[Instruction(packet.instruction)](packet.params, listening, now)
        elif packet.id == BROADCAST:
            replies = []
            for id_ in sorted(listening):
                answer = self._single(listening[id_], packet, now)
                if packet.instruction == Instruction.PING:
                    replies += answer
        else:
            device = listening.get(packet.id)
            replies = [] if device is None else self._single(device, packet, now)
        return replies

    def _single(self, device: Device, packet: Packet, now: float) -> list[Reply]:
        kind, params = packet.instruction, packet.params
        error, data = int(Error.NONE), b""
        if kind == Instruction.PING:
            data = device.get("model_number").to_bytes(2, "little") + bytes([device.get("firmware_version")])
        elif kind == Instruction.READ:
            if len(params) != 4:
                return self._status(device, kind, Error.LENGTH)
            self._refresh([device], now)
            error, data = device.read(*_span(params))
        elif kind in (Instruction.WRITE, Instruction.REG_WRITE):
            if len(params) < 3:
                return self._status(device, kind, Error.LENGTH)
            address, content = int.from_bytes(params[:2], "little"), params[2:]
            # The answer has the id and the return delay from before the write.
            reply = self._status(device, kind, Error.NONE)
            if kind == Instruction.REG_WRITE:
                device.register(address, content)
            else:
                error = device.write(address, content)
            return reply if not error else self._status(device, kind, error)
        elif kind == Instruction.ACTION:
            error = device.act()
        elif kind == Instruction.FACTORY_RESET:
            if len(params) != 1 or params[0] not in (0xFF, 1, 2) or device.locked:
                error = device.refuse("bad_reset")
            elif packet.id == BROADCAST and params[0] == 0xFF:
                error = device.refuse("broadcast_reset")
            else:
                reply = self._status(device, kind, Error.NONE)
                device.factory_reset(params[0], now)
                return reply
        elif kind == Instruction.REBOOT:
            reply = self._status(device, kind, Error.NONE)
            device.reboot(now)
            return reply
        elif kind == Instruction.CLEAR:
            self._refresh([device], now)
            clear = params == b"\x01" + CLEAR_KEY and not device.moving
            error = Error.NONE if clear else device.refuse("clear_in_motion")
        else:
            error = device.refuse("undefined_instruction")
        return self._status(device, kind, error, data)

    def _sync_read(self, params: bytes, listening: dict[int, Device], now: float) -> list[Reply]:
        address, size = _span(params)
        return self._read_each([(id_, address, size) for id_ in params[4:]], listening, now)

    def _bulk_read(self, params: bytes, listening: dict[int, Device], now: float) -> list[Reply]:
        return self._read_each(_bulk_requests(params), listening, now)

    def _read_each(self, requests: list[tuple[int, int, int]], listening: dict[int, Device], now: float) -> list[Reply]:
        self._refresh((listening[id_] for id_, _, _ in requests if id_ in listening), now)
        replies, waited = [], 0.0
        for id_, address, size in requests:
            device = listening.get(id_)
            if device is None:
                waited += MISSED_SLOT_S
                continue
            error, data = device.read(address, size)
            for reply in self._status(device, Instruction.READ, error, data):
                replies.append(Reply(id_, reply.delay + waited, reply.data))
                waited = 0.0
        return replies

    def _fast_sync_read(self, params: bytes, listening: dict[int, Device], now: float) -> list[Reply]:
        address, size = _span(params)
        return self._fast([(id_, address, size) for id_ in params[4:]], listening, now)

    def _fast_bulk_read(self, params: bytes, listening: dict[int, Device], now: float) -> list[Reply]:
        return self._fast(_bulk_requests(params), listening, now)

    def _fast(self, requests: list[tuple[int, int, int]], listening: dict[int, Device], now: float) -> list[Reply]:
        """The common reply of all servos; it ends at the first that is missing or has too old firmware."""
        rows, delay = [], 0.0
        self._refresh((listening[id_] for id_, _, _ in requests if id_ in listening), now)
        for id_, address, size in requests:
            device = listening.get(id_)
            lowest = None if device is None else device.table.fast_sync_read_firmware
            if device is None or lowest is None or device.get("firmware_version") < lowest:
                break
            error, data = device.read(address, size)
            rows.append((error | (ALERT if device.alert else 0), id_, data if not error else bytes(size)))
            delay = delay or device.return_delay
        if not rows:
            return []
        whole = encode_fast_status(rows)
        if len(rows) < len(requests):
            # The header, from the first servo, has the length of a complete reply.
            missing = sum(size + 4 for _, _, size in requests[len(rows) :])
            whole = _announce(rows, missing)
        return [Reply(BROADCAST, delay, whole)]

    def _write_many(self, packet: Packet, listening: dict[int, Device]) -> list[Reply]:
        for id_, address, data in _writes(packet):
            device = listening.get(id_)
            if device is not None:
                device.write(address, data)
        return []

    def _refresh(self, devices: Iterable[Device], now: float) -> None:
        self.joints.measure()
        for device in devices:
            device.refresh(now)

    def _status(self, device: Device, instruction: int, error: int, data: bytes = b"") -> list[Reply]:
        lowest = 0 if instruction == Instruction.PING else 1 if instruction == Instruction.READ else 2
        if device.get("status_return_level") < lowest:
            return []
        error |= ALERT if device.alert else 0
        return [Reply(device.id, device.return_delay, encode_status(device.id, error, data))]


def _span(params: bytes) -> tuple[int, int]:
    return int.from_bytes(params[:2], "little"), int.from_bytes(params[2:4], "little")


def _bulk_requests(params: bytes) -> list[tuple[int, int, int]]:
    return [(params[at], *_span(params[at + 1 : at + 5])) for at in range(0, len(params) - 4, 5)]


def _announce(rows: list[tuple[int, int, bytes]], missing: int) -> bytes:
    """The first part of a fast reply; its header counts `missing` bytes more."""
    filler = (0, 0, bytes(missing - 4))
    return encode_fast_status([*rows, filler])[:-missing]


def _writes(packet: Packet) -> Iterator[tuple[int, int, bytes]]:
    """(id, address, data) of every write in a packet."""
    params = packet.params
    if packet.instruction == Instruction.WRITE:
        if len(params) > 2:
            yield packet.id, int.from_bytes(params[:2], "little"), params[2:]
        return
    if packet.instruction == Instruction.SYNC_WRITE:
        if len(params) < 4:
            return
        address, size = _span(params)
        for at in range(4, len(params) - size, size + 1):
            yield params[at], address, params[at + 1 : at + 1 + size]
        return
    at = 0
    while at + 5 <= len(params):
        address, size = _span(params[at + 1 : at + 5])
        data = params[at + 5 : at + 5 + size]
        if len(data) == size:
            yield params[at], address, data
        at += 5 + size
