"""`tune`: key poses and durations of one side that get perturbed robots up with the least effort, by CMA-ES.

Every candidate is tried on the same fallen robots, each in a copy of this process, so that none has to fall again. The
state is written after every generation: a run that is started again goes on from there.
"""

from __future__ import annotations

import pickle
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import cma
import numpy as np
from rich.console import Console

from benchmarks.shared.branches import copied_memory, in_branch
from benchmarks.shared.fallen import Fallen, GotUp
from benchmarks.shared.get_up_poses import TunedPoses
from flexmotion.configs.get_up import GetUpStep
from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.retargeter import Retargeter

POPULATION, STARTS = 10, 3
FELL, OUTSIDE, PER_SECOND, PER_RMS = 10.0, 1.0, 0.02, 2.0
"""Cost of a robot that does not stand, of a goal outside the envelope, of a second, and of the greatest RMS torque of a
servo over its usable torque; its greatest torque over that costs 1."""


def fallen_robots(robot: Robot, side: str, count: int, seed: int) -> list[Fallen]:
    """Robots that lie on a side, of seeds from `seed` on."""
    retargeter, found = Retargeter(robot, load_stream()), list[Fallen]()
    for number in range(seed, seed + 20 * count):
        with copied_memory():
            one = Fallen(robot, retargeter, side, number)
        one.fall()
        if one.lies_on == side:
            found.append(one)
        if len(found) == count:
            break
    return found


def cost_of(got_up: GotUp) -> float:
    """Cost of one attempt."""
    effort = got_up.peak_share + PER_RMS * got_up.rms_share + PER_SECOND * got_up.seconds
    return FELL * (not got_up.stood) + OUTSIDE * got_up.violations + effort


def attempt(one: Fallen, steps: tuple[GetUpStep, ...]) -> GotUp:
    """Let a fallen robot get up by given steps."""
    robot = one.robot
    robot.get_up = replace(robot.get_up, steps={**robot.get_up.steps, str(one.lies_on): steps})
    return one.get_up()


def tune(robot: Robot, side: str, seed: int, minutes: float, state_file: Path) -> tuple[GetUpStep, ...]:
    """The best steps found so far; they are those of the file where nothing better is found.

    Args:
        seed: of the first start; it is also that of the search.
        minutes: how long this call searches.
        state_file: where the search is kept.
    """
    poses, console = TunedPoses(robot, side), Console(stderr=True)
    starts = fallen_robots(robot, side, STARTS, seed)

    def cost(numbers: np.ndarray) -> float:
        steps = poses.steps(poses.start + poses.spread * numbers)
        return float(np.mean([cost_of(in_branch(partial(attempt, one, steps))) for one in starts]))

    if state_file.is_file():
        search, best, least = pickle.loads(state_file.read_bytes())
    else:
        options = {"popsize": POPULATION, "seed": seed + 1, "verbose": -9}
        search = cma.CMAEvolutionStrategy(np.zeros(len(poses.start)), 0.5, options)
        best = np.zeros(len(poses.start))
        least = cost(best)
        console.print(f"{side}: the file costs {least:.3f}")
    end = time.monotonic() + 60.0 * minutes
    while time.monotonic() < end:
        asked = search.ask()
        costs = [cost(one) for one in asked]
        search.tell(asked, costs)
        if min(costs) < least:
            best, least = asked[int(np.argmin(costs))], min(costs)
        state_file.write_bytes(pickle.dumps((search, best, least)))
        console.print(f"{side}: generation {search.countiter}: {min(costs):.3f}, best {least:.3f}")
    return poses.steps(poses.start + poses.spread * best)
