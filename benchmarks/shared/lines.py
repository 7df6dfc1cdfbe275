"""`Lines`: the other end of a run's standard input and output."""

from __future__ import annotations

import json
import threading
import time
from typing import IO, Any

from flexmotion.configs.errors import GatewayError
from flexmotion.streamer.gateway.connection import PATIENCE_S


class Lines:
    """Messages and answers, a JSON object a line.

    Attributes:
        rest: lines that were no answers: a run's report, at its end.
    """

    def __init__(self, to_run: IO[bytes], from_run: IO[bytes]) -> None:
        self._to_run, self._from_run = to_run, from_run
        self._answers: dict[str, str] = {}
        self._arrived = threading.Condition()
        self._number = 0
        self.rest: list[str] = []
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self) -> None:
        for line in self._from_run:
            if not line.startswith(b'{"type":"answer"'):
                self.rest.append(line.decode())
                continue
            answer = json.loads(line)
            with self._arrived:
                self._answers[str(answer.get("id"))] = answer["state"]
                self._arrived.notify_all()

    def ask(self, message: dict[str, Any]) -> str:
        """Send a message and wait for the state of its answer. Raises `GatewayError` where none comes."""
        self._number += 1
        identity = f"line {self._number}"
        try:
            self._to_run.write(json.dumps({**message, "id": identity}).encode() + b"\n")
            self._to_run.flush()
        except OSError as error:
            raise GatewayError(f"standard input: {error}") from error
        end = time.monotonic() + PATIENCE_S
        with self._arrived:
            while identity not in self._answers:
                if not self._arrived.wait(max(end - time.monotonic(), 0.0)) and time.monotonic() >= end:
                    raise GatewayError("standard input: no answer")
            return self._answers.pop(identity)

    def end(self) -> None:
        """Wait until the run has closed its output."""
        self._reading.join(PATIENCE_S)
