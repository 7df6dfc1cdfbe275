"""Waiting for what must happen, however slow the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable

HANGING_S = 240.0
"""Time after which a test that waits says that the program hangs [s]. It bounds no duration of the program."""


def wait_until(happens: Callable[[], object], what: str, *, every_s: float = 0.01) -> None:
    """Come back as soon as `happens()` is true; where it hangs, fail and say what was waited for."""
    end = time.monotonic() + HANGING_S
    while not happens():
        assert time.monotonic() < end, f"waited {HANGING_S:.0f} s for {what}"
        time.sleep(every_s)
