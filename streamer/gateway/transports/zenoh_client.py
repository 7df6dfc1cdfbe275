"""`ZenohClient`: another program's side of a run that was started with `--zenoh` or `--zenoh-router`.

```python
import flexmotion as fm

with fm.ZenohClient("tcp/192.168.0.10:7447", robot="op3_a", source="alice") as robot:
    print(robot.text("wave with the right hand"))
```
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from flexmotion.configs.errors import ConfigError, GatewayError
from flexmotion.configs.stream import Gateway
from flexmotion.streamer.gateway.client import Client
from flexmotion.streamer.gateway.connection import PATIENCE_S, StopAnswer, answer_in, awaited, patience_of
from flexmotion.streamer.gateway.messages import Answer, Ended
from flexmotion.streamer.gateway.proofs import Prover
from flexmotion.streamer.gateway.transports.extras import need
from flexmotion.streamer.gateway.transports.zenoh_link import robot_key
from flexmotion.streamer.gateway.transports.zenoh_session import configuration, plain

if TYPE_CHECKING:
    import zenoh

_OPEN_MS = 5000
_LOOK_S = 0.1
"""Time between two looks whether the run is there [s]."""
_KEY_WORD = re.compile(r"^[^/*?#$]+$")


class ZenohClient(Client):
    """`Client` over zenoh. With a token each message proves it (`flexmotion.streamer.gateway.proofs`).

    Args:
        endpoints: of a router, of the gateway, or of gateway and stop process: then stops need no gateway.
        robot: name of the robot, a part of each key.
        source: name of the operator, the last part of a target's key.
        token: of the run; None: the environment variable FLEXMOTION_TOKEN, if it is set.

    Raises:
        ConfigError: zenoh is not installed, or a name cannot be a part of a key.
        GatewayError: nobody is at the endpoints, the robot is not seen there, or it does not answer in time.
        MessageError: a message is not valid.
    """

    _zenoh: zenoh.Session | None = None

    def __init__(
        self,
        *endpoints: str,
        robot: str = "op3",
        source: str = "client",
        token: str | None = None,
    ) -> None:
        super().__init__(source=source, token=token)
        need("zenoh", "zenoh", "zenoh")
        for field, name in (("robot", robot), ("source", source)):
            if not _KEY_WORD.match(name):
                raise ConfigError(f"{field}: {name!r}: expected a part of a key, without / * ? # $")
        self.endpoints = endpoints or (f"tcp/127.0.0.1:{Gateway().zenoh_port}",)
        self.robot, self._prover = robot, None if self.token is None else Prover(self.token)
        self._seen: set[str] = set()

    def close(self) -> None:
        """See `Client.close`."""
        if self._zenoh is not None:
            self._zenoh.close()
            self._zenoh = None
            self._seen.clear()

    def status(self) -> dict[str, Any]:
        """The run now: `flexmotion.streamer.gateway.status.Status` as JSON."""
        return self._get("gateway", "status", b"")

    def ask(self, message: Mapping[str, Any]) -> Answer:
        """See `Client.ask`."""
        _, text = self.message(message)
        content = self._get("gateway", f"targets/{self.source}", text.encode(), patience_of(message))
        answer = answer_in(json.dumps(content))
        if not isinstance(answer, Answer):
            raise GatewayError(f"{self._where}: the run sent what is no answer: {content}")
        return answer

    def wait(self, answer: Answer, *, patience_s: float | None = None) -> Ended:
        """Raises `GatewayError`: the end of a target is told over WebSocket alone; `status` has it."""
        awaited(answer)
        raise GatewayError(f"{self._where}: the end of a target is not told over zenoh: see status()['following']")

    @property
    def _where(self) -> str:
        return ", ".join(self.endpoints)

    def _connect(self) -> None:
        if self._zenoh is not None:
            return
        import zenoh

        values = {
            # A client is told by whom it is connected to; a peer speaks to each.
            "mode": "client" if len(self.endpoints) == 1 else "peer",
            "connect/endpoints": list(self.endpoints),
            "connect/timeout_ms": _OPEN_MS,
            "connect/exit_on_failure": True,
            "listen/endpoints": [],
        }
        try:
            self._zenoh = zenoh.open(configuration(values))
        except zenoh.ZError as error:
            raise GatewayError(f"{self._where}: cannot be reached: {plain(error)}") from error

    def press(self, what: str) -> StopAnswer:
        """See `Messages.press`."""
        return StopAnswer.model_validate(self._get("stops", what, b""))

    def _get(self, process: str, word: str, data: bytes, patience_s: float = PATIENCE_S) -> dict[str, Any]:
        """Ask one of the run's processes; returns its reply."""
        self._connect()
        assert self._zenoh is not None
        self._await(process)
        key = robot_key(self.robot, word)
        proof = None if self._prover is None else self._prover.prove(key, data)
        for reply in self._zenoh.get(key, payload=data, attachment=proof, timeout=patience_s):
            if reply.ok is not None:
                content = json.loads(reply.ok.payload.to_bytes())
                if content.get("state") == "refused" and word == "status":
                    reason = self.needs_token if self.token is None else content.get("reason")
                    raise GatewayError(f"{self._where}: refused: {reason}")
                return dict(content)
        raise GatewayError(f"{self._where}: no answer on {key} within {patience_s:g} s")

    def _await(self, process: str) -> None:
        """Wait until one of the run's processes is seen: its keys are known a moment after the connection."""
        assert self._zenoh is not None
        key, end = robot_key(self.robot, "alive", process), time.monotonic() + PATIENCE_S
        while process not in self._seen:
            if any(reply.ok is not None for reply in self._zenoh.liveliness().get(key, timeout=1.0)):
                self._seen.add(process)
            elif time.monotonic() > end:
                raise GatewayError(f"{self._where}: no run of the robot {self.robot!r} is seen there")
            else:
                time.sleep(_LOOK_S)
