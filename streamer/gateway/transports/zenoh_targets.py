"""`ZenohTargets`: messages over zenoh, for many robots and operators on one network.

A `put` to `flexmotion/ROBOT/targets/OPERATOR` is answered by one on `flexmotion/ROBOT/answers/OPERATOR`, a query on the
same key by its reply. The operator of the key is the source: a router's access control can say who may use which key.
"""

from __future__ import annotations

import asyncio
import json
import logging
import queue
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from flexmotion.streamer.gateway.hub import Hub
from flexmotion.streamer.gateway.messages import Answer, encode
from flexmotion.streamer.gateway.proofs import session_of
from flexmotion.streamer.gateway.status import Status
from flexmotion.streamer.gateway.transports.zenoh_link import ZenohLink
from flexmotion.streamer.gateway.transports.zenoh_session import attached, direct, keep_open, payload
from flexmotion.streamer.gateway.ways import Way

if TYPE_CHECKING:
    import zenoh

_STATUS_S = 0.1
"""Time between two publications of the status, while somebody reads it [s]."""
_LOOK_S = 0.5
"""Time between two looks whether the run has ended [s]."""

log = logging.getLogger(__name__)


class ZenohTargets:
    """A `flexmotion.streamer.gateway.hub.Transport`."""

    name = "zenoh"

    def __init__(self, link: ZenohLink) -> None:
        self.link = link

    def begin(self, hub: Hub, way: Way) -> Callable[[], None]:
        """See `Transport.begin`."""
        desk = _Desk(self.link, hub, way)
        reporting = asyncio.create_task(desk.report())
        close = keep_open(self.link.config, desk.serve, way, "zenoh", self.link.listen)
        # Sent in a thread of its own: a reader that takes nothing holds up no target.
        way.keep(desk.send, desk.ended, "zenoh-out")

        def end() -> None:
            reporting.cancel()
            desk.ended.set()
            close()

        return end


class _Desk:
    """The gateway's end of a session."""

    def __init__(self, link: ZenohLink, hub: Hub, way: Way) -> None:
        self.link, self.hub, self.way = link, hub, way
        self.ended = threading.Event()
        self._out: queue.Queue[Callable[[], None]] = queue.Queue(hub.settings.most_unread)
        self._status: zenoh.Publisher | None = None

    def serve(self, session: zenoh.Session) -> list[Any]:
        """Take part in a session until it is closed; returns what is declared."""
        from zenoh import CongestionControl

        self._session, self._block = session, CongestionControl.BLOCK
        targets, status = self.link.key("targets", "*"), self.link.key("status")
        self._status = session.declare_publisher(status)
        return [
            session.declare_subscriber(targets, direct(self._put, self.way)),
            session.declare_queryable(targets, direct(self._ask, self.way)),
            session.declare_queryable(status, direct(self._tell, self.way)),
            session.liveliness().declare_token(self.link.key("alive", "gateway")),
        ]

    async def report(self) -> None:
        """Publish the status while somebody reads it, without an end."""
        while True:
            await asyncio.sleep(_STATUS_S)
            if self._status is not None and self._status.matching_status and self._out.empty():
                self.hub.ask_status(self._publish)

    def _publish(self, status: Status) -> None:
        publisher = self._status
        if publisher is not None:
            self._later(lambda: publisher.put(status.model_dump_json()))

    def _put(self, sample: zenoh.Sample) -> None:
        operator = _last(sample)
        key = self.link.key("answers", operator)

        def reply(answer: Answer) -> None:
            self._later(lambda: self._session.put(key, encode(answer), congestion_control=self._block))

        self._take(sample, operator, reply)

    def _ask(self, query: zenoh.Query) -> None:
        operator = _last(query)

        def reply(answer: Answer) -> None:
            self._later(lambda: _reply(query, encode(answer)))

        if "*" in operator:
            reply(Answer(state="refused", reason="expected one operator's key"))
            return
        self._take(query, operator, reply)

    def _tell(self, query: zenoh.Query) -> None:
        refusal = self.link.refusal(query)
        if refusal is not None:
            self.hub.reject(refusal.why)
            self._later(lambda: _reply(query, encode(Answer(state="refused", reason=refusal.reason))))
            return

        def reply(status: Status) -> None:
            self._later(lambda: _reply(query, status.model_dump_json()))

        self.hub.ask_status(reply)

    def _take(self, message: zenoh.Sample | zenoh.Query, operator: str, reply: Callable[[Answer], None]) -> None:
        refusal = self.link.refusal(message)
        if refusal is None:
            # A program that is started again numbers its messages anew, and so does each proof's session.
            sender = ("zenoh", operator, session_of(attached(message)))
            self.hub.receive(_of(payload(message), operator), reply, sender)
        else:
            self.hub.reject(refusal.why)
            reply(Answer(state="refused", reason=refusal.reason))

    def _later(self, what: Callable[[], None]) -> None:
        try:
            self._out.put_nowait(what)
        except queue.Full:
            self.hub.reject("slow reader")

    def send(self) -> None:
        """Send what is to be sent until the end."""
        while not self.ended.is_set():
            try:
                self._out.get(timeout=_LOOK_S)()
            except queue.Empty:
                continue
            except Exception as error:  # of the library, such as a reader or a session that is gone
                self.hub.reject("not delivered")
                log.debug("not delivered: %s", error)


def _last(message: zenoh.Sample | zenoh.Query) -> str:
    return str(message.key_expr).rpartition("/")[2]


def _of(data: bytes, operator: str) -> bytes:
    """The message with the operator as its source; what is no JSON object stays as it is and is refused by the desk."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return data
    return json.dumps({**content, "source": operator}).encode() if isinstance(content, dict) else data


def _reply(query: zenoh.Query, text: str) -> None:
    with query:
        query.reply(query.key_expr, text)
