"""`search_gait`: numbers of a gait that goes ahead fast and upright, by CMA-ES over whole runs.

The speed that is asked for rises as soon as the best candidates keep it. Candidates of a generation are tried on the
same robots, nominal and drawn; the state is written after every generation, and a search that is started again goes on
from there.
"""

from __future__ import annotations

import pickle
import time
from pathlib import Path

import cma
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.robot.learned.gait import NAMES, Gait, GaitTable
from benchmarks.robot.learned.randomised import drawn_options
from benchmarks.robot.learned.walk import ACTIONS, Walk
from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.options import SimOptions

Float = NDArray[np.float64]

POPULATION, SECONDS = 16, 5.0
FIRST_SPEED, FASTER = 0.18, 0.015
"""Speed that is asked for at first, and by how much it rises [m/s]."""
KEPT = 0.9
"""Share of the asked speed that the best candidate must keep before it rises."""


def trial(walk: Walk, options: SimOptions, speed: float, right_first: bool) -> tuple[float, float]:
    """Mean reward over the whole time asked for, a fallen robot's being 0 from then on, and the speed [m/s]."""
    walk.begin(options, speed, right_first=right_first)
    reward, still, begin = 0.0, np.zeros(ACTIONS), walk.ground.position[0]
    while walk.time < SECONDS and not walk.fell:
        reward += walk.step(still)
    went = float(walk.ground.position[0] - begin) / (SECONDS - 0.75)
    return reward / (SECONDS * walk.robot.rate_hz / 2), went


def search_gait(robot: Robot, folder: Path, minutes: float, seed: int) -> Gait:
    """The best gait found so far.

    Args:
        robot: that is to walk.
        folder: where the search is kept, as `gait.state`.
        minutes: how long this call searches.
        seed: of the search and the robots.
    """
    console, state_file = Console(stderr=True, width=160), folder / "gait.state"
    if state_file.is_file():
        search, speed, best = pickle.loads(state_file.read_bytes())
    else:
        options = {"popsize": POPULATION, "seed": seed + 1, "verbose": -9}
        search, speed, best = cma.CMAEvolutionStrategy(np.zeros(len(NAMES)), 0.6, options), FIRST_SPEED, None
    end = time.monotonic() + 60.0 * minutes
    while time.monotonic() < end:
        generation = search.countiter
        asked, found = search.ask(), []
        for numbers in asked:
            walk = Walk(robot, GaitTable(robot, Gait.of(numbers)))
            robots = np.random.default_rng([seed, generation])
            one = trial(walk, SimOptions(seed=int(robots.integers(1000))), speed, bool(generation % 2))
            two = trial(walk, drawn_options(robots), speed, not generation % 2) if one[0] > 0.2 else (one[0] - 0.1, 0.0)
            penalty = 0.002 * float(np.square(numbers).mean())
            found.append((-0.5 * (one[0] + two[0]) + penalty, min(one[1], two[1]), one[1]))
        costs = [one[0] for one in found]
        search.tell(asked, costs)
        first = int(np.argmin(costs))
        best = search.result.xfavorite
        keeps = sorted(own[1] for own in found)[-4]
        if keeps > KEPT * speed:
            speed += FASTER
        state_file.write_bytes(pickle.dumps((search, speed, best)))
        console.print(
            f"generation {generation}: reward {-costs[first]:.3f}, median {-np.median(costs):.3f}, "
            f"best goes {found[first][2]:.3f} m/s, fourth of both robots {keeps:.3f}; asked next {speed:.2f}",
            soft_wrap=True,
        )
    return Gait.of(np.asarray(best))
