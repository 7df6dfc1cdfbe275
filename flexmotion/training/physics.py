"""The Euler-Lagrange loss: decoded torques and ground forces against those that the decoded motion needs.

Its gradient reaches torques and forces alone. The gradient through two differentiations of the motion is much larger:
trained with it, motions had 25 % more jerk, and the residual was larger than without the loss.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.features.layout import Layout
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.human_tensors import LOADED, LOADS, HumanTensors
from flexmotion.training.kinematics import Segments, about_z, path, pose, segments
from flexmotion.training.newton_euler import generalised_forces, rates


@dataclass(frozen=True)
class EulerResidual:
    """Residual of the equations of motion at the frames `EDGE` to T - `EDGE`.

    Attributes:
        root: forces per body weight, moments per body weight and leg length, (N, T - 2 EDGE, 6).
        joints: torques per body weight and leg length, (N, T - 2 EDGE, 26).
    """

    root: Tensor
    joints: Tensor


def euler_residual(
    features: Tensor, layout: Layout, humans: HumanTensors, branches: Tensor, loads: Tensor | None = None
) -> EulerResidual:
    """Residual of the equations of motion under decoded ground forces and known external loads.

    Args:
        features: not normalised, (N, T, F).
        layout: of the features.
        humans: N of them.
        branches: see `newton_euler.generalised_forces`.
        loads: external forces, see `external_wrenches`; None for none.
    """
    weight = humans.mass.sum(dim=1) * GRAVITY
    motion = features.detach()
    here = segments(pose(motion, layout, humans), humans)
    inner = slice(EDGE, features.shape[1] - EDGE)
    middle = Segments(here.rotation[:, inner], here.origin[:, inner], here.com[:, inner])
    _, yaw = path(motion[..., layout.blocks["root"]], layout.fps)
    wrenches = world_wrenches(features, yaw, layout, weight, humans.leg)[:, inner]
    external = None if loads is None else external_wrenches(loads, yaw, humans)[:, inner]
    moving = rates(here, humans, layout.fps)
    root, needed = generalised_forces(middle, moving, humans, wrenches, branches[:, inner], external)
    force, moment = weight[:, None, None], (weight * humans.leg)[:, None, None]
    return EulerResidual(
        root=torch.cat([root[..., :3] / force, root[..., 3:] / moment], dim=-1),
        joints=features[:, inner, layout.blocks["torques"]] - needed / moment,
    )


def world_wrenches(features: Tensor, yaw: Tensor, layout: Layout, weight: Tensor, leg: Tensor) -> Tensor:
    """Ground reaction about the ankles, world axes, (N, T, 2, 6) [N, N·m].

    Args:
        features: not normalised, (N, T, F); their wrenches are in the frame of the heading.
        yaw: heading, (N, T) [rad].
        layout: of the features.
        weight: body weights, (N,) [N].
        leg: leg lengths, (N,) [m].
    """
    parts = features[..., layout.blocks["wrenches"]].unflatten(-1, (2, 2, 3))
    turned = torch.einsum("ntij,ntfkj->ntfki", about_z(yaw), parts)
    scale = torch.stack([weight, weight * leg], dim=-1)[:, None, None, :, None]
    return (turned * scale).flatten(-2)


def external_wrenches(loads: Tensor, yaw: Tensor, humans: HumanTensors) -> Tensor:
    """Wrenches on all segments about their centres of mass, world axes, (N, T, 21, 6) [N, N·m].

    Args:
        loads: forces on the centres of mass of `LOADED`, and one that all segments share by their mass, heading frame,
            (N, T, LOADS, 3) [body weights].
        yaw: heading, (N, T) [rad].
        humans: N of them.
    """
    gravity = humans.mass[:, None, :, None] * GRAVITY
    turned = torch.einsum("ntij,ntbj->ntbi", about_z(yaw), loads)
    force = gravity * turned[:, :, LOADS - 1 :]
    force[:, :, list(LOADED)] += gravity.sum(dim=2, keepdim=True) * turned[:, :, : LOADS - 1]
    return torch.cat([force, torch.zeros_like(force)], dim=-1)
