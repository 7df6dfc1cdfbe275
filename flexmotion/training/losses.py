"""The autoencoder's losses by name, not weighted.

Which frames count:

- recorded motion (root, rotations, positions, velocities, accelerations, and all that follows from them): every frame;
- estimated forces (`layout.FORCES`): `good` frames, by the inverse variance of their error. With an estimated standard
  error e of the ground forces, and a variance s² of what a model trained on perfect labels would still be off, a frame
  counts s² / (s² + e²) = 1 / (1 + (e/s)²);
- equations of motion and muscle torques: `good` frames alike. They compare decoded quantities with each other, so that
  errors of the labels do not matter; in other frames forces act that are not known (a chair, a stair).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.configs.model import LossWeights
from flexmotion.features.layout import ACTIVATIONS, FORCES, Layout
from flexmotion.features.statistics import Statistics
from flexmotion.training.human_tensors import HumanTensors
from flexmotion.training.kinematics import path, points, pose, segments
from flexmotion.training.muscle_torques import MuscleTorques
from flexmotion.training.physics import euler_residual
from flexmotion.training.windows import Windows

CHANGING = ("root", "rotations", "positions")
"""Blocks whose change from frame to frame is compared too."""

PHYSICS = ("euler_joints", "euler_root", "muscle_limits", "muscle_torques")

WHOLE = 0.1
"""Residuals beyond this count linearly, so that jumps and falls do not dominate the mean [body weight]."""


@dataclass
class Reconstruction:
    """Losses of decoded windows.

    Args:
        layout: of the features.
        statistics: by which they are normalised.
        weights: losses of weight 0 are not computed.
        muscles: muscle torques; None for no such loss.
    """

    layout: Layout
    statistics: Statistics
    weights: LossWeights
    muscles: MuscleTorques | None = None

    def __post_init__(self) -> None:
        self._mean = torch.from_numpy(self.statistics.mean)
        self._spread = torch.from_numpy(self.statistics.spread)

    def restore(self, normalised: Tensor) -> Tensor:
        """Features in their units."""
        return normalised * self._spread.to(normalised.device) + self._mean.to(normalised.device)

    def kinematic(self, decoded: Tensor, windows: Windows) -> dict[str, Tensor]:
        """Errors of blocks (N, W, F), of their change, and of the root's path."""
        blocks, mask = self.layout.blocks, windows.mask
        known = self.certainty(windows)
        losses = {}
        for name in self.weights.blocks:
            if name in blocks:
                error = decoded[..., blocks[name]] - windows.future[..., blocks[name]]
                size = error.abs() if name == "wrenches" else error.square()
                losses[name] = _mean(size.mean(dim=-1), known if name in FORCES else mask)
        if self.weights.change:
            columns = [at for name in CHANGING for at in range(blocks[name].start, blocks[name].stop)]
            last = windows.history[:, -1:]
            steps = [
                torch.diff(torch.cat([last, frames], dim=1)[..., columns], dim=1)
                for frames in (decoded, windows.future)
            ]
            offset = decoded.shape[1] - steps[0].shape[1]
            # Changes from frame to frame are small compared with the features.
            losses["change"] = 10 * _mean((steps[0] - steps[1]).square().mean(dim=-1), mask[:, offset:])
        if self.weights.path:
            root = blocks["root"]
            (place, yaw), (true_place, true_yaw) = (
                path(self.restore(frames)[..., root], self.layout.fps) for frames in (decoded, windows.future)
            )
            error = (place - true_place).square().sum(dim=-1) + (yaw - true_yaw).square()
            losses["path"] = 10 * _mean(error, mask)
        return losses

    def certainty(self, windows: Windows) -> Tensor:
        """Weight of the estimated forces in every frame of the futures, (N, W), 0 to 1."""
        past, scale = windows.history.shape[1], self.weights.force_error
        known = (windows.good[:, past:] & windows.mask).to(windows.force_error.dtype)
        return known / (1.0 + (windows.force_error[:, past:] / scale).square()) if scale else known

    def physical(self, decoded: Tensor, windows: Windows, humans: HumanTensors) -> dict[str, Tensor]:
        """Errors of points by forward kinematics, and residuals of the equations of motion, of N windows.

        The residuals are of the decoded frames, without `EDGE` frames at either end.

        Args:
            decoded: futures, normalised, (N, W, F).
            windows: the true ones.
            humans: of the windows, N of them.
        """
        weights, losses = self.weights, {}
        true = self.restore(torch.cat([windows.history, windows.future], dim=1))
        whole = self.restore(torch.cat([windows.history, decoded], dim=1))
        past = windows.history.shape[1]
        if weights.points:
            found, expected = (
                points(segments(pose(frames, self.layout, humans), humans), humans) for frames in (whole, true)
            )
            error = (found - expected)[:, past:] / humans.leg[:, None, None, None]
            losses["points"] = 100 * _mean(error.square().sum(dim=-1).mean(dim=-1), windows.mask)
        if weights.euler_joints or weights.euler_root:
            # Heights in the store have half precision: differentiated twice, those of a history are noise of 6 % of
            # body weight, so histories are left out.
            branches, loads = windows.branches[:, past:], windows.future_loads
            residual = euler_residual(whole[:, past:], self.layout, humans, branches, loads)
            good = windows.good[:, past + EDGE : -EDGE or None]
            for name, value in (("euler_joints", residual.joints), ("euler_root", residual.root)):
                size = torch.nn.functional.huber_loss(value, torch.zeros_like(value), reduction="none", delta=WHOLE)
                losses[name] = 100 * _mean(size.mean(dim=-1), good)
        if self.muscles is not None and weights.muscle_torques:
            missing = self.muscles.residual(whole, self.layout, humans)
            size = torch.nn.functional.huber_loss(missing, torch.zeros_like(missing), reduction="none", delta=WHOLE)
            losses["muscle_torques"] = 100 * _mean(size.mean(dim=-1), windows.good[:, 1:-1])
        return losses

    def muscular(self, decoded: Tensor) -> dict[str, Tensor]:
        """Mean square distance of activations from [0, 1]."""
        if not self.weights.muscle_limits or ACTIVATIONS not in self.layout.blocks:
            return {}
        activations = self.restore(decoded)[..., self.layout.blocks[ACTIVATIONS]]
        beyond = torch.relu(-activations) + torch.relu(activations - 1.0)
        return {"muscle_limits": 100 * beyond.square().mean()}


def weighted(losses: dict[str, Tensor], weights: LossWeights, physics: float = 1.0) -> Tensor:
    """Weighted sum of losses; those of physics are multiplied by `physics`."""
    total = torch.zeros(())
    for name, value in losses.items():
        weight = weights.blocks[name] if name in weights.blocks else getattr(weights, name)
        total = total + value * weight * (physics if name in PHYSICS else 1.0)
    return total


def divergence(mean: Tensor, spread: Tensor) -> Tensor:
    """Kullback-Leibler divergence from a standard normal, per element of the latent.

    Args:
        mean, spread: mean and logarithm of the variance, (N, latent).
    """
    return 0.5 * (mean.square() + spread.exp() - 1.0 - spread).mean()


def _mean(value: Tensor, mask: Tensor) -> Tensor:
    """Mean over the frames of a mask, or weighted."""
    share = mask.to(value.dtype)
    return (value * share).sum() / share.sum().clamp(min=1.0)
