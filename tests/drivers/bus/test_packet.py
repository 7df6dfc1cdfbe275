from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.bus.packet import SumDecoder, SumFormat, from_sign_magnitude, to_sign_magnitude
from flexmotion.drivers.feetech.registers import FORMAT as STS
from flexmotion.drivers.lx16a.protocol import FORMAT as LX

FORMATS = st.sampled_from([STS, LX])


def test_packets_by_hand() -> None:
    """Ping of id 1: 01 + 02 + 01 = 04, inverted FB. Move of id 1 to 500 in 1000 ms: the length includes itself."""
    assert STS.encode(1, 1) == bytes.fromhex("FF FF 01 02 01 FB")
    assert LX.encode(1, 1, bytes.fromhex("F4 01 E8 03")) == bytes.fromhex("55 55 01 07 01 F4 01 E8 03 16")


@given(form=FORMATS, id_=st.integers(0, 0xFD), code=st.integers(0, 255), params=st.binary(max_size=40))
def test_decoding_reverses_encoding(form: SumFormat, id_: int, code: int, params: bytes) -> None:
    if id_ == form.header:
        id_ += 1
    (packet,) = SumDecoder(form).feed(form.encode(id_, code, params))
    assert (packet.id, packet.code, packet.params) == (id_, code, params)


@given(form=FORMATS, noise=st.binary(max_size=30), cut=st.integers(1, 9))
def test_a_packet_in_pieces_is_found_after_noise(form: SumFormat, noise: bytes, cut: int) -> None:
    wire = form.encode(7, 2, b"\x01\x02\x03\x04")
    decoder = SumDecoder(form)
    list(decoder.feed(noise))
    decoder.clear()
    found = [*decoder.feed(wire[:cut]), *decoder.feed(wire[cut:])]
    assert [packet.id for packet in found] == [7]


def test_a_wrong_sum_is_no_packet() -> None:
    wire = bytearray(STS.encode(1, 2, b"\x05"))
    wire[-1] ^= 1
    decoder = SumDecoder(STS)
    assert list(decoder.feed(bytes(wire))) == [] and decoder.bad == 1


@pytest.mark.parametrize(("value", "bit", "raw"), [(5, 15, 5), (-5, 15, 0x8005), (-1023, 10, 0x7FF), (0, 11, 0)])
def test_sign_and_magnitude(value: int, bit: int, raw: int) -> None:
    assert to_sign_magnitude(value, bit) == raw
    assert from_sign_magnitude(raw, bit) == value
