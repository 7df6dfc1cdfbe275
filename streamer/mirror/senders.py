"""`Senders`: whose datagrams are read: of this machine, or of one that has shown the token; one sender at a time."""

from __future__ import annotations

import ipaddress
import json

from flexmotion.streamer.gateway.admission import Admission

SHOWN_S = 60.0
"""An address is read for this long after it has shown the token [s]."""
HELD_S = 1.0
"""A sender that is silent for this long makes room for another [s]."""
MOST_A_SECOND = 2000
"""Datagrams that are read in a second; more are a flood, and are dropped unread."""
_MOST_KNOWN = 64

Address = tuple[str, int]


class Senders:
    """Decides about each datagram before it is read.

    Without a token only this machine is read, whatever address is listened to. A token is shown by a datagram
    `{"token": "…"}` from the same IP address.

    Args:
        admission: address and token.

    Attributes:
        refused: datagrams that were not read, by reason.
    """

    def __init__(self, admission: Admission) -> None:
        self._admission = admission
        self.refused = {"address": 0, "token": 0, "second sender": 0, "flood": 0}
        self._shown: dict[str, float] = {}
        self._holder: tuple[Address, float] | None = None
        self._second, self._count = 0, 0

    def admits(self, datagram: bytes, address: Address, now_s: float) -> bool:
        """Whether a datagram is to be read as a frame.

        Args:
            address: where it comes from.
            now_s: present time [s].
        """
        if int(now_s) != self._second:
            self._second, self._count = int(now_s), 0
        self._count += 1
        if self._count > MOST_A_SECOND:
            return self._refuse("flood")
        if datagram.startswith(b'{"token"'):
            self._show(datagram, address[0], now_s)
            return False
        if not _is_loopback(address[0]):
            if self._admission.token is None:
                return self._refuse("address")
            shown_s = self._shown.get(address[0])
            if shown_s is None or now_s > shown_s + SHOWN_S:
                return self._refuse("token")
        if self._holder is not None and self._holder[0] != address and now_s < self._holder[1] + HELD_S:
            return self._refuse("second sender")
        return True

    def heard(self, address: Address, now_s: float) -> bool:
        """A frame has come from a sender; returns whether it is another one than before."""
        changed = self._holder is None or self._holder[0] != address
        self._holder = address, now_s
        return changed

    def _show(self, datagram: bytes, host: str, now_s: float) -> None:
        try:
            given = json.loads(datagram).get("token")
        except (ValueError, RecursionError, AttributeError):
            given = None
        opened = self._admission.token is not None and isinstance(given, str) and self._admission.opens(given.encode())
        if not opened:
            self._refuse("token")
            return
        self._shown = {one: at for one, at in self._shown.items() if now_s <= at + SHOWN_S}
        if len(self._shown) < _MOST_KNOWN:
            self._shown[host] = now_s

    def _refuse(self, reason: str) -> bool:
        self.refused[reason] += 1
        return False


def _is_loopback(host: str) -> bool:
    return ipaddress.ip_address(host.partition("%")[0]).is_loopback
