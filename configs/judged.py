"""`Judged`: what a judge found of a kind of motion, or of a manner; kept by bundles and by robots."""

from __future__ import annotations

from pydantic import Field

from flexmotion.configs.schema import Strict


class Judged(Strict):
    """Result of a judge: how many samples of a kind of motion, or of a manner, it found to be what was asked.

    Attributes:
        judge: its name.
        samples: that it judged.
        share: of them that are what was asked, in [0, 1].
        least: share from which on it passes.
    """

    judge: str
    samples: int = Field(gt=0)
    share: float = Field(ge=0, le=1)
    least: float = Field(ge=0, le=1)

    @property
    def passed(self) -> bool:
        """Whether a bundle, or a robot, may offer it."""
        return self.share >= self.least
