"""`draw_constraints`: what is asked of training windows, drawn as benchmarks and users ask.

Values are those of the window itself, so that what is asked can be done after the window's history.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.constraint_layout import (
    CENTRES,
    FORCES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
)
from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE
from flexmotion.features.layout import ACTIVATIONS, POINTS
from flexmotion.human.skeleton import JOINTS

Float = NDArray[np.float32]
Mask = NDArray[np.bool_]
Draw = Callable[[np.random.Generator, ConstraintLayout, Mask], None]

ESTIMATED = (TORQUES, TORQUE_LIMITS, FORCES, CENTRES, ACTIVATIONS)
"""Blocks whose values are asked only where they are known well."""

MOST_KEYFRAMES = 4

FEW, MANY = 1, 20
"""Numbers of joints and muscles of the paper's table of conditions."""

SPARSE, DENSE = 0.01, 0.2
"""Shares of frames of which everything is asked, likewise."""

LIMITS = (0.8, 1.2)
"""A limit is the largest torque of its joint within the window, times a number in this range."""


def _rows(rng: np.random.Generator, mask: Mask) -> NDArray[np.intp]:
    """All frames, or a few."""
    frames = len(mask)
    if rng.random() < 0.5:
        return np.arange(frames)
    return rng.choice(frames, rng.integers(1, min(MOST_KEYFRAMES, frames) + 1), replace=False)


def _chosen(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask, block: str, size: int, count: int) -> None:
    """Ask for `count` groups of `size` columns of a block."""
    groups = (layout.blocks[block].stop - layout.blocks[block].start) // size
    rows = _rows(rng, mask)
    for group in rng.choice(groups, min(count, groups), replace=False):
        first = layout.blocks[block].start + size * int(group)
        mask[rows, first : first + size] = True


def _place(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    _chosen(rng, layout, mask, PLACES, 3, 1)


def _hand(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    point = POINTS.index(str(rng.choice(["hand_l", "hand_r"])))
    first = layout.blocks[PLACES].start + 3 * point
    mask[_rows(rng, mask), first : first + 3] = True


def _places(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    _chosen(rng, layout, mask, PLACES, 3, int(rng.integers(2, len(POINTS) + 1)))


def _path(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    rows, first = _rows(rng, mask), layout.blocks[PATH].start
    mask[rows, first : first + 2] = True
    mask[rows, first + 3] = rng.random() < 0.5


def _heading(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    mask[_rows(rng, mask), layout.blocks[PATH].start + 3] = True


def _angles(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    rows, start = _rows(rng, mask), layout.blocks[ROTATIONS].start + PELVIS_SIZE
    joints = len(BALLS) + len(HINGES)
    count = FEW if rng.random() < 0.5 else joints
    for joint in rng.choice(joints, count, replace=False):
        first = start + 6 * min(int(joint), len(BALLS)) + max(int(joint) - len(BALLS), 0)
        mask[rows, first : first + (6 if joint < len(BALLS) else 1)] = True


def _torques(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    _chosen(rng, layout, mask, TORQUES, 1, FEW if rng.random() < 0.5 else MANY)


def _limits(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    count = FEW if rng.random() < 0.7 else MANY
    for joint in rng.choice(len(JOINTS), count, replace=False):
        mask[:, layout.blocks[TORQUE_LIMITS].start + int(joint)] = True


def _forces(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    rows = _rows(rng, mask)
    for foot in (0, 1) if rng.random() < 0.7 else (int(rng.integers(2)),):
        first = layout.blocks[FORCES].start + 3 * foot
        mask[rows, first : first + 3] = True
        first = layout.blocks[CENTRES].start + 2 * foot
        mask[rows, first : first + 2] = True


def _muscles(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    if ACTIVATIONS in layout.blocks:
        _chosen(rng, layout, mask, ACTIVATIONS, 1, FEW if rng.random() < 0.5 else MANY)


def _everything(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    share = SPARSE if rng.random() < 0.5 else DENSE
    count = max(1, round(share * len(mask)))
    mask[rng.choice(len(mask), count, replace=False)] = True
    mask[:, layout.blocks[TORQUE_LIMITS]] = False  # with the torques asked, their limits say nothing


def _nothing(rng: np.random.Generator, layout: ConstraintLayout, mask: Mask) -> None:
    pass


DRAWS: dict[str, tuple[float, Draw]] = {
    "nothing": (0.04, _nothing),
    "place": (0.08, _place),
    "hand": (0.16, _hand),
    "places": (0.08, _places),
    "path": (0.12, _path),
    "heading": (0.04, _heading),
    "angles": (0.05, _angles),
    "torques": (0.07, _torques),
    "limits": (0.05, _limits),
    "forces": (0.14, _forces),
    "muscles": (0.12, _muscles),
    "everything": (0.05, _everything),
}
"""Kinds of constraints with their shares of the windows."""


def draw_constraints(
    rng: np.random.Generator, layout: ConstraintLayout, values: Float, known: Mask
) -> tuple[Float, Mask, NDArray[np.intp]]:
    """What is asked of N windows.

    Args:
        rng: random generator.
        layout: of the columns.
        values: of the windows, (N, W, C).
        known: frames whose torques, forces and activations are known well, (N, W).

    Returns:
        Values (N, W, C) and mask (N, W, C); of each window the number of its kind in `DRAWS`, (N,).
    """
    asked, mask = values.copy(), np.zeros(values.shape, np.bool_)
    shares = np.array([share for share, _ in DRAWS.values()])
    kinds = rng.choice(len(DRAWS), len(values), p=shares / shares.sum())
    draws = [draw for _, draw in DRAWS.values()]
    limits = layout.blocks[TORQUE_LIMITS]
    for number, kind in enumerate(kinds):
        draws[kind](rng, layout, mask[number])
        asked[number, :, limits] = np.abs(values[number, :, limits]).max(axis=0) * rng.uniform(*LIMITS)
    for name in ESTIMATED:
        if name in layout.blocks:
            mask[..., layout.blocks[name]] &= known[..., None]
    return asked, mask, kinds
