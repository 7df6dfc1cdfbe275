"""Bytes that are no message, at every door of a run: each is refused, and the door stays open."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from flexmotion.streamer.gateway.service import GatewayService

from ...waiting import HANGING_S
from .conftest import Answering
from .test_server import answered, counts, http

FRAMES, CONNECTIONS = 2000, 100


def noise(number: int) -> bytes:
    random = np.random.default_rng(number)
    return random.bytes(int(random.integers(1, 300)))


def test_random_frames_are_each_refused(
    begin: Callable[..., GatewayService], answering: Callable[..., Answering]
) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    with connect(f"ws://127.0.0.1:{gateway.port}/targets") as client:
        for number in range(FRAMES):
            client.send(noise(number))
            assert answered(client)["state"] == "refused"
        client.send('{"type":"text","text":"wave"}')
        assert answered(client)["state"] == "accepted"
    assert counts(gateway.port)["rejected: not valid"] == FRAMES and len(planner.seen) == 1


def test_random_bytes_instead_of_http_leave_the_port_open(
    begin: Callable[..., GatewayService], answering: Callable[..., Answering]
) -> None:
    gateway = begin()
    planner = answering(gateway.requests)
    for number in range(CONNECTIONS):
        with socket.create_connection(("127.0.0.1", gateway.port), timeout=HANGING_S) as raw:
            raw.sendall(noise(number) + b"\r\n\r\n")
    for number in range(CONNECTIONS):
        status, content = http(gateway.port, "POST", "/targets", noise(number))
        assert status in (409, 422) and content["state"] == "refused"
    status, content = http(gateway.port, "POST", "/text", json.dumps({"text": "wave"}).encode())
    assert (status, content["state"]) == (200, "accepted") and len(planner.seen) == 1


def test_frames_that_break_the_protocol_close_their_connection_alone(
    begin: Callable[..., GatewayService], answering: Callable[..., Answering]
) -> None:
    gateway = begin()
    answering(gateway.requests)
    with connect(f"ws://127.0.0.1:{gateway.port}/targets") as good:
        with connect(f"ws://127.0.0.1:{gateway.port}/targets") as bad:
            bad.socket.sendall(b"\xff" * 64)  # reserved bits and no mask
            try:
                while True:
                    bad.recv(HANGING_S)
            except ConnectionClosed:
                pass
        good.send('{"type":"text","text":"wave"}')
        assert answered(good)["state"] == "accepted"
