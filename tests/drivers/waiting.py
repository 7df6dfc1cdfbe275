"""Waiting for states on the wall clock: the only bound is one against hanging."""

from __future__ import annotations

import time
from collections.abc import Callable

HANGS_S = 90.0
"""A state that has not come after this never comes, however slow the machine is [s]."""


def wait_until(reached: Callable[[], object], what: str, *, every_s: float = 0.004) -> None:
    """Return once `reached()` is true; fail with `what` if it never is."""
    hangs = time.monotonic() + HANGS_S
    while not reached():
        assert time.monotonic() < hangs, f"never happened: {what}"
        time.sleep(every_s)
