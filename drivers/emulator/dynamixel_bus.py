"""`EmulatedDynamixelBus`: devices on one bus that receive and answer packets of Protocol 2.0."""

from __future__ import annotations

from collections.abc import Iterable

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
from flexmotion.drivers.emulator.wire import Reply

CLEAR_KEY = b"\x44\x58\x4c\x22"

MISSED_SLOT_S = 0.0002
"""Time that servos wait for a missing one before them in a sync read (assumption) [s]."""

_LENGTH = slice(5, 7)
"""Position of the length field in a packet; the instruction follows it."""
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
        self._index()

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
        self._by_id = {device.id: device for device in self.devices}

    def _listening(self, device: Device, baud: int, now: float) -> bool:
        if device.id in self.dead or device.baud != baud or now < device.off_until:
            return False
        return self._powered or not isinstance(device, XServo)

    def _handle(self, packet: Packet, baud: int, now: float) -> list[Reply]:
        listening = {id_: device for id_, device in self._by_id.items() if self._listening(device, baud, now)}
        self.received += packet.intact
        self.bad += not packet.intact
        if not packet.intact:
            device = listening.get(packet.id)
            return [] if device is None else self._status(device, packet.instruction, Error.CRC)
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
            Instruction.SYNC_WRITE: self._sync_write,
            Instruction.BULK_WRITE: self._bulk_write,
        }
        if packet.id == BROADCAST and packet.instruction in handlers:
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
        if self._board is not None and self._board.powered != self._powered:
            self._powered = self._board.powered
            for servo in self.servos:
                servo.reboot(now)
        self.joints.commit()
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
                device.registered = (address, content)
            else:
                error = device.write(address, content)
                self._index()
            return reply if not error else self._status(device, kind, error)
        elif kind == Instruction.ACTION:
            if device.registered is not None:
                error = device.write(*device.registered)
                device.registered = None
        elif kind == Instruction.FACTORY_RESET:
            if len(params) != 1 or params[0] not in (0xFF, 1, 2) or device.locked:
                error = Error.RESULT
            else:
                reply = self._status(device, kind, Error.NONE)
                device.factory_reset(params[0], now)
                self._index()
                return reply
        elif kind == Instruction.REBOOT:
            reply = self._status(device, kind, Error.NONE)
            device.reboot(now)
            return reply
        elif kind == Instruction.CLEAR:
            error = Error.NONE if params == b"\x01" + CLEAR_KEY else Error.RESULT
        else:
            error = Error.INSTRUCTION
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

    def _sync_write(self, params: bytes, listening: dict[int, Device], now: float) -> list[Reply]:
        if len(params) < 4:
            return []
        address, size = _span(params)
        if size and (len(params) - 4) % (size + 1) == 0:
            for at in range(4, len(params), size + 1):
                device = listening.get(params[at])
                if device is not None:
                    device.write(address, params[at + 1 : at + 1 + size])
            self._index()
        return []

    def _bulk_write(self, params: bytes, listening: dict[int, Device], now: float) -> list[Reply]:
        at = 0
        while at + 5 <= len(params):
            address, size = _span(params[at + 1 : at + 5])
            data = params[at + 5 : at + 5 + size]
            device = listening.get(params[at])
            if device is not None and len(data) == size:
                device.write(address, data)
            at += 5 + size
        self._index()
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
