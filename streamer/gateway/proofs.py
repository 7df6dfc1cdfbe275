r"""`Prover` and `Proofs`: a message proves that its sender knows the run's token, without showing it.

On a network where others read along (a zenoh router tells every subscriber), a token that travels with a message is
everybody's. A proof is the text `1 SESSION NUMBER TIME MAC`, in ASCII, apart by one space:

    SESSION  16 hexadecimal digits, drawn at random by each program
    NUMBER   counts the program's messages
    TIME     when it was sent, milliseconds since 1970
    MAC      HMAC-SHA256 (RFC 2104), in hexadecimal digits, with the token as its key, of the bytes of
             "1 SESSION NUMBER TIME\nKEY\n" and the payload; KEY is the key expression that the message is sent to

It holds for one message to one key, once, and for `FRESH_S`.
"""

from __future__ import annotations

import hashlib
import hmac
import itertools
import re
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from flexmotion.streamer.gateway.admission import Refusal

FRESH_S = 5.0
"""A proof whose time differs by more from this machine's clock is refused [s]."""
_WINDOW = 1024
"""Numbers of a session that may arrive out of order; older ones are refused."""
_SESSIONS = 4096
"""Sessions whose numbers are remembered. Only who has the token can begin one."""
_FORM = re.compile(rb"(1 (?P<session>[0-9a-f]{16}) (?P<number>\d{1,15}) (?P<time>\d{1,15})) (?P<mac>[0-9a-f]{64})")


class Prover:
    """Proves the messages of one program. May be used from any thread.

    Args:
        token: of the run.
    """

    def __init__(self, token: str) -> None:
        self._token, self._session = token, secrets.token_hex(8)
        self._numbers = itertools.count(1)

    def prove(self, key: str, payload: bytes) -> str:
        """The proof of one message, which is its attachment.

        Args:
            key: key expression that it is sent to.
            payload: as it is sent.
        """
        head = f"1 {self._session} {next(self._numbers)} {time.time_ns() // 1_000_000}"
        return f"{head} {_mac(self._token, head.encode(), key, payload)}"


@dataclass
class _Session:
    """Numbers that have been seen: bit i of `seen` is that of `last` - i."""

    last: int = -1
    seen: int = 0

    def take(self, number: int) -> bool:
        """Whether a number is new, and not too old to know."""
        ahead = number - self.last
        if ahead > 0:
            self.seen = ((self.seen << min(ahead, _WINDOW)) | 1) & ((1 << _WINDOW) - 1)
            self.last = number
            return True
        if -ahead >= _WINDOW or self.seen >> -ahead & 1:
            return False
        self.seen |= 1 << -ahead
        return True


class Proofs:
    """Checks proofs, from any thread.

    Args:
        token: of the run; None: none is needed.
        now: seconds since 1970.
    """

    def __init__(self, token: str | None, now: Callable[[], float] = time.time) -> None:
        self._token, self._now, self._since_s = token, now, now()
        self._sessions: OrderedDict[bytes, _Session] = OrderedDict()
        self._lock = threading.Lock()

    def refusal(self, proof: bytes, key: str, payload: bytes, *, at_any_time: bool = False) -> Refusal | None:
        """Why a message is not taken; None where it is.

        Args:
            proof: its attachment; empty: it has none.
            key, payload: as it was sent.
            at_any_time: take one whose time is not now. For emergency stops: two clocks that differ hold up none.
        """
        if self._token is None:
            return None
        found = _FORM.fullmatch(proof)
        if found is None:
            return Refusal(401, "token", "expected a proof of the run's token as the attachment (docs/transports.md)")
        if not hmac.compare_digest(_mac(self._token, found[1], key, payload), found["mac"].decode()):
            return Refusal(401, "token", "the proof is not one of this run's token, this key and this payload")
        now_s, sent_s = self._now(), 1e-3 * int(found["time"])
        if not at_any_time:
            late_s = now_s - sent_s
            if abs(late_s) > FRESH_S:
                side = "ago" if late_s > 0 else "in the future"
                return Refusal(401, "stale proof", f"sent {abs(late_s):.0f} s {side} by this machine's clock")
            # Where the clock has been set back, the run's own beginning says nothing.
            if sent_s < self._since_s <= now_s:
                return Refusal(401, "stale proof", "sent before this run began")
        with self._lock:
            session = self._sessions.setdefault(found["session"], _Session())
            self._sessions.move_to_end(found["session"])
            while len(self._sessions) > _SESSIONS:
                self._sessions.popitem(last=False)
            if not session.take(int(found["number"])):
                return Refusal(401, "repeated proof", "a message with this proof has been taken already")
        return None


def session_of(proof: bytes) -> str | None:
    """The session that a proof names; None: it is no proof."""
    found = _FORM.fullmatch(proof)
    return None if found is None else found["session"].decode()


def _mac(token: str, head: bytes, key: str, payload: bytes) -> str:
    return hmac.new(token.encode(), b"%b\n%b\n%b" % (head, key.encode(), payload), hashlib.sha256).hexdigest()
