"""`Perturbation`: a push, a carried load and a slope, drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

LOADED_SEGMENTS = ("torso", "hand_l", "hand_r")
"""Segments of external loads, in the order of a set's field `loads`."""


@dataclass(frozen=True)
class PerturbationRanges:
    """Ranges from which perturbations are drawn uniformly.

    Attributes:
        push: least and greatest peak force on the torso [body weights]; none if both are 0.
        push_s: duration of a push [s].
        carried: greatest mass in both hands or on the trunk, as a share of body mass.
        carrying: share of the variants that carry one.
        slope: greatest angle of the floor [rad].
        sloping: share of the variants on a slope.
        settle_s: least time before a push, and from its end to the end of the variant [s].
        longest_s: longest variant [s].
    """

    push: tuple[float, float] = (0.02, 0.12)
    push_s: tuple[float, float] = (0.1, 0.3)
    carried: float = 0.1
    carrying: float = 0.5
    slope: float = float(np.radians(5))
    sloping: float = 0.25
    settle_s: float = 0.5
    longest_s: float = 6.0


PERTURBATIONS = PerturbationRanges()


@dataclass(frozen=True)
class Perturbation:
    """Push, carried load and slope of a variant.

    Attributes:
        push: peak force on the torso, horizontal, half a sine wave [body weights].
        direction: of the push in the world, from x to y [rad].
        start_s, duration_s: of the push [s].
        carried: mass [kg] by segment, one of `LOADED_SEGMENTS`.
        slope: rise of the floor along x and y, (2,) [m/m].
    """

    push: float = 0.0
    direction: float = 0.0
    start_s: float = 0.0
    duration_s: float = 0.0
    carried: tuple[tuple[str, float], ...] = ()
    slope: tuple[float, float] = (0.0, 0.0)

    @property
    def end_s(self) -> float:
        """End of the push [s]."""
        return self.start_s + self.duration_s

    @property
    def masses(self) -> Mapping[str, float]:
        """Carried mass by segment [kg]."""
        return dict(self.carried)

    def push_force(self, time: Float, mass: float) -> Float:
        """Force on the torso at times (N,) [s] on a human of a mass [kg], (N, 3) [N]."""
        if not self.duration_s:
            return np.zeros((len(time), 3))
        phase = np.clip((time - self.start_s) / self.duration_s, 0.0, 1.0)
        size = self.push * mass * GRAVITY * np.sin(np.pi * phase)
        return size[:, None] * np.array([np.cos(self.direction), np.sin(self.direction), 0.0])

    def description(self) -> dict[str, Any]:
        """For the entry of a set's manifest."""
        return {
            "push": {
                "peak_bw": round(self.push, 4),
                "direction_rad": round(self.direction, 4),
                "start_s": round(self.start_s, 4),
                "duration_s": round(self.duration_s, 4),
            },
            "carried_kg": {name: round(mass, 3) for name, mass in self.carried},
            "slope": [round(value, 5) for value in self.slope],
        }


def drawn(
    duration: float, mass: float, generator: np.random.Generator, ranges: PerturbationRanges = PERTURBATIONS
) -> Perturbation:
    """A perturbation for a motion of a duration [s] and a human of a mass [kg].

    Too short a motion for a push with `settle_s` before and after it has none.
    """
    peak, direction = generator.uniform(*ranges.push), generator.uniform(-np.pi, np.pi)
    lasts = generator.uniform(*ranges.push_s)
    latest = min(duration, ranges.longest_s) - lasts - ranges.settle_s
    start = generator.uniform(ranges.settle_s, max(latest, ranges.settle_s))
    share, on_trunk = ranges.carried * generator.random() * mass, generator.random() < 0.5
    carries, slopes = generator.random() < ranges.carrying, generator.random() < ranges.sloping
    uphill, rise = generator.uniform(-np.pi, np.pi), np.tan(ranges.slope * generator.random())
    carried = (("torso", share),) if on_trunk else (("hand_l", share / 2), ("hand_r", share / 2))
    pushed = latest >= ranges.settle_s and peak > 0
    return Perturbation(
        push=peak if pushed else 0.0,
        direction=direction,
        start_s=start if pushed else 0.0,
        duration_s=lasts if pushed else 0.0,
        carried=carried if carries and share > 0 else (),
        slope=(rise * np.cos(uphill), rise * np.sin(uphill)) if slopes else (0.0, 0.0),
    )
