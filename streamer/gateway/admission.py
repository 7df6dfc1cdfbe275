"""`Admission`: who may speak to a run over the network: token, host and origin of every request.

By default only this machine is listened to. A page from elsewhere that is open in a browser of this machine could still
send requests to it: they carry the page's origin, or (after DNS rebinding) its host name, and are refused.
"""

from __future__ import annotations

import hmac
import ipaddress
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from flexmotion.configs.errors import ConfigError

TOKEN_VARIABLE = "FLEXMOTION_TOKEN"
SHORTEST_TOKEN = 16


@dataclass(frozen=True)
class Refusal:
    """Why a request is not admitted.

    Attributes:
        status: of HTTP.
        why: for counts: "host", "origin" or "token".
        reason: for the sender.
    """

    status: int
    why: str
    reason: str


class Admission:
    """Checks requests.

    Args:
        address: that is listened to.
        token: that a request must carry; None: none.
        page_port: a page from this port of the same host is no foreign one.

    Raises:
        ConfigError: other machines can reach the address and there is no token, or the token is too short.
    """

    def __init__(self, address: str = "127.0.0.1", token: str | None = None, *, page_port: int | None = None) -> None:
        self.address, self.token, self.page_port = address, token, page_port
        if token is None and not is_loopback(address):
            raise ConfigError(
                f"--listen: {address} is reached from other machines and needs a token: set {TOKEN_VARIABLE} "
                "or give --token-file"
            )
        if token is not None and (len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable()):
            raise ConfigError(f"token: expected {SHORTEST_TOKEN} printable ASCII characters or more")
        name = socket.gethostname().lower()
        self._names = {"localhost", address.lower(), name}
        if not is_loopback(address):
            self._names.add(f"{name.split('.')[0]}.local")  # by multicast DNS, as phones and laptops find a robot

    def refusal(self, headers: Mapping[str, str], query: str = "", *, token_needed: bool = True) -> Refusal | None:
        """Why a request is not admitted; None where it is.

        Args:
            headers: of HTTP, names in lower case.
            query: of the address; browsers cannot set headers of a WebSocket and send the token there.
            token_needed: whether the request must carry the token.
        """
        host = headers.get("host", "")
        if not self._known(host):
            return Refusal(403, "host", f"host {host[:80]!r}: expected an IP address, localhost or this machine's name")
        origin = headers.get("origin")
        if origin is not None and not self._is_ours(origin, host):
            return Refusal(403, "origin", f"origin {origin[:80]!r}: pages of other servers may not steer the robot")
        given = headers.get("authorization", "").removeprefix("Bearer ") or parse_qs(query).get("token", [""])[0]
        if token_needed and not self.opens(given.encode()):
            found = "not the token of this run; " if given else ""
            return Refusal(401, "token", f"{found}expected the header 'Authorization: Bearer TOKEN'")
        return None

    @property
    def everywhere(self) -> bool:
        """Whether all addresses of this machine are listened to."""
        return _is_address(self.address) and ipaddress.ip_address(self.address).is_unspecified

    def opens(self, given: bytes) -> bool:
        """Whether what a sender gives is the token; always where there is none."""
        return self.token is None or hmac.compare_digest(given, self.token.encode())

    def _is_ours(self, origin: str, host: str) -> bool:
        try:
            page, here = urlsplit(origin), urlsplit(f"//{host}")
            same_port = page.netloc.lower() == host.lower() or (page.port is not None and page.port == self.page_port)
        except ValueError:
            return False
        return page.scheme in ("http", "https") and page.hostname == here.hostname and same_port

    def _known(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return name in self._names or _is_address(name)


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches an address."""
    return address == "localhost" or (_is_address(address) and ipaddress.ip_address(address).is_loopback)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def find_token(file: Path | None = None) -> str | None:
    """The token of a file, else of the environment variable; never of the command line, which all users can read.

    Raises:
        ConfigError: the file cannot be read, or other users can read it.
    """
    if file is None:
        return os.environ.get(TOKEN_VARIABLE) or None
    try:
        if file.stat().st_mode & 0o077:
            raise ConfigError(f"{file}: other users can read it: chmod 600 {file}")
        return file.read_text(encoding="ascii").strip()
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: expected ASCII characters") from error
