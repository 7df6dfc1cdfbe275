"""`Finding`: what `flexmotion doctor` has found out about one thing, and the command that mends it."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

Level = Literal["ok", "warning", "problem"]
"""warning: the robot runs, with a drawback that `found` names; problem: it does not run, or not safely."""


class Finding(BaseModel):
    """One finding.

    Attributes:
        subject: what was looked at.
        level: how it is.
        found: in words.
        mend: command that mends it; None where there is nothing to mend, or no command that does.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    subject: str
    level: Level
    found: str
    mend: str | None = None


def fine(subject: str, found: str) -> Finding:
    """A finding with nothing to mend."""
    return Finding(subject=subject, level="ok", found=found)


def warning(subject: str, found: str, mend: str | None = None) -> Finding:
    """A drawback."""
    return Finding(subject=subject, level="warning", found=found, mend=mend)


def problem(subject: str, found: str, mend: str | None = None) -> Finding:
    """A fault."""
    return Finding(subject=subject, level="problem", found=found, mend=mend)
