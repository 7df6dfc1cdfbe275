"""`Windows`: a batch of windows of normalised features, and the batches that are made of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from flexmotion.spatial.transitions import smoothstep

TENSORS = ("history", "future", "following", "mask", "branches", "good", "loads", "force_error")


@dataclass(frozen=True)
class Windows:
    """N windows of normalised features.

    Attributes:
        history: (N, H, F).
        future: (N, W, F).
        following: the W frames after it, (N, W, F); None where not drawn.
        mask: frames of the future that lie within the clip, not held at its end, (N, W).
        clip: index into the store's clips, (N,).
        first: frame of the clip at which the future begins, (N,).
        branches: (N, H + W, 6), see `newton_euler.generalised_forces`.
        good: frames whose motion the ground reaction explains, (N, H + W).
        loads: external forces, see `physics.external_wrenches`, (N, H + W, LOADS, 3) [body weights]. They are known,
            not decoded.
        force_error: estimated standard error of the ground forces, (N, H + W) [body weights].
    """

    history: Tensor
    future: Tensor
    following: Tensor | None
    mask: Tensor
    clip: np.ndarray
    first: np.ndarray
    branches: Tensor
    good: Tensor
    loads: Tensor
    force_error: Tensor

    @property
    def future_loads(self) -> Tensor:
        """Loads of the frames of the future, (N, W, LOADS, 3) [body weights]."""
        return self.loads[:, self.history.shape[1] :]

    def to(self, device: torch.device) -> Windows:
        """On another device."""
        moved = self._each(lambda tensor: tensor.to(device))
        return Windows(clip=self.clip, first=self.first, **moved)

    def first_of(self, count: int) -> Windows:
        """The first `count` of them."""
        cut = self._each(lambda tensor: tensor[:count])
        return Windows(clip=self.clip[:count], first=self.first[:count], **cut)

    def every(self, step: int) -> Windows:
        """Every `step`-th of them."""
        return Windows(clip=self.clip[::step], first=self.first[::step], **self._each(lambda tensor: tensor[::step]))

    def with_history(self, history: Tensor) -> Windows:
        """The same futures after other histories, (N, H, F)."""
        return replace(self, history=history)

    def next(self, history: Tensor) -> Windows:
        """The windows that follow, after another history, (N, H, F).

        Raises:
            ValueError: the windows were drawn without those that follow.
        """
        if self.following is None:
            raise ValueError("expected windows drawn with the windows that follow")
        return replace(
            self,
            history=history,
            future=self.following,
            following=None,
            first=self.first + self.future.shape[1],
            mask=torch.ones_like(self.mask),
            # Not drawn for the frames that follow.
            good=torch.zeros_like(self.good),
            loads=torch.zeros_like(self.loads),
            force_error=torch.zeros_like(self.force_error),
        )

    def blended_into(self, others: Windows, frames: int) -> Windows:
        """These histories, with futures that change over from these to `others` within `frames` frames."""
        passed = np.arange(1.0, self.future.shape[1] + 1)
        share = self.future.new_tensor(smoothstep(passed, 0.0, frames + 1.0))[:, None]
        return replace(
            others,
            history=self.history,
            future=self.future + share * (others.future - self.future),
            mask=self.mask & others.mask,
            good=torch.zeros_like(others.good),  # no ground reaction explains a blended motion
        )

    def joined(self, others: Windows) -> Windows:
        """These windows, then others, both without `following`."""
        both = {
            name: torch.cat([getattr(self, name), getattr(others, name)]) for name in TENSORS if name != "following"
        }
        clip, first = np.concatenate([self.clip, others.clip]), np.concatenate([self.first, others.first])
        return Windows(clip=clip, first=first, following=None, **both)

    def _each(self, function: Callable[[Tensor], Tensor]) -> dict[str, Any]:
        values = {name: getattr(self, name) for name in TENSORS}
        return {name: None if value is None else function(value) for name, value in values.items()}
