"""The one objective of tuning, as a cost: upright first, then way, heading, directions, heat."""

from __future__ import annotations

from collections.abc import Sequence

from flexmotion.streamer.tuning.figures import RunFigures

WAY, HEADING, DIRECTIONS, HEAT = 0.5, 0.25, 0.15, 0.1
"""Weights of the parts of a run that stayed upright; together 1, in their order of importance."""
HEADING_DEG, DIRECTION_DEG = 45.0, 90.0
"""Errors of heading, and of arms and trunk, that cost all of their part [degrees]."""

STATEMENT = (
    "cost = runs that did not stay upright + mean over all runs of "
    f"{WAY:g} |1 - way share| + {HEADING:g} heading / {HEADING_DEG:g} deg + "
    f"{DIRECTIONS:g} mean of arms and trunk / {DIRECTION_DEG:g} deg + {HEAT:g} heat^2, each part within 0 and its "
    "weight; a run that did not stay upright counts there with 1 - lasted / 2. The least cost is best."
)
"""The objective in words, for results."""


def cost_of(runs: Sequence[RunFigures]) -> float:
    """Cost of a robot by its runs on a list [1].

    The mean of the parts is at most 1 and more than 0, so that a robot that stays upright in one run more costs less,
    whatever else it does.
    """
    fallen = sum(not run.upright for run in runs)
    return fallen + sum(_part(run) for run in runs) / len(runs)


def _part(run: RunFigures) -> float:
    """What a run costs beside a fall, in [0, 1]: 0 for a robot that does all of the motion without effort."""
    if not run.upright:
        return 1.0 - 0.5 * run.lasted
    way = 0.0 if run.way_share is None else abs(1.0 - run.way_share)
    heading = 0.0 if run.heading_deg is None else run.heading_deg / HEADING_DEG
    known = [angle for angle in (run.arm_deg, run.trunk_deg) if angle is not None]
    directions = sum(known) / len(known) / DIRECTION_DEG if known else 0.0
    heat = 0.0 if run.heat is None else run.heat**2
    parts = ((WAY, way), (HEADING, heading), (DIRECTIONS, directions), (HEAT, heat))
    return sum(weight * min(part, 1.0) for weight, part in parts)
