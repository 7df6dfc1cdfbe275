"""`Examples`: what a student is distilled on: histories with the latents that follow them, and what was asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from flexmotion.training.conditions import Conditions
from flexmotion.training.diffusion_task import DiffusionTask


@dataclass(frozen=True)
class Example:
    """N windows.

    Attributes:
        history: normalised features, (N, H, F).
        latent: of the window after it, normalised, (N, L).
        conditions: that it was asked by.
    """

    history: Tensor
    latent: Tensor
    conditions: Conditions

    def joined(self, other: Example) -> Example:
        """These windows, then those."""
        history, latent = torch.cat([self.history, other.history]), torch.cat([self.latent, other.latent])
        return Example(history, latent, self.conditions.joined(other.conditions))


class Examples(Protocol):
    """A source of windows."""

    def draw(self, key: tuple[int, ...], size: int) -> Example:
        """Windows.

        Args:
            key: all that the draw depends on.
            size: number of windows.
        """
        ...


@dataclass(frozen=True)
class SetExamples:
    """Windows of the training set of a diffusion, as it is trained on them, encoded."""

    task: DiffusionTask

    def draw(self, key: tuple[int, ...], size: int) -> Example:
        """See `Examples`."""
        task = self.task
        windows, conditions = task.followed(task.drawn((*key, 0), (*key, 1), size, task.roll_out))
        latent = task.normalised(task.training.encode(windows.history, windows.future))
        return Example(windows.history, latent, conditions)


@dataclass(frozen=True)
class Halves:
    """Half of the windows from one source, the rest from another."""

    first: Examples
    second: Examples

    def draw(self, key: tuple[int, ...], size: int) -> Example:
        """See `Examples`."""
        half = size // 2
        return self.first.draw((*key, 5), half).joined(self.second.draw((*key, 6), size - half))
