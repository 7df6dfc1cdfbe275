"""Sessions of zenoh: their configuration, and how a process keeps one."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from flexmotion.streamer.gateway.ways import Way

if TYPE_CHECKING:
    import zenoh

_LARGEST = 65536
"""Longest message that is put together from its parts [bytes]; the desk refuses far shorter ones and says so."""
_UNREAD_S = 0.5
"""A connection whose other side takes nothing for so long is closed [s]: answers to others wait behind its own."""
_RETRY_S = 2.0
"""Time between two attempts to open a session, and between two looks whether it is open [s]."""


def configuration(values: Mapping[str, Any]) -> zenoh.Config:
    """A configuration with these values, of a session that looks for nobody by itself and connects again."""
    import zenoh

    config = zenoh.Config()
    common = {
        "connect/retry": {"period_init_ms": 250, "period_max_ms": 2000, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/rx/max_message_size": _LARGEST,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": int(1e6 * _UNREAD_S),
    }
    for key, value in {**common, **values}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def keep_open(
    config: Callable[[], zenoh.Config],
    serve: Callable[[zenoh.Session], list[Any]],
    way: Way,
    name: str,
    where: str,
) -> Callable[[], None]:
    """Keep a session open in a thread of its own, which opens it again where it fails; returns what closes it.

    Args:
        config: makes its configuration.
        serve: declares what the session is for, and returns it: it lasts as long as somebody refers to it.
        way: is told whether the session is open.
        name: of the thread.
        where: it is opened, for messages.
    """
    ended = threading.Event()

    def work() -> None:
        import zenoh

        while not ended.is_set():
            try:
                session = zenoh.open(config())
            except zenoh.ZError as error:
                way.fails(f"{where} cannot be reached, it is waited for: {plain(error)}")
                ended.wait(_RETRY_S)
                continue
            declared: list[Any] = []
            try:
                declared += serve(session)
                way.works()
                while not ended.wait(_RETRY_S):
                    if session.is_closed():
                        raise ConnectionError("the session was closed")
            finally:
                declared.clear()
                session.close()

    thread = way.keep(work, ended, name)

    def end() -> None:
        ended.set()
        thread.join(2.0 * _RETRY_S)

    return end


def plain(error: Exception) -> str:
    """What zenoh says of an error, without the places in its own source code."""
    text = re.sub(r" at /\S+\.rs:\d+\.?", "", str(error))
    named = re.search(r'msg: "(.*?)"', text)
    return named[1] if named else text


def payload(message: Any) -> bytes:
    """The bytes of a sample or a query; a query may have none."""
    return b"" if message.payload is None else bytes(message.payload.to_bytes())


def attached(message: Any) -> bytes:
    """The bytes of a message's attachment; none: b""."""
    return b"" if message.attachment is None else bytes(message.attachment.to_bytes())


def direct(take: Callable[[Any], None], way: Way) -> Any:
    """A handler that is called in zenoh's own thread: a function that waits makes the sender wait."""
    from zenoh import handlers

    return handlers.Callback(way.guarded(take), indirect=False)
