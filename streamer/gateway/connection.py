"""`Messages`: what both clients of a run send, and how they reach it."""

from __future__ import annotations

import itertools
import json
import uuid
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict
from websockets.exceptions import InvalidStatus

from flexmotion.configs.errors import GatewayError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.admission import find_token
from flexmotion.streamer.gateway.messages import Answer, KillMessage, decode, encode

_DEFAULT = Gateway()
PATIENCE_S = 10.0
"""Longest wait for an answer [s]; a run answers within its `take_up_s`."""


class StopAnswer(BaseModel):
    """Answer of the stop process.

    Attributes:
        asked: "stop" or "estop".
        state: accepted, or refused for `reason`.
        arrived_tick: newest tick of the loop when the request arrived; -1: none yet.
        tick: before which the loop took it.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    asked: str | None
    state: str
    arrived_tick: int | None = None
    tick: int | None = None
    reason: str | None = None


class Messages:
    """What both clients send.

    Args:
        host, port, stop_port: of the run.
        source: name of this program; the run's settings give it a priority.
        token: of the run; None: the environment variable FLEXMOTION_TOKEN, if it is set.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = _DEFAULT.port,
        *,
        stop_port: int = _DEFAULT.stop_port,
        source: str = "client",
        token: str | None = None,
    ) -> None:
        self.host, self.port, self.stop_port, self.source = host, port, stop_port, source
        self.token = find_token() if token is None else token
        self._ids, self._session = itertools.count(1), uuid.uuid4().hex[:8]

    @property
    def url(self) -> str:
        """Of its WebSocket."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"ws://{host}:{self.port}/targets"

    @property
    def options(self) -> dict[str, Any]:
        """Of the connection, for `websockets`."""
        return {
            "additional_headers": self.headers,
            "open_timeout": PATIENCE_S,
            "compression": None,
            "proxy": None,
        }

    @property
    def headers(self) -> dict[str, str]:
        """Of HTTP: the token."""
        return {} if self.token is None else {"Authorization": f"Bearer {self.token}"}

    def message(self, content: Mapping[str, Any]) -> tuple[str, str]:
        """The id and the text of a message. Raises `MessageError` where it is not valid."""
        known = {key: value for key, value in content.items() if value is not None}
        number = next(self._ids)
        identity = str(known.setdefault("id", f"{self._session}-{number}"))
        known = {"source": self.source, "sequence": number, **known}
        return identity, encode(decode(json.dumps(known).encode()))

    def failed(self, error: Exception) -> GatewayError:
        """What to raise for an error of the connection."""
        where = f"{self.host}:{self.port}"
        if isinstance(error, InvalidStatus):
            reason = error.response.body.decode(errors="replace") if error.response.body else str(error)
            return GatewayError(f"{where}: the run refuses the connection: {reason}")
        if isinstance(error, ConnectionRefusedError):
            return GatewayError(f"{where}: no run listens; start one with: flexmotion dry-run --web")
        return GatewayError(f"{where}: {type(error).__name__}: {error}")


def text_content(text: str, ttl_s: float | None) -> dict[str, Any]:
    """Fields of a `TextMessage`; those that are None are left out when it is sent, as in the next three."""
    return {"type": "text", "text": text, "ttl_s": ttl_s}


def velocity_content(forward: float, left: float, turning: float, ttl_s: float | None) -> dict[str, Any]:
    """Fields of a `VelocityMessage`."""
    return {"type": "velocity", "velocity": [forward, left, turning], "ttl_s": ttl_s}


def heading_content(heading: float, turning: float | None, ttl_s: float | None) -> dict[str, Any]:
    """Fields of a `HeadingMessage`."""
    return {"type": "heading", "heading_rad": heading, "turning_rad_s": turning, "ttl_s": ttl_s}


def waypoint_content(
    x: float, y: float, heading: float | None, tolerance_m: float | None, ttl_s: float | None
) -> dict[str, Any]:
    """Fields of a `WaypointMessage`."""
    place = {"position_m": [x, y], "heading_rad": heading, "tolerance_m": tolerance_m}
    return {"type": "waypoint", **place, "ttl_s": ttl_s}


KILL = {"type": "kill", "confirm": KillMessage.model_fields["confirm"].annotation.__args__[0]}  # type: ignore[union-attr]


def answer_in(frame: str | bytes) -> Answer | None:
    """The answer in a frame; None where it holds something else, such as the status.

    Raises:
        ValueError: it is no JSON object, or no answer.
    """
    content = json.loads(frame)
    if not isinstance(content, dict):
        raise ValueError(f"{frame[:80]!r}: expected a JSON object")
    return Answer.model_validate(content) if content.get("type") == "answer" else None
