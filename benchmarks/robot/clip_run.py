"""The report of one clip as the benchmarks read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

NET_PATH, STEPS = 0.4, 0.8
"""Shares of the human's scaled path and of its steps that the robot must reach to have walked."""


@dataclass(frozen=True)
class ClipRun:
    """A clip and the report (JSON) of its run."""

    kind: str
    clip: str
    perturbed: bool
    report: dict[str, Any]

    @property
    def motion(self) -> dict[str, Any]:
        """The report's motion figures."""
        figures: dict[str, Any] = self.report["motion"]
        return figures

    @property
    def upright(self) -> bool:
        """Whether the robot did not fall."""
        return not self.motion["fell"]

    @property
    def steps(self) -> int:
        """Planned steps without the inserted ones."""
        return int(self.motion["steps_planned"] - self.motion["steps_inserted"])

    @property
    def walked(self) -> bool:
        """Upright, with enough of the human's path and steps."""
        ratio = self.motion["net_path_ratio"]
        enough = self.steps >= STEPS * self.motion["human_steps"]
        return self.upright and (ratio is None or ratio >= NET_PATH) and enough

    @property
    def knee(self) -> float:
        """RMS torque of the more heavily loaded knee over its stall torque."""
        joints = self.report["limits"]["joints"]
        return max(load["rms_share_of_stall"] or 0.0 for name, load in joints.items() if "knee" in name)
