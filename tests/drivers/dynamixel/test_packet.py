from __future__ import annotations

import pytest
from dynamixel_sdk import PacketHandler
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.drivers.dynamixel.packet import (
    BROADCAST,
    Decoder,
    Instruction,
    crc16,
    encode,
    encode_fast_status,
    encode_status,
    split_fast_status,
)

# The examples of the public manual (ROBOTIS e-Manual, Protocol 2.0): name, bytes, id, instruction, params.
GOLDEN = [
    ("ping", "FF FF FD 00 01 03 00 01 19 4E", 1, Instruction.PING, ""),
    ("ping status", "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D", 1, Instruction.STATUS, "00 06 04 26"),
    ("broadcast ping", "FF FF FD 00 FE 03 00 01 31 42", BROADCAST, Instruction.PING, ""),
    ("read", "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15", 1, Instruction.READ, "84 00 04 00"),
    ("read status", "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0", 1, Instruction.STATUS, "00 A6 00 00 00"),
    ("write", "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89", 1, Instruction.WRITE, "74 00 00 02 00 00"),
    ("sync read", "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA", BROADCAST, Instruction.SYNC_READ,
     "84 00 04 00 01 02"),
    ("sync write", "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87", BROADCAST,
     Instruction.SYNC_WRITE, "74 00 04 00 01 96 00 00 00 02 AA 00 00 00"),
    ("bulk read", "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05", BROADCAST, Instruction.BULK_READ,
     "01 90 00 02 00 02 92 00 01 00"),
    ("bulk write", "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68", BROADCAST,
     Instruction.BULK_WRITE, "01 20 00 02 00 A0 00 02 1F 00 01 00 50"),
    ("fast sync read", "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2", BROADCAST, Instruction.FAST_SYNC_READ,
     "84 00 04 00 03 07 04"),
]  # fmt: skip

FAST_REPLY = bytes.fromhex(
    "FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E"
)
FAST_ROWS = [(0, 3, bytes.fromhex("A6000000")), (0, 7, bytes.fromhex("1F080000")), (0, 4, bytes.fromhex("FF030000"))]


@pytest.mark.parametrize(("name", "wire", "id_", "instruction", "params"), GOLDEN)
def test_golden_packets_of_the_manual_both_ways(
    name: str, wire: str, id_: int, instruction: Instruction, params: str
) -> None:
    assert encode(id_, instruction, bytes.fromhex(params)) == bytes.fromhex(wire)
    (packet,) = Decoder().feed(bytes.fromhex(wire))
    assert packet.intact
    assert (packet.id, packet.instruction, packet.params) == (id_, instruction, bytes.fromhex(params))


def test_golden_fast_sync_read_reply_both_ways() -> None:
    assert encode_fast_status(FAST_ROWS) == FAST_REPLY
    assert list(split_fast_status(FAST_REPLY, 4)) == FAST_ROWS


def test_a_fast_reply_that_goes_wrong_gives_the_servos_before() -> None:
    assert list(split_fast_status(FAST_REPLY[:-3], 4)) == FAST_ROWS[:2]
    flipped = bytearray(FAST_REPLY)
    flipped[18] ^= 0x40
    assert list(split_fast_status(bytes(flipped), 4)) == FAST_ROWS[:1]


def test_status_carries_its_error_byte_first() -> None:
    assert encode_status(1, 0, bytes.fromhex("060426")) == bytes.fromhex(GOLDEN[1][1])


def test_stuffing_is_what_the_sdk_does() -> None:
    params = bytes.fromhex("74 00 FF FF FD 00 FF FF FF FD")
    ours = encode(1, Instruction.WRITE, params)
    assert b"\xff\xff\xfd\xfd" in ours
    theirs = [0xFF, 0xFF, 0xFD, 0, 1, len(params) + 3, 0, Instruction.WRITE, *params, 0, 0]
    handler = PacketHandler(2.0)
    # The SDK's txPacket drops the result of its own byte stuffing; the driver encodes its packets itself, see
    # `flexmotion.drivers.dynamixel.sdk`.
    assert bytes(handler.addStuffing(theirs)[:-2]) == ours[:-2]
    assert handler.updateCRC(0, list(ours), len(ours) - 2) == crc16(ours[:-2])


@settings(max_examples=200)
@given(st.integers(0, 254), st.integers(0, 255), st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x42]), max_size=40))
def test_every_packet_is_decoded_as_encoded(id_: int, instruction: int, params: list[int]) -> None:
    (packet,) = Decoder().feed(encode(id_, instruction, bytes(params)))
    assert packet.intact
    assert (packet.id, packet.instruction, packet.params) == (id_, instruction, bytes(params))


@settings(max_examples=300)
@given(st.binary(max_size=60), st.integers(1, 7))
def test_noise_before_a_packet_is_skipped(noise: bytes, step: int) -> None:
    decoder = Decoder()
    # A header in the noise may announce a longer packet than there is.
    wire = noise + encode(7, Instruction.PING) * 2 + bytes(1100) + encode(9, Instruction.PING)
    found = [packet for at in range(0, len(wire), step) for packet in decoder.feed(wire[at : at + step])]
    assert 9 in [packet.id for packet in found if packet.intact]
    assert len(decoder._buffer) <= 1100


def test_a_wrong_crc_is_reported_and_the_next_packet_found() -> None:
    wire = bytearray(encode(1, Instruction.PING))
    wire[-1] ^= 1
    packets = list(Decoder().feed(bytes(wire) + encode(2, Instruction.PING)))
    assert [(packet.id, packet.intact) for packet in packets] == [(1, False), (2, True)]
