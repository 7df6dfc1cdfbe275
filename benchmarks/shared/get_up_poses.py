"""Key poses of a get-up file as numbers that may be tuned, and back to a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from flexmotion.configs.get_up import FILE, GetUpStep, least_seconds
from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

KEPT_STEPS = 2
"""Steps at the end of a side that are not tuned: crouch and stand, which are the robot file's own poses."""


class TunedPoses:
    """The numbers of one side: the durations of its steps, and the angles of joints that both sides of the body have.

    Args:
        robot: whose `get_up` is the start.
        side: `front` or `back`.

    Attributes:
        start: the numbers of the file, (k,) [s, rad].
        spread: by how much they are varied at first, (k,).
    """

    def __init__(self, robot: Robot, side: str) -> None:
        self.robot, self._steps = robot, robot.get_up.steps[side]
        tuned = range(len(self._steps) - KEPT_STEPS)
        self._angles = [(k, left, right) for k in tuned for left, right in self._pairs(self._steps[k].q)]
        self._durations = list(tuned)
        self.start = np.array(
            [self._steps[k].seconds for k in self._durations] + [self._steps[k].q[left] for k, left, _ in self._angles]
        )
        self.spread = np.array([0.1] * len(self._durations) + [0.06] * len(self._angles))

    def steps(self, numbers: Float) -> tuple[GetUpStep, ...]:
        """The steps for numbers, (k,), brought inside joint limits and the servos' speed."""
        robot, poses = self.robot, [step.q.copy() for step in self._steps]
        for (k, left, right), angle in zip(self._angles, numbers[len(self._durations) :], strict=True):
            mirrored = np.sign(self._steps[k].q[right] * self._steps[k].q[left])
            poses[k][left], poses[k][right] = angle, mirrored * angle
        poses = [np.clip(q, robot.lower, robot.upper) for q in poses]
        seconds = [step.seconds for step in self._steps]
        for k, value in zip(self._durations, numbers, strict=False):
            seconds[k] = max(float(value), 0.1)
        for k in range(1, len(poses)):
            seconds[k] = max(seconds[k], 1.001 * least_seconds(robot, poses[k - 1], poses[k]))
        return tuple(
            replace(step, q=q, seconds=taken) for step, q, taken in zip(self._steps, poses, seconds, strict=True)
        )

    def _pairs(self, q: Float) -> list[tuple[int, int]]:
        """Indices of left and right joints that a pose turns alike."""
        chains = dict(self.robot.mapping.chains())
        found = []
        for limb in ("arm", "leg"):
            if f"left_{limb}" not in chains or f"right_{limb}" not in chains:
                continue
            left, right = self.robot.chain(f"left_{limb}"), self.robot.chain(f"right_{limb}")
            found += [(left[part], right[part]) for part in left if part in right]
        return [(a, b) for a, b in found if q[a] != 0.0 and abs(abs(q[a]) - abs(q[b])) < 1e-6]


def write_get_up(robot: Robot, get_up: Mapping[str, tuple[GetUpStep, ...]], file: Path) -> None:
    """Write steps as a get-up file, one a side; its comments are those of whoever keeps it."""
    content = {side: [_content(robot, step) for step in steps] for side, steps in get_up.items()}
    text = yaml.safe_dump({"version": 1, **content}, sort_keys=False, allow_unicode=True, width=112)
    file.write_text(f"# {FILE} of {robot.name}, tuned by `python -m benchmarks robot/get_up --tune`.\n{text}", "utf-8")


def _content(robot: Robot, step: GetUpStep) -> dict[str, object]:
    turned: Sequence[tuple[str, float]] = [
        (name, round(float(angle), 3)) for name, angle in zip(robot.joint_names, step.q, strict=True) if angle
    ]
    return {
        "name": step.name,
        "seconds": round(step.seconds + 5e-4, 3),
        "hold_s": step.hold_s,
        "pitch": list(step.pitch),
        "wait_s": step.wait_s,
        "pose": dict(turned),
    }
