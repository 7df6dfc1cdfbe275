"""Settings of a build."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

from flexmotion.biomechanics.augmentation import Ranges
from flexmotion.biomechanics.ground_reaction import GroundSettings
from flexmotion.biomechanics.plausibility import RESIDUAL_FORCE, RESIDUAL_MOMENT, JointReach
from flexmotion.biomechanics.simulation.perturbation import PerturbationRanges
from flexmotion.biomechanics.smoothing import CUTOFF
from flexmotion.biomechanics.sole import Nearness

REVISION = 3
"""Increased whenever the same settings give other results."""


@dataclass(frozen=True)
class BuildSettings:
    """Everything that a set depends on apart from the clips.

    Attributes:
        fps: frame rate.
        cutoff: of the low-pass filter [Hz].
        mirrored: whether every clip is followed by its mirror image.
        variants: number of augmented copies of every clip.
        perturbed: number of simulated copies of a clip, pushed, loaded, on a slope.
        perturbed_share: share of the clips that have those; simulation is slower than everything else.
        perturbations: ranges of pushes, loads and slopes.
        seed: of the augmentation.
        muscles: whether activations are computed.
        residual_force, residual_moment: greatest values of a `good` frame [body weights, body weights x m].
        reach: limits of the joints in a `good` frame.
        kept_share: least share of good frames of a kept clip.
        shortest: least duration of a kept clip [s].
    """

    fps: float = 30.0
    cutoff: float = CUTOFF
    mirrored: bool = True
    variants: int = 0
    perturbed: int = 0
    perturbed_share: float = 1.0
    seed: int = 0
    muscles: bool = True
    residual_force: float = RESIDUAL_FORCE
    residual_moment: float = RESIDUAL_MOMENT
    kept_share: float = 0.5
    shortest: float = 0.6
    ground: GroundSettings = GroundSettings()
    nearness: Nearness = Nearness()
    ranges: Ranges = Ranges()
    perturbations: PerturbationRanges = PerturbationRanges()
    reach: JointReach = JointReach()

    def fingerprint(self) -> str:
        """Hash of the settings and the revision of the code."""
        text = json.dumps([REVISION, asdict(self)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
