"""Frames and commands byte by byte, compared with a third-party library."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from witmotion import protocol as others

from flexmotion.drivers.imu.witmotion.protocol import (
    BANDWIDTHS,
    KEY,
    RATES,
    CommandDecoder,
    FrameDecoder,
    Kind,
    Output,
    Register,
    command,
    frame,
)

# The manual's layout filled in by hand: at rest, z up (1 g is 2048), 25.00 degrees; 100 degrees/s about x.
AT_REST = bytes.fromhex("55 51 00 00 00 00 00 08 C4 09 7B")
ROLLING = bytes.fromhex("55 52 66 06 00 00 00 00 C4 09 E0")

numbers = st.tuples(*[st.integers(-32768, 32767)] * 4)


@pytest.mark.parametrize(
    ("wire", "kind", "content"),
    [(AT_REST, Kind.ACCEL, (0, 0, 2048, 2500)), (ROLLING, Kind.GYRO, (1638, 0, 0, 2500))],
)
def test_golden_frames_both_ways(wire: bytes, kind: Kind, content: tuple[int, int, int, int]) -> None:
    assert frame(kind, content) == wire
    assert list(FrameDecoder().feed(wire)) == [(kind, content)]


# The commands as the vendor's manual spells them.
@pytest.mark.parametrize(
    ("wire", "register", "value"),
    [
        ("FF AA 69 88 B5", Register.KEY, KEY),
        ("FF AA 00 00 00", Register.SAVE, 0),
        ("FF AA 02 06 00", Register.OUTPUT, Output.ACCEL | Output.GYRO),
        ("FF AA 03 0B 00", Register.RATE, RATES[200]),
        ("FF AA 1F 02 00", Register.BANDWIDTH, BANDWIDTHS[94]),
    ],
)
def test_golden_commands_both_ways(wire: str, register: Register, value: int) -> None:
    assert command(register, value) == bytes.fromhex(wire)
    assert list(CommandDecoder().feed(bytes.fromhex(wire))) == [(register, value)]


def test_another_library_reads_our_frames_and_writes_our_commands() -> None:
    acceleration = others.AccelerationMessage.parse(AT_REST[2:-1])
    assert acceleration.a == (0.0, 0.0, pytest.approx(others.G)) and acceleration.temp_celsius == 25.0
    assert others.AccelerationMessage.compute_checksum(AT_REST[2:-1]) == AT_REST[-1]
    turning = others.AngularVelocityMessage.parse(ROLLING[2:-1])
    assert turning.w[0] == pytest.approx(100, abs=0.03)
    assert others.AngularVelocityMessage.compute_checksum(ROLLING[2:-1]) == ROLLING[-1]
    for rate, theirs in ((200, others.ReturnRateSelect.rate_200hz), (100, others.ReturnRateSelect.rate_100hz)):
        wire = others.ConfigCommand(others.Register.rate, theirs.value).serialize()
        assert command(Register.RATE, RATES[rate]) == wire


@given(kind=st.integers(0x50, 0x5F), content=numbers, cut=st.integers(0, 11), noise=st.binary(max_size=30))
def test_a_frame_in_pieces_is_found_after_noise(
    kind: int, content: tuple[int, int, int, int], cut: int, noise: bytes
) -> None:
    wire, decoder = frame(kind, content), FrameDecoder()
    list(decoder.feed(noise))
    # A header in the noise may consume the frame after it, but not two.
    found = [*decoder.feed(wire[:cut]), *decoder.feed(wire[cut:] + wire + wire)]
    assert (kind, content) in found


def test_a_wrong_sum_is_counted_and_the_next_frame_found() -> None:
    spoilt = bytearray(AT_REST)
    spoilt[6] ^= 0x40
    decoder = FrameDecoder()
    assert list(decoder.feed(bytes(spoilt) + ROLLING)) == [(Kind.GYRO, (1638, 0, 0, 2500))]
    assert decoder.bad == 1
