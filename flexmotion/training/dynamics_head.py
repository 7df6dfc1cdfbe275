"""`DynamicsHead`: torques and ground forces follow from how the decoded motion accelerates.

A patch's token knows its own frames; what accelerates shows between frames, across patches, and in what the principal
components add. Without this head the Euler-Lagrange loss had nothing to take hold of.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from flexmotion.biomechanics.differentiation import FIRST, HALF, SECOND
from flexmotion.features.layout import Layout
from flexmotion.training.differentiation import of_neighbours

UNIT_S = 0.1
"""Rates are per this time [s]: normalised features then change by about as much as they measure."""

FORCES = ("torques", "wrenches")


class DynamicsHead(nn.Module):
    """Adds to decoded torques and wrenches what goes with the accelerations of the decoded motion.

    Gated linear: what a force is of an acceleration depends on which foot is loaded. Its gradient stops at the motion,
    as that of the loss that it serves. Adds nothing before it is trained.

    Args:
        hidden: width.
        layout: of the features.
    """

    def __init__(self, hidden: int, layout: Layout) -> None:
        super().__init__()
        root, points = layout.blocks["root"], layout.blocks["positions"]
        self._speeds = list(range(root.start, root.start + 3))
        self._places = [root.start + 3, *range(points.start, points.stop)]
        self._told = [at for name in (*FORCES, "contacts") for at in _columns(layout, name)]
        self._forces = [at for name in FORCES for at in _columns(layout, name)]
        self._unit = layout.fps * UNIT_S
        motion = len(self._speeds) + len(self._places)
        self.read = nn.Linear(2 * motion + len(self._told), 2 * hidden)
        self.write = nn.Linear(hidden, len(self._forces))
        nn.init.zeros_(self.write.weight)
        nn.init.zeros_(self.write.bias)

    def forward(self, history: Tensor, frames: Tensor) -> Tensor:
        """Decoded frames (N, W, F), normalised, after their history (N, H, F), with better torques and wrenches."""
        motion, past = frames.detach(), history.shape[1]
        whole = _extended(torch.cat([history, motion], dim=1), HALF, HALF + 1)[:, past:]
        # Speeds are those since the frame before: what they become within a frame lies between two of them.
        rates = of_neighbours(whole[..., self._speeds], FIRST.tolist()) * self._unit
        acceleration = 0.5 * (rates[:, :-1] + rates[:, 1:])
        bending = of_neighbours(whole[:, :-1, self._places], SECOND.tolist()) * self._unit**2
        seen = [acceleration, bending, motion[..., self._speeds], motion[..., self._places], frames[..., self._told]]
        added = self.write(nn.functional.glu(self.read(torch.cat(seen, dim=-1))))
        first, last = self._forces[0], self._forces[-1]
        return frames + nn.functional.pad(added, (first, frames.shape[-1] - 1 - last))


def _extended(frames: Tensor, before: int, after: int) -> Tensor:
    """Frames (N, T, F) with some more at either end, to which the motion goes on evenly."""
    steps = torch.diff(frames, dim=1) if frames.shape[1] > 1 else torch.zeros_like(frames)
    start = [frames[:, :1] - count * steps[:, :1] for count in range(before, 0, -1)]
    end = [frames[:, -1:] + count * steps[:, -1:] for count in range(1, after + 1)]
    return torch.cat([*start, frames, *end], dim=1)


def _columns(layout: Layout, name: str) -> range:
    return range(layout.blocks[name].start, layout.blocks[name].stop)
