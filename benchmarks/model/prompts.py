"""Does the model do what it is told? Prompts in unseen wordings, judged by geometry; a table by kind.

    python benchmarks/prompts.py BUNDLE [--samples 20] [--seconds 4] [--steps N] [--csv FILE]

Exits with 1 below 90 % overall or 70 % of a kind.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from model_rollout import always, roll_out
from reversals import reversals

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.spatial.heading import continuous_matrix_heading

OVERALL, EACH = 0.9, 0.7
SIDES = {"left": (0,), "right": (1,), "both": (0, 1)}

SWINGS = 2
"""Turns of a waving hand that make it a wave."""

REACH = 0.05
"""A hand swings if it moves by at least so much between its turns [m]."""


def speed(motion: Motion, human: HumanKinematics) -> tuple[float, float]:
    """Mean speed along and across the heading [m/s]."""
    yaw = continuous_matrix_heading(human.pelvis_rotation)[:-1]
    step = np.diff(motion.root_position[:, :2], axis=0) * motion.fps
    along = np.cos(yaw) * step[:, 0] + np.sin(yaw) * step[:, 1]
    across = np.cos(yaw) * step[:, 1] - np.sin(yaw) * step[:, 0]
    return float(along.mean()), float(across.mean())


def at_least(value: float, wanted: float) -> bool:
    """Whether a value reaches one, in its direction."""
    return value >= wanted if wanted >= 0 else value <= wanted


def walks(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    return at_least(speed(motion, human)[0], wanted)


def sideways(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    return at_least(speed(motion, human)[1], wanted)


def turns(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    yaw = continuous_matrix_heading(human.pelvis_rotation)
    return at_least(float(np.degrees(yaw[-1] - yaw[0])), wanted)


def stays(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    return bool(np.linalg.norm(motion.root_position[-1, :2] - motion.root_position[0, :2]) <= wanted)


def leans(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    return bool(np.degrees(np.arccos(np.clip(human.torso_rotation[:, 2, 2], -1, 1))).max() >= wanted)


def rises(motion: Motion, human: HumanKinematics, wanted: str) -> bool:
    return all((human.wrist[:, side, 2] > human.shoulder[:, side, 2]).any() for side in SIDES[wanted])


def swings(motion: Motion, human: HumanKinematics, wanted: str) -> bool:
    """Whether hands turn to and fro, seen from the torso, while they are up."""
    for side in SIDES[wanted]:
        up = human.wrist[:, side, 2] > human.shoulder[:, side, 2] - 0.1
        offset = human.hand[:, side] - human.shoulder[:, side]
        local = np.einsum("tji,tj->ti", human.torso_rotation, offset)[up]
        if len(local) < 5 or max(reversals(axis, REACH) for axis in local.T) < SWINGS:
            return False
    return True


CHECKS: dict[str, Callable[[Motion, HumanKinematics, Any], bool]] = {
    "walks": walks,
    "sideways": sideways,
    "turns": turns,
    "stays": stays,
    "leans": leans,
    "rises": rises,
    "swings": swings,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--samples", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    sampler = Sampler(Bundle(arguments.bundle), arguments.steps)
    table = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
    rows = []
    print(f"{'kind':16} {'share':>6}   heard as")
    for entry in table:
        passed, heard = [], []
        for wording in entry["wordings"]:
            heard.append(sampler.prompt(wording).kind)
            for seed in range(arguments.samples):
                motion = roll_out(sampler, always(wording), arguments.seconds, seed).motion
                human = forward(motion)
                passed.append(all(CHECKS[name](motion, human, wanted) for name, wanted in entry["check"].items()))
        rows.append((entry["kind"], float(np.mean(passed))))
        print(f"{entry['kind']:16} {100 * rows[-1][1]:5.0f} %   {', '.join(heard)}", flush=True)
    overall = float(np.mean([share for _, share in rows]))
    print(f"{'overall':16} {100 * overall:5.0f} %")
    if arguments.csv:
        with arguments.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([("kind", "share"), *rows, ("overall", overall)])
    return 0 if overall >= OVERALL and min(share for _, share in rows) >= EACH else 1


if __name__ == "__main__":
    sys.exit(main())
