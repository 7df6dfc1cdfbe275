"""`ConstraintLayout`: what can be asked of a frame beside words, and how a window of features is measured by it.

Everything is in the frame of the window: on the floor below the pelvis of the last known frame, x along its heading, z
up. Units are those of `Layout`, so that what is asked of people of every size is alike.

`window_values` is the one definition for NumPy (sampling) and torch (training): it takes the module as an argument and
uses what both have.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE, ROTATION_SIZE
from flexmotion.features.layout import ACTIVATIONS, POINTS, Layout
from flexmotion.human.skeleton import JOINTS, LEG_JOINTS, SIDES

Array = Any
"""NumPy array or torch tensor."""

PATH, ROTATIONS, PLACES, TORQUES = "path", "rotations", "places", "torques"
TORQUE_LIMITS, FORCES, CENTRES = "torque_limits", "forces", "centres"

BLOCKS: dict[str, int] = {
    PATH: 4,  # place of the pelvis forward and left, its height [leg], heading [rad]
    ROTATIONS: ROTATION_SIZE,  # as in `Layout`: pelvis without its heading, balls, hinges
    PLACES: 3 * len(POINTS),  # of the points of the body [leg]
    TORQUES: len(JOINTS),  # [weight x leg]
    TORQUE_LIMITS: len(JOINTS),  # largest size of the torque [weight x leg]
    FORCES: 3 * len(SIDES),  # of the ground on left and right foot [weight]
    CENTRES: 2 * len(SIDES),  # of pressure of left and right foot, forward and left [leg]
}
"""Sizes of the blocks, in order; `activations` follow where the layout has muscles."""

LEG_POINTS = [place for place, name in enumerate(POINTS) if name.split("_")[0] in ("knee", "ankle", "heel", "toe")]
"""Points of the legs among `layout.POINTS`, without the hips."""
LEG_ROTATIONS = [
    PELVIS_SIZE + 6 * ball + column for ball, names in enumerate(BALLS) if "hip" in names[0] for column in range(6)
] + [PELVIS_SIZE + 6 * len(BALLS) + place for place, name in enumerate(HINGES) if "knee" in name or "ankle" in name]
"""Columns of the legs in a block of rotations."""
LEG_TORQUES = [place for place, name in enumerate(JOINTS) if name[:-2] in LEG_JOINTS]
"""Columns of the legs in a block of torques."""

TOLERANCES: dict[str, float] = {
    PATH: 0.01,
    ROTATIONS: 0.02,
    PLACES: 0.005,
    TORQUES: 0.01,
    TORQUE_LIMITS: 0.005,
    FORCES: 0.05,
    CENTRES: 0.02,
    ACTIVATIONS: 0.05,
}
"""Error of each block that counts as one standard deviation of a latent, in its units: with a leg of .9 m and 70 kg
about 1 cm, 1 degree, 5 mm, 6 N·m, 3 N·m, 35 N, 2 cm, 5 % of a muscle."""

SCALES: dict[str, float] = {
    PATH: 1.0,
    ROTATIONS: 0.5,
    PLACES: 0.5,
    TORQUES: 0.05,
    TORQUE_LIMITS: 0.05,
    FORCES: 0.5,
    CENTRES: 0.5,
    ACTIVATIONS: 0.2,
}
"""About the spread of each block in the data, in its units: a network gets values over it."""

FIRM = 0.05
"""Least share of body weight on a foot that has a centre of pressure."""


@dataclass(frozen=True)
class ConstraintLayout:
    """Columns of what can be asked of a frame.

    Attributes:
        layout: of the features.
    """

    layout: Layout

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Block -> its columns."""
        sizes = BLOCKS | ({ACTIVATIONS: self.layout.muscles} if self.layout.muscles else {})
        found, start = {}, 0
        for name, size in sizes.items():
            found[name] = slice(start, start + size)
            start += size
        return found

    @property
    def size(self) -> int:
        """Columns, C."""
        return list(self.blocks.values())[-1].stop

    @cached_property
    def tolerances(self) -> tuple[float, ...]:
        """Tolerance of every column, (C,)."""
        return self._of_columns(TOLERANCES)

    @cached_property
    def scales(self) -> tuple[float, ...]:
        """Scale of every column, (C,)."""
        return self._of_columns(SCALES)

    def _of_columns(self, table: dict[str, float]) -> tuple[float, ...]:
        sizes = ((table[name], cut.stop - cut.start) for name, cut in self.blocks.items())
        return tuple(value for value, size in sizes for _ in range(size))


def window_values(features: Array, layout: Layout, xp: ModuleType) -> Array:
    """Values of the columns of a `ConstraintLayout` in windows, (..., W, C).

    The block of limits holds the torques themselves. A foot that bears nothing has its centre below the ankle.

    Args:
        features: not normalised, (..., W, F).
        layout: of the features.
        xp: `numpy` or `torch`, as the features are.
    """
    blocks = layout.blocks
    root = features[..., blocks["root"]]
    place, yaw = window_path(root, layout.fps, xp)
    cosine, sine = xp.cos(yaw)[..., None], xp.sin(yaw)[..., None]

    def turned(vectors: Array) -> Array:
        """(..., W, P, 3), from the heading of each frame to that of the window."""
        x, y = vectors[..., 0], vectors[..., 1]
        return xp.stack([cosine * x - sine * y, sine * x + cosine * y, vectors[..., 2]], -1)

    def grouped(name: str) -> Array:
        values = features[..., blocks[name]]
        return values.reshape(*values.shape[:-1], -1, 3)

    relative = grouped("positions")
    points = turned(relative)
    level = xp.concatenate([place, xp.zeros_like(place[..., :1])], -1)[..., None, :]
    wrenches = grouped("wrenches")
    force, moment = wrenches[..., 0::2, :], wrenches[..., 1::2, :]
    ankle = xp.stack([relative[..., POINTS.index(f"ankle_{side}"), :] for side in SIDES], -2)
    centres = turned(ankle + _lever(force, moment, ankle[..., 2], xp)) + level
    torques = features[..., blocks["torques"]]
    parts = [
        xp.concatenate([place, root[..., 3:4], yaw[..., None]], -1),
        features[..., blocks["rotations"]],
        _flat(points + level),
        torques,
        torques,
        _flat(turned(force)),
        _flat(centres[..., :2]),
    ]
    if layout.muscles:
        parts.append(features[..., blocks[ACTIVATIONS]])
    return xp.concatenate(parts, -1)


def window_path(root: Array, fps: float, xp: ModuleType) -> tuple[Array, Array]:
    """Path on the floor from the block `root`, (..., W, 4): place (..., W, 2) [leg] and heading (..., W) [rad]."""
    yaw = root[..., 2].cumsum(-1) / fps
    before = xp.concatenate([xp.zeros_like(yaw[..., :1]), yaw[..., :-1]], -1)
    cosine, sine = xp.cos(before), xp.sin(before)
    ahead, aside = root[..., 0], root[..., 1]
    step = xp.stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside], -1)
    return step.cumsum(-2) / fps, yaw


def _lever(force: Array, moment: Array, height: Array, xp: ModuleType) -> Array:
    """Centres of pressure relative to the ankles: where on the floor the moment has no level part, (..., 2, 3)."""
    firm = force[..., 2] > FIRM
    load = xp.where(firm, force[..., 2], xp.ones_like(height))
    none = xp.zeros_like(height)
    x = xp.where(firm, (-moment[..., 1] - height * force[..., 0]) / load, none)
    y = xp.where(firm, (moment[..., 0] - height * force[..., 1]) / load, none)
    return xp.stack([x, y, -height], -1)


def _flat(vectors: Array) -> Array:
    return vectors.reshape(*vectors.shape[:-2], -1)
