"""The Euler-Lagrange loss: decoded torques and ground forces against what the decoded motion takes.

Its gradient goes to torques and forces alone. Through two differentiations of the motion it is far steeper: trained so,
motion jerked by a quarter more, and the residual was larger than without the loss.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.features.layout import Layout
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.human_tensors import HumanTensors
from flexmotion.training.kinematics import Segments, about_z, path, pose, segments
from flexmotion.training.newton_euler import generalised_forces, rates


@dataclass(frozen=True)
class EulerResidual:
    """What the equations of motion leave, per body weight (and leg): root (N, T, 6), joints (N, T, 26).

    Frames `EDGE` to the last but `EDGE`.
    """

    root: Tensor
    joints: Tensor


def euler_residual(features: Tensor, layout: Layout, humans: HumanTensors, branches: Tensor) -> EulerResidual:
    """Residual of features that are not normalised, (N, T, F); `branches` as in `newton_euler.generalised_forces`."""
    weight = humans.mass.sum(dim=1) * GRAVITY
    motion = features.detach()
    here = segments(pose(motion, layout, humans), humans)
    inner = slice(EDGE, features.shape[1] - EDGE)
    middle = Segments(here.rotation[:, inner], here.origin[:, inner], here.com[:, inner])
    _, yaw = path(motion[..., layout.blocks["root"]], layout.fps)
    wrenches = world_wrenches(features, yaw, layout, weight, humans.leg)[:, inner]
    root, needed = generalised_forces(middle, rates(here, humans, layout.fps), humans, wrenches, branches[:, inner])
    force, moment = weight[:, None, None], (weight * humans.leg)[:, None, None]
    return EulerResidual(
        root=torch.cat([root[..., :3] / force, root[..., 3:] / moment], dim=-1),
        joints=features[:, inner, layout.blocks["torques"]] - needed / moment,
    )


def world_wrenches(features: Tensor, yaw: Tensor, layout: Layout, weight: Tensor, leg: Tensor) -> Tensor:
    """Ground reaction about the ankles in the world, (N, T, 2, 6) [N, N·m], of bodies that face `yaw`, (N, T) [rad]."""
    parts = features[..., layout.blocks["wrenches"]].unflatten(-1, (2, 2, 3))
    turned = torch.einsum("ntij,ntfkj->ntfki", about_z(yaw), parts)
    scale = torch.stack([weight, weight * leg], dim=-1)[:, None, None, :, None]
    return (turned * scale).flatten(-2)
