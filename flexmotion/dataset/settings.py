"""How a set is built."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

from flexmotion.biomechanics.augmentation import Ranges
from flexmotion.biomechanics.ground_reaction import GroundSettings
from flexmotion.biomechanics.plausibility import JointReach
from flexmotion.biomechanics.smoothing import CUTOFF
from flexmotion.biomechanics.sole import Nearness

REVISION = 2
"""Raised whenever the same settings give other numbers."""


@dataclass(frozen=True)
class BuildSettings:
    """Everything that the numbers of a set depend on but the clips.

    Attributes:
        fps: frame rate.
        mass: of humans of whom no file tells it, for a stature of 1.75 m; else in proportion to the square [kg].
        cutoff: of the low-pass filter [Hz].
        mirrored: whether every clip comes with its mirror image.
        variants: how many varied copies of every clip there are.
        seed: of their variety.
        muscles: whether activations are computed.
        residual_force, residual_moment: a frame with more is not `good` [body weights, body weights x m].
        reach: neither is one with joints beyond this.
        kept_share: a clip with fewer good frames is dropped.
        shortest: a clip of less is dropped [s].
    """

    fps: float = 30.0
    mass: float = 70.0
    cutoff: float = CUTOFF
    mirrored: bool = True
    variants: int = 0
    seed: int = 0
    muscles: bool = True
    residual_force: float = 0.1
    residual_moment: float = 0.1
    kept_share: float = 0.5
    shortest: float = 0.6
    ground: GroundSettings = GroundSettings()
    nearness: Nearness = Nearness()
    ranges: Ranges = Ranges()
    reach: JointReach = JointReach()

    def fingerprint(self) -> str:
        """A hash of the settings and the revision of the code."""
        text = json.dumps([REVISION, asdict(self)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
