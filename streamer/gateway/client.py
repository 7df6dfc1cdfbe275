"""`Client`: another program's side of a run that was started with `--web`.

```python
import flexmotion as fm

with fm.Client() as robot:
    print(robot.text("wave with the right hand"))
    robot.velocity(0.3, 0.0, 0.0, ttl_s=4.0)
    print(robot.status()["state"])
```
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.gateway.connection import (
    Ends,
    Messages,
    StopAnswer,
    answer_in,
    awaited,
    patience_of,
)
from flexmotion.streamer.gateway.message_methods import MessageMethods
from flexmotion.streamer.gateway.messages import Answer, Ended


class Client(Messages, MessageMethods[Answer]):
    """A connection to a run, for a program that waits for each answer; see `AsyncClient` for one that does not.

    Raises:
        GatewayError: no run listens, it refuses the connection, or it does not answer in time.
        MessageError: a message is not valid.
    """

    _socket: Any = None
    _open: ExitStack

    def __enter__(self) -> Self:
        self._connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; what the robot follows stays as it is until its time is over."""
        if self._socket is not None:
            self._socket = None
            self._open.close()

    def stop(self) -> StopAnswer:
        """Come to a stand and stay, by the stop process; needs no token."""
        return self.press("stop")

    def estop(self) -> StopAnswer:
        """Stop as the robot file says, then park, by the stop process."""
        return self.press("estop")

    def status(self) -> dict[str, Any]:
        """The run now: `flexmotion.streamer.gateway.status.Status` as JSON."""
        return self.fetch("GET", self.port, "/status")

    def ask(self, message: Mapping[str, Any]) -> Answer:
        """See `MessageMethods.ask`."""
        identity, text = self.message(message)
        self._connect()
        try:
            self._socket.send(text)
            while True:
                answer = answer_in(self._socket.recv(patience_of(message)))
                if isinstance(answer, Ended):
                    self._ended.add(answer)
                elif answer is not None and answer.id == identity:
                    self._ended.take(answer)
                    return answer
        except (OSError, WebSocketException, ValueError) as error:
            self.close()
            raise self.failed(error) from error

    def wait(self, answer: Answer, *, patience_s: float | None = None) -> Ended:
        """Wait for the end of a target; that of a hand, an arm, the head or a foot is that it is there.

        Args:
            answer: to it, on this connection.
            patience_s: greatest time [s]; None: as long as it takes. Words without an amount end with the next target.

        Raises:
            GatewayError: the target is not followed, or lets something go; its end did not come in time; the connection
                was closed.
        """
        target = awaited(answer)
        due_s = None if patience_s is None else time.monotonic() + patience_s
        try:
            while (ended := self._ended.of(target)) is None:
                left_s = None if due_s is None else max(due_s - time.monotonic(), 0.0)
                if self._socket is None:
                    raise ConnectionResetError("the connection on which it was asked for is closed")
                found = answer_in(self._socket.recv(left_s))
                if isinstance(found, Ended):
                    self._ended.add(found)
        except TimeoutError as error:
            if patience_s is None:  # of the connection itself
                raise self.failed(error) from error
            raise GatewayError(f"target {target} has not ended within {patience_s:g} s") from None
        except (OSError, WebSocketException, ValueError) as error:
            self.close()
            raise self.failed(error) from error
        return ended

    def _connect(self) -> None:
        if self._socket is not None:
            return
        self._ended = Ends()
        self._open = ExitStack()
        try:
            self._socket = self._open.enter_context(connect(self.url, **self.options))
        except (OSError, WebSocketException) as error:
            raise self.failed(error) from error
        self.learn_stop_port()
