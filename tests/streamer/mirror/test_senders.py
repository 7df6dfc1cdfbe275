from __future__ import annotations

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.commands.options import MIRROR_ADDRESS
from flexmotion.streamer.gateway.admission import Admission
from flexmotion.streamer.mirror.sender_clock import SenderClock
from flexmotion.streamer.mirror.senders import HELD_S, MOST_A_SECOND, SHOWN_S, Senders
from flexmotion.streamer.mirror.service import PORT, parse_address

HERE, THERE = ("127.0.0.1", 4000), ("10.0.0.7", 4000)
TOKEN = "0123456789abcdef"


def test_only_this_machine_is_read_without_a_token():
    senders = Senders(Admission())
    assert senders.admits(b"{}", HERE, 0.0) and senders.admits(b"{}", ("::1", 1), 0.0)
    assert not senders.admits(b"{}", THERE, 0.0)
    assert not senders.admits(b'{"token": "0123456789abcdef"}', THERE, 0.0)
    assert not senders.admits(b"{}", THERE, 0.1)
    assert senders.refused == {"address": 2, "token": 1, "second sender": 0, "flood": 0}


def test_an_address_that_others_reach_needs_a_token():
    with pytest.raises(ConfigError, match="token"):
        Admission("0.0.0.0")


def test_another_machine_is_read_after_it_has_shown_the_token():
    senders = Senders(Admission("0.0.0.0", TOKEN))
    assert not senders.admits(b"{}", THERE, 0.0)
    assert not senders.admits(b'{"token": "another-token-000"}', THERE, 0.1)
    assert not senders.admits(b"{}", THERE, 0.2)
    assert not senders.admits(f'{{"token": "{TOKEN}"}}'.encode(), THERE, 1.0)  # it is no frame itself
    assert senders.admits(b"{}", ("10.0.0.7", 9), 1.1)  # from any port of that machine
    assert not senders.admits(b"{}", ("10.0.0.8", 9), 1.1)
    assert not senders.admits(b"{}", THERE, 1.1 + SHOWN_S)


@pytest.mark.parametrize("datagram", [b'{"token"', b'{"token": 7}', b'{"token": ["x"]}', b'{"token": "\xff"}'])
def test_a_token_that_is_none_is_counted(datagram):
    senders = Senders(Admission("0.0.0.0", TOKEN))
    assert not senders.admits(datagram, THERE, 0.0)
    assert senders.refused["token"] == 1


def test_one_sender_at_a_time_is_read():
    senders = Senders(Admission())
    second = ("127.0.0.1", 4001)
    assert senders.heard(HERE, 0.0) and not senders.heard(HERE, 0.1)
    assert not senders.admits(b"{}", second, 0.5)
    assert senders.admits(b"{}", second, 0.1 + HELD_S)
    assert senders.heard(second, 0.1 + HELD_S)
    assert senders.refused["second sender"] == 1


def test_a_flood_is_dropped_unread_and_ends_with_its_second():
    senders = Senders(Admission())
    admitted = sum(senders.admits(b"x", HERE, 5.0) for _ in range(MOST_A_SECOND + 10))
    assert admitted == MOST_A_SECOND and senders.refused["flood"] == 10
    assert senders.admits(b"x", HERE, 6.0)


def test_delays_of_the_wire_do_not_move_frames():
    clock = SenderClock()
    delays = [0.02, 0.005, 0.05, 0.005, 0.03]
    times = [clock.local(100.0 + 0.033 * n, 7.0 + 0.033 * n + delay) for n, delay in enumerate(delays)]
    # From the least delay on they are apart as they were sent.
    assert times[2] - times[1] == pytest.approx(0.033) and times[4] - times[1] == pytest.approx(0.099)
    assert all(
        time <= 7.0 + 0.033 * n + delay + 1e-9 for n, (time, delay) in enumerate(zip(times, delays, strict=True))
    )


def test_a_clock_that_was_set_is_learnt_anew():
    clock = SenderClock()
    assert clock.local(100.0, 7.0) == pytest.approx(7.0)
    assert clock.local(5.0, 7.1) == pytest.approx(7.1)


def test_a_frame_without_a_time_is_of_its_arrival():
    assert SenderClock().local(None, 7.0) == 7.0


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("127.0.0.1:5000", "127.0.0.1", 5000),
        ("5000", "127.0.0.1", 5000),
        (":5000", "127.0.0.1", 5000),
        ("localhost", "127.0.0.1", PORT),
        ("10.0.0.7", "10.0.0.7", PORT),
        (MIRROR_ADDRESS, "127.0.0.1", PORT),
        ("[::1]:5000", "::1", 5000),
    ],
)
def test_addresses(text, host, port):
    assert parse_address(text) == (host, port)


@pytest.mark.parametrize("text", ["robot:5000", "127.0.0.1:x", "127.0.0.1:0", "127.0.0.1:70000"])
def test_wrong_addresses_are_named(text):
    with pytest.raises(ConfigError, match="--mirror"):
        parse_address(text)
