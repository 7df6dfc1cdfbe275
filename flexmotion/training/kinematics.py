"""Differentiable kinematics: poses from features, segments and points in the world from poses."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE
from flexmotion.features.layout import Layout
from flexmotion.training.human_tensors import (
    BALL_SEGMENTS,
    HINGE_AXES,
    HINGE_SEGMENTS,
    PARENTS,
    POINT_SEGMENTS,
    HumanTensors,
)


@dataclass(frozen=True)
class Pose:
    """Poses of N humans over T frames.

    Attributes:
        place: pelvis origin in the world, (N, T, 3) [m].
        pelvis: rotation of the pelvis, (N, T, 3, 3).
        balls: rotations of the ball joints (three hinges each), (N, T, 6, 3, 3).
        hinges: angles of the single hinges, (N, T, 8) [rad].
    """

    place: Tensor
    pelvis: Tensor
    balls: Tensor
    hinges: Tensor


@dataclass(frozen=True)
class Segments:
    """Segments in the world: rotations (N, T, 21, 3, 3), origins (N, T, 21, 3) [m], centres of mass likewise."""

    rotation: Tensor
    origin: Tensor
    com: Tensor


def matrix(columns: Tensor) -> Tensor:
    """Rotation matrices from two columns by Gram-Schmidt, (..., 6) -> (..., 3, 3)."""
    x = torch.nn.functional.normalize(columns[..., :3], dim=-1, eps=1e-6)
    second = columns[..., 3:]
    y = torch.nn.functional.normalize(second - (x * second).sum(-1, keepdim=True) * x, dim=-1, eps=1e-6)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def about_z(yaw: Tensor) -> Tensor:
    """Rotations about z, (...,) [rad] -> (..., 3, 3)."""
    cosine, sine = torch.cos(yaw), torch.sin(yaw)
    zero, one = torch.zeros_like(yaw), torch.ones_like(yaw)
    rows = (torch.stack(row, dim=-1) for row in ((cosine, -sine, zero), (sine, cosine, zero), (zero, zero, one)))
    return torch.stack(list(rows), dim=-2)


def path(root: Tensor, fps: float) -> tuple[Tensor, Tensor]:
    """Path on the floor from the block `root`, (N, T, 4): place (N, T, 2) [leg] and yaw (N, T) [rad].

    The path starts at the origin, facing x, one frame before the first.
    """
    yaw = torch.cumsum(root[..., 2], dim=1) / fps
    before = torch.nn.functional.pad(yaw[:, :-1], (1, 0))
    cosine, sine = torch.cos(before), torch.sin(before)
    forward, left = root[..., 0], root[..., 1]
    step = torch.stack([cosine * forward - sine * left, sine * forward + cosine * left], dim=-1)
    return torch.cumsum(step, dim=1) / fps, yaw


def pose(features: Tensor, layout: Layout, humans: HumanTensors) -> Pose:
    """Poses from features that are not normalised, (N, T, F)."""
    root, rotations = features[..., layout.blocks["root"]], features[..., layout.blocks["rotations"]]
    floor, yaw = path(root, layout.fps)
    balls = rotations[..., PELVIS_SIZE : PELVIS_SIZE + 6 * len(BALLS)].unflatten(-1, (len(BALLS), 6))
    return Pose(
        place=torch.cat([floor, root[..., 3:4]], dim=-1) * humans.leg[:, None, None],
        pelvis=about_z(yaw) @ matrix(rotations[..., :PELVIS_SIZE]),
        balls=matrix(balls),
        hinges=rotations[..., -len(HINGES) :],
    )


def segments(pose: Pose, humans: HumanTensors) -> Segments:
    """Segments in the world, from the pelvis outwards along the tree."""
    hinge = _hinge_matrices(pose.hinges)
    rotations: list[Tensor] = []
    origins: list[Tensor] = []
    for number, parent in enumerate(PARENTS):
        if parent < 0:
            rotations.append(pose.pelvis)
            origins.append(pose.place)
            continue
        frame = rotations[parent]
        origins.append(origins[parent] + _turned(frame, humans.offset[:, None, number]))
        if number in BALL_SEGMENTS:
            rotations.append(frame @ pose.balls[:, :, BALL_SEGMENTS.index(number)])
        elif number in HINGE_SEGMENTS:
            rotations.append(frame @ hinge[:, :, HINGE_SEGMENTS.index(number)])
        else:
            rotations.append(frame @ humans.turn[:, None, number])
    rotation, origin = torch.stack(rotations, dim=2), torch.stack(origins, dim=2)
    return Segments(rotation, origin, origin + _turned(rotation, humans.com[:, None]))


def points(found: Segments, humans: HumanTensors) -> Tensor:
    """The points of `layout.POINTS` in the world, (N, T, 16, 3) [m]."""
    owners = list(POINT_SEGMENTS)
    return found.origin[:, :, owners] + _turned(found.rotation[:, :, owners], humans.point[:, None])


def _turned(rotation: Tensor, vector: Tensor) -> Tensor:
    return (rotation @ vector[..., None])[..., 0]


def _hinge_matrices(angles: Tensor) -> Tensor:
    """Rotations about y or z, (N, T, 8) [rad] -> (N, T, 8, 3, 3)."""
    signs = torch.as_tensor(HINGE_AXES.sum(axis=1), dtype=angles.dtype, device=angles.device)
    cosine, sine = torch.cos(angles * signs), torch.sin(angles * signs)
    zero, one = torch.zeros_like(cosine), torch.ones_like(cosine)
    about = {
        1: ((cosine, zero, sine), (zero, one, zero), (-sine, zero, cosine)),
        2: ((cosine, -sine, zero), (sine, cosine, zero), (zero, zero, one)),
    }
    axes = abs(HINGE_AXES).argmax(axis=1)
    matrices = []
    for number, axis in enumerate(axes):
        rows = [torch.stack([value[..., number] for value in row], dim=-1) for row in about[int(axis)]]
        matrices.append(torch.stack(rows, dim=-2))
    return torch.stack(matrices, dim=2)
