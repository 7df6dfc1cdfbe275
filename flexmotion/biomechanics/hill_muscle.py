"""Force of muscles with a rigid tendon, after Hill.

    force along the tendon = F0 a f_L(l) f_V(v) cos α

with fibre length l in optimal fibre lengths, fibre velocity v in greatest shortening velocities, and pennation α, which
follows from a constant thickness of the muscle. Curves: F. De Groote et al., Ann. Biomed. Eng. 44(10), 2016; `f_L` is
widened to the curve of A. Rajagopal et al., IEEE Trans. Biomed. Eng. 63(10), 2016. Passive forces are left out, as in
OpenSim's static optimisation: on a rigid tendon the published curve compresses the knee by one body weight at the end
of stance, and 19 % of the frames of walking clips were infeasible.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.schema import yaml_content

Float = NDArray[np.float64]

GAUSSIANS = (
    (0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465),
    (0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188),
    (0.1, 1.0, 0.353553390593274, 0.0),
)
"""Coefficients b1 to b4 of the active force-length curve: sum of b1 exp(-½ ((l - b2) / (b3 + b4 l))²)."""

WIDTH = 1.25
"""Stretch of the active force-length curve about 1; with it the curve is that of the 2016 model within .06 from fibre
length .6 to 1.4."""

VELOCITY = (-0.3211346127989808, -8.149, -0.374, 0.8825327733249912)
"""Coefficients d1 to d4 of the force-velocity curve: d1 asinh(d2 v + d3) + d4."""

FASTEST = 10.0
"""Greatest shortening velocity [optimal fibre lengths/s] (2016 model)."""

SHORTEST = 0.001
"""Least length of a fibre along its tendon [m]: a shorter muscle is slack."""


@dataclass(frozen=True, eq=False)
class HillMuscles:
    """Parameters of M muscles, (M,) each.

    Attributes:
        force: greatest isometric force [N].
        fibre: optimal fibre length [m].
        tendon: tendon slack length [m].
        pennation: at optimal fibre length [rad].
    """

    force: Float
    fibre: Float
    tendon: Float
    pennation: Float

    def fibres(self, length: Float) -> tuple[Float, Float]:
        """Fibre length [optimal fibre lengths], and cosine of pennation, at muscle-tendon lengths (..., M) [m]."""
        along = np.maximum(length - self.tendon, SHORTEST)
        fibre = np.hypot(along, self.fibre * np.sin(self.pennation))
        return fibre / self.fibre, along / fibre

    def tension(self, length: Float, velocity: Float) -> Float:
        """Force along the tendon per activation, (..., M) [N].

        Args:
            length: of muscle and tendon, (..., M) [m].
            velocity: its time derivative, positive in lengthening, (..., M) [m/s].
        """
        fibre, cosine = self.fibres(length)
        speed = velocity * cosine / (FASTEST * self.fibre)
        return self.force * cosine * force_length(fibre) * force_velocity(speed)


def force_length(fibre: Float) -> Float:
    """Active force at a fibre length [optimal fibre lengths]; 1 is the greatest."""
    stretched = 1.0 + (fibre - 1.0) / WIDTH
    terms = [b1 * np.exp(-0.5 * ((stretched - b2) / (b3 + b4 * stretched)) ** 2) for b1, b2, b3, b4 in GAUSSIANS]
    return np.sum(terms, axis=0)


def force_velocity(speed: Float) -> Float:
    """Factor of the active force at a fibre velocity [greatest shortening velocities]: 0 at -1, 1 at 0."""
    d1, d2, d3, d4 = VELOCITY
    return np.maximum(d1 * np.arcsinh(d2 * speed + d3) + d4, 0.0)


@lru_cache(maxsize=1)
def _table() -> dict[str, tuple[float, float, float, float]]:
    text = resources.files("flexmotion").joinpath("data", "leg_muscles.yaml").read_text(encoding="utf-8")
    found: dict[str, tuple[float, float, float, float]] = yaml_content(text)
    return found


def leg_muscles(names: tuple[str, ...]) -> HillMuscles:
    """Muscles of a leg by their names without the side, such as `soleus`."""
    return HillMuscles(*np.array([_table()[name] for name in names]).T)
