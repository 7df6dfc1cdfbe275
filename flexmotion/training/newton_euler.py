"""Differentiable inverse dynamics: Newton-Euler equations over the tree, with ground reaction and external loads.

For a hinge through o with axis a that carries the segments S, ground reaction (f, n) about p at the feet F in S, and
external wrenches (e, k) about the centres of mass c:

    τ = a · ( Σ_S [ (c - o) x (m (c̈ - g) - e) + L̇ - k ] - Σ_F [ (p - o) x f + n ] )

as `biomechanics.inverse_dynamics` computes it in NumPy; only the chain of rotations is sequential.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flexmotion.biomechanics.differentiation import FIRST, HALF, SECOND
from flexmotion.features.joint_groups import BALL_COLUMNS, BALL_SIGNS, HINGE_COLUMNS
from flexmotion.human.skeleton import JOINTS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.differentiation import of_neighbours
from flexmotion.training.human_tensors import (
    ANKLES,
    BALL_SEGMENTS,
    CARRIED,
    FEET,
    HINGE_AXES,
    HINGE_SEGMENTS,
    JOINT_SEGMENTS,
    PARENTS,
    HumanTensors,
)
from flexmotion.training.kinematics import Segments


@dataclass(frozen=True)
class Rates:
    """Rates of change of the segments.

    Attributes:
        acceleration: of the centres of mass, (N, T, 21, 3) [m/s²].
        angular_momentum_rate: of the angular momenta about the centres of mass, (N, T, 21, 3) [N·m].
    """

    acceleration: Tensor
    angular_momentum_rate: Tensor


def angular_momentum(rotation: Tensor, rotation_rate: Tensor, humans: HumanTensors) -> Tensor:
    """Angular momentum of each segment about its centre of mass, world axes, (N, T, 21, 3) [N·m·s]."""
    spin = rotation_rate @ rotation.mT
    omega = 0.5 * torch.stack(
        [
            spin[..., 2, 1] - spin[..., 1, 2],
            spin[..., 0, 2] - spin[..., 2, 0],
            spin[..., 1, 0] - spin[..., 0, 1],
        ],
        dim=-1,
    )
    local = (rotation.mT @ omega[..., None])[..., 0] * humans.inertia[:, None]
    return (rotation @ local[..., None])[..., 0]


def rates(found: Segments, humans: HumanTensors, fps: float) -> Rates:
    """Rates by central differences over seven frames, at the frames `2 * HALF` to T - `2 * HALF`.

    Args:
        found: segments, (N, T, ...).
        humans: N of them.
        fps: frame rate [Hz].
    """
    turning = of_neighbours(found.rotation, FIRST.tolist()) * fps
    momentum = angular_momentum(found.rotation[:, HALF:-HALF], turning, humans)
    return Rates(
        acceleration=of_neighbours(found.com[:, HALF:-HALF], SECOND.tolist()) * fps**2,
        angular_momentum_rate=of_neighbours(momentum, FIRST.tolist()) * fps,
    )


def generalised_forces(
    found: Segments,
    moving: Rates,
    humans: HumanTensors,
    wrenches: Tensor,
    branches: Tensor,
    external: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Residual wrench on the root, and joint torques.

    Args:
        found: segments, (N, T, ...).
        moving: their rates, at the same frames.
        humans: N of them.
        wrenches: ground reaction about the ankles, world axes, (N, T, 2, 6) [N, N·m].
        branches: sign of the cosine of each ball joint's second angle, (N, T, 6); it selects one of the two triples
            of angles of the same rotation.
        external: other wrenches on all segments about their centres of mass, world axes, (N, T, 21, 6) [N, N·m]; None
            for none. Gravity in another direction is one such force, m (g' - g), on every segment.

    Returns:
        Force [N] and moment about the pelvis' origin [N·m] that the root needs, world axes, (N, T, 6); joint torques in
        the order of `JOINTS`, (N, T, 26) [N·m].
    """
    gravity = found.com.new_tensor([0.0, 0.0, GRAVITY])
    force = humans.mass[:, None, :, None] * (moving.acceleration + gravity)
    if external is not None:
        force = force - external[..., :3]
    moment = torch.linalg.cross(found.com, force) + moving.angular_momentum_rate
    if external is not None:
        moment = moment - external[..., 3:]
    ground = torch.zeros_like(force)
    twist = torch.zeros_like(moment)
    feet = list(FEET)
    ankles = found.origin[:, :, list(ANKLES)]
    pull = wrenches[..., :3]
    ground[:, :, feet] = pull
    twist[:, :, feet] = torch.linalg.cross(ankles, pull) + wrenches[..., 3:]
    force, moment = force - ground, moment - twist

    total = force.sum(dim=2)
    pelvis = moment.sum(dim=2) - torch.linalg.cross(found.origin[:, :, 0], total)
    carried = torch.as_tensor(CARRIED, dtype=force.dtype, device=force.device)
    joint_force = torch.einsum("js,ntsi->ntji", carried, force)
    anchors = found.origin[:, :, list(JOINT_SEGMENTS)]
    joint_moment = torch.einsum("js,ntsi->ntji", carried, moment) - torch.linalg.cross(anchors, joint_force)
    torques = (joint_axes(found, branches) * joint_moment).sum(dim=-1)
    return torch.cat([total, pelvis], dim=-1), torques


def joint_axes(found: Segments, branches: Tensor) -> Tensor:
    """Axes of all joints in the world, (N, T, 26, 3).

    Of a ball joint's three axes the first is fixed to the segment above, the last to the one below, and the middle one
    is perpendicular to both.
    """
    rotation = found.rotation
    axes = rotation.new_zeros((*rotation.shape[:2], len(JOINTS), 3))
    for ball, segment in enumerate(BALL_SEGMENTS):
        first, last = rotation[:, :, PARENTS[segment], :, 1], rotation[:, :, segment, :, 2]
        middle = torch.nn.functional.normalize(torch.linalg.cross(first, last), dim=-1, eps=1e-6)
        for axis, column, sign in zip(
            (first, middle * branches[..., ball, None], last), BALL_COLUMNS[ball], BALL_SIGNS[ball], strict=True
        ):
            axes[:, :, column] = axis * sign
    for hinge, segment in enumerate(HINGE_SEGMENTS):
        local = rotation.new_tensor(HINGE_AXES[hinge])
        axes[:, :, HINGE_COLUMNS[hinge]] = rotation[:, :, segment] @ local
    return axes
