"""`search_correction`: gains of a push correction, by CMA-ES over pushed walks.

Every generation draws pushes of its own, of all directions at all phases of a step, and tries its candidates on these.
The state is written after every generation, and a search that is started again goes on from there.
"""

from __future__ import annotations

import pickle
import time
from functools import partial
from pathlib import Path

import cma
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.robot.pushes import SIZES, moments, pushed
from benchmarks.shared.branches import in_branch
from flexmotion.configs.push_correction import DIRECTIONS, FILE, Correction, PushCorrectionFile, correction_of
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import load, store
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

SEEDS = (1, 2, 3, 4, 5)
"""Of the walks that are pushed; what is reported has others."""
POPULATION, WALKS, PHASES, PUSHES = 10, 2, 5, 5
"""Candidates of a generation, walks that it pushes, moments of each, and pushes at each moment."""
SIGMA, GAIN, DEAD_M = 0.6, 2.0, 0.003
"""First step of the search, in units of a gain [rad/m] and of a dead band [m]."""
STILL = PushCorrectionFile(dead=(0.02, 0.02), begins=(0.02, 0.03), reach=0.06, most=0.3)
"""From which the search begins for a robot that has no file."""
LANDED = 0.05
"""What a fallen robot is better for each foot that landed before."""
PARTS = {
    "outward": ("hip_roll", "ankle_roll"),
    "inward": ("hip_roll", "ankle_roll"),
    "ahead": ("hip_pitch", "ankle_pitch"),
}
"""Parts of both legs that answer an error in each direction."""


def candidate(robot: Robot, begin: PushCorrectionFile, numbers: Float) -> PushCorrectionFile:
    """The correction of a point of the search: two dead bands, then gains in the order of `PARTS`, left leg first."""
    legs = [robot.chain(f"{side}_leg") for side in ("left", "right")]
    dead = np.clip(np.add(begin.dead, DEAD_M * numbers[:2]), 0.01, begin.begins).tolist()
    content, rest = begin.model_dump() | {"dead": dead}, iter(numbers[2:])
    for direction in DIRECTIONS:
        for joint in (robot.joint_names[leg[part]] for leg in legs for part in PARTS[direction]):
            content[direction][joint] = content[direction].get(joint, 0.0) + GAIN * float(next(rest))
    return PushCorrectionFile.model_validate(content)


def cost(session: Session, correction: Correction, walk: tuple[int, float], push: tuple[float, float]) -> float:
    """What one push costs: 0 upright and inside the envelope, about 1 for a fall, 1 for a goal outside it."""
    assert session.loop is not None
    session.loop.correction.correction = correction
    found = pushed(session, "ahead", *walk, *push)
    return (0.0 if found.upright else 1.0 - LANDED * min(found.landings, 10)) + float(found.violations > 0)


def search_correction(robot: Robot, folder: Path, minutes: float, seed: int) -> Path:
    """Search, and write the mean of the search as `FOLDER/push_correction.yaml`.

    Args:
        robot: its own correction is where the search begins.
        folder: where the search is kept, as `push_correction.state`.
        minutes: how long this call searches.
        seed: of the search and the pushes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    console, state_file = Console(stderr=True, width=160), folder / "push_correction.state"
    own = robot.folder / FILE
    count = 2 + sum(2 * len(parts) for parts in PARTS.values())
    if state_file.is_file():
        search, begin = pickle.loads(state_file.read_bytes())
    else:
        begin = load(PushCorrectionFile, own) if own.is_file() else STILL
        search = cma.CMAEvolutionStrategy(
            np.zeros(count), SIGMA, {"popsize": POPULATION, "seed": seed + 1, "verbose": -9}
        )
    end, sizes = time.monotonic() + 60.0 * minutes, [size for size in SIZES["walking"] if size > min(SIZES["walking"])]
    while time.monotonic() < end:
        generation, asked = search.countiter, search.ask()
        rng = np.random.default_rng([seed, generation])
        tried = [correction_of(robot, candidate(robot, begin, one), str(folder)) for one in asked]
        costs: list[list[float]] = [[] for _ in asked]
        for walk in rng.choice(SEEDS, WALKS, replace=False).tolist():
            for session, phase in moments("ahead", walk, PHASES, robot):
                pushes = [(rng.uniform(0.0, 360.0), float(rng.choice(sizes))) for _ in range(PUSHES)]
                for correction, own_costs in zip(tried, costs, strict=True):
                    work = [partial(cost, session, correction, (walk, phase), push) for push in pushes]
                    own_costs += [in_branch(one) for one in work]
        means = [float(np.mean(one)) for one in costs]
        search.tell(asked, means)
        state_file.write_bytes(pickle.dumps((search, begin)))
        store(candidate(robot, begin, np.asarray(search.mean)), folder / FILE)
        console.print(f"generation {generation}: cost {min(means):.3f}, median {np.median(means):.3f}", soft_wrap=True)
    return folder / FILE
