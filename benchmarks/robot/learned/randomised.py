"""Robots that are drawn at random for training: mass, gains, delay, friction, slope, supply and pushes.

Within the perturbations of the robustness tests (`flexmotion.drivers.sim.options.PERTURBED`) and of the get-up
benchmark, which are what the evaluation asks for.
"""

from __future__ import annotations

import numpy as np

from benchmarks.shared.fallen import DRY, FRICTION, MASS_KG, STIFF, VOLTS
from flexmotion.drivers.sim.options import PERTURBED, RandomPushes, SimOptions

NOMINAL_SHARE = 0.25
"""Share of episodes with the robot as its file describes it."""


def drawn_options(rng: np.random.Generator) -> SimOptions:
    """Options of the simulation of one episode."""
    seed = int(rng.integers(2**31))
    if rng.random() < NOMINAL_SHARE:
        return SimOptions(seed=seed)
    slope, pushes = float(np.abs(PERTURBED.slope_deg).max()), PERTURBED.random_pushes
    assert pushes is not None
    return SimOptions(
        seed=seed,
        total_mass=rng.uniform(*MASS_KG),
        kp_scale=rng.uniform(PERTURBED.kp_scale, STIFF),
        extra_latency_s=rng.uniform(0.0, PERTURBED.extra_latency_s),
        friction=rng.uniform(PERTURBED.friction or FRICTION, FRICTION),
        joint_friction_scale=rng.uniform(*DRY),
        voltage=rng.uniform(*VOLTS),
        slope_deg=tuple(rng.uniform(-slope, slope, 2)),
        random_pushes=RandomPushes(every_s=pushes.every_s, impulse=pushes.impulse * rng.uniform(0.3, 1.0)),
    )
