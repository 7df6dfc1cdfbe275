"""`ZenohStops`: STOP and emergency stop over zenoh, in the stop process and with a session of its own.

A `put` to `flexmotion/ROBOT/stop` or `.../estop` is answered on `flexmotion/ROBOT/answers/stop` or `.../estop`, a query
on the same key by its reply. STOP needs no token.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from flexmotion.streamer.gateway.presses import Presses, told
from flexmotion.streamer.gateway.transports.zenoh_link import ZenohLink
from flexmotion.streamer.gateway.transports.zenoh_session import direct, keep_open
from flexmotion.streamer.gateway.ways import Way
from flexmotion.streamer.run.requests import Request

if TYPE_CHECKING:
    import zenoh

_ASKS = {"stop": Request.STOP, "estop": Request.ESTOP}


class ZenohStops:
    """A `flexmotion.streamer.gateway.presses.StopInput`."""

    name = "zenoh"

    def __init__(self, link: ZenohLink) -> None:
        self.link = link

    def begin(self, presses: Presses, way: Way) -> Callable[[], None]:
        """See `StopInput.begin`."""

        def serve(session: zenoh.Session) -> list[Any]:
            declared: list[Any] = []
            for word, asked in _ASKS.items():
                key = self.link.key(word)
                presser, answerer = self._presser(session, presses, word, asked), self._answerer(presses, word, asked)
                declared.append(session.declare_subscriber(key, direct(presser, way)))
                declared.append(session.declare_queryable(key, direct(answerer, way)))
            # Last: a client that sees the token may ask at once.
            declared.append(session.liveliness().declare_token(self.link.key("alive", "stops")))
            return declared

        return keep_open(self.link.config, serve, way, "zenoh-stops", self.link.listen)

    def _presser(
        self, session: zenoh.Session, presses: Presses, word: str, asked: Request
    ) -> Callable[[zenoh.Sample], None]:
        key = self.link.key("answers", word)

        def press(sample: zenoh.Sample) -> None:
            self._press(sample, presses, asked, lambda content: session.put(key, json.dumps(content)))

        return press

    def _answerer(self, presses: Presses, word: str, asked: Request) -> Callable[[zenoh.Query], None]:
        key = self.link.key(word)

        def answer(query: zenoh.Query) -> None:
            def reply(content: dict[str, Any]) -> None:
                with query:
                    query.reply(key, json.dumps(content))

            self._press(query, presses, asked, reply)

        return answer

    def _press(
        self,
        message: zenoh.Sample | zenoh.Query,
        presses: Presses,
        asked: Request,
        reply: Callable[[dict[str, Any]], None],
    ) -> None:
        refusal = None if asked is Request.STOP else self.link.refusal(message, at_any_time=True)
        if refusal is None:
            presses.press(asked, "zenoh", reply)
        else:
            reply(told(asked, "refused", reason=refusal.reason))
