"""The live view for Foxglove, read by a client that was written against the document of its protocol."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from flexmotion.configs.errors import ConfigError
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.gateway.ports import any_free
from flexmotion.streamer.log.cdr import ENCAPSULATION, parse_schema, row_dtype
from flexmotion.streamer.log.live_view import LiveView
from flexmotion.streamer.log.recording import show_in_foxglove
from flexmotion.streamer.motion.sources import ClipSource

from ...waiting import HANGING_S

SUBSCRIPTION, SEEN = 7, 100
_MESSAGE = struct.Struct("<BIQ")
Make = Callable[..., Any]


def advertised(client: ClientConnection, topics: set[str]) -> dict[str, dict[str, Any]]:
    """The channels, by topic, once all are known."""
    found: dict[str, dict[str, Any]] = {}
    while not topics <= set(found):
        frame = client.recv(HANGING_S)
        content = json.loads(frame) if isinstance(frame, str) else {}
        if content.get("op") == "advertise":
            found |= {channel["topic"]: channel for channel in content["channels"]}
    return found


def test_a_viewer_gets_every_tick_from_then_on_as_the_log_has_it(logged_session: Make, tmp_path: Path) -> None:
    session = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[225:290])).session
    view = show_in_foxglove(any_free(), session)
    received: list[bytes] = []

    def take(patience_s: float) -> bool:
        """Take a message; returns whether one came."""
        try:
            frame = client.recv(patience_s)
        except TimeoutError:
            return False
        if isinstance(frame, bytes) and frame[0] == 1:
            assert _MESSAGE.unpack_from(frame)[1] == SUBSCRIPTION
            received.append(frame[_MESSAGE.size :])
        return True

    with session:
        with connect(view.url, subprotocols=["foxglove.sdk.v1"]) as client:
            tick = advertised(client, {"/tick", "/plan", "/event"})["/tick"]
            subscription = {"id": SUBSCRIPTION, "channelId": tick["id"]}
            client.send(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
            while not received:
                assert session.step(), "no tick came until the end of the run"
                take(0.1)
            while len(received) < SEEN:
                assert session.step()
                while take(0.0):
                    pass
        session.finish()
    layout = [("encapsulation", "V", len(ENCAPSULATION)), *row_dtype(parse_schema(tick["schema"])).descr]
    rows = np.frombuffer(b"".join(received), np.dtype(layout))
    ticks = rows["tick"].tolist()
    assert ticks == list(range(ticks[0], ticks[0] + len(ticks)))
    record = session.record.rows
    kept = record[np.isin(record["tick"], ticks)]
    np.testing.assert_array_equal(rows["q_cmd"].reshape(len(rows), -1), kept["q_cmd"])


def test_only_this_machine_is_listened_to(logged_session: Make, tmp_path: Path) -> None:
    session = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[:30])).session
    view = show_in_foxglove(any_free(), session)
    with session:
        assert session.step()
        with socket.create_connection(("127.0.0.1", view.port)):
            pass
        addresses = {one[4][0] for one in socket.getaddrinfo(socket.gethostname(), None)} - {"127.0.0.1", "::1"}
        addresses = {address for address in addresses if not address.startswith("127.")}
        for address in addresses:
            with pytest.raises(OSError):
                socket.create_connection((address, view.port), timeout=1.0)


def test_a_port_that_is_taken_is_told_before_the_run(logged_session: Make, tmp_path: Path) -> None:
    session = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[:30])).session
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(ConfigError, match="--foxglove: 127.0.0.1:"):
        show_in_foxglove(taken.getsockname()[1], session)


def test_nothing_is_packed_while_nobody_watches(
    logged_session: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed: list[int] = []
    monkeypatch.setattr("flexmotion.streamer.log.live_view.Following", lambda *_args, **_options: packed.append(1))
    session = logged_session(tmp_path / "run.mcap", ClipSource(default_clip()[:30])).session
    show_in_foxglove(any_free(), session)
    session.run()
    assert packed == [] and isinstance(session.services[-1], LiveView)
