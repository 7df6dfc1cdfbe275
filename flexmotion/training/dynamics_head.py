"""`DynamicsHead`: torques, ground forces and joint contact forces from the accelerations of the decoded motion.

A patch's token contains its own frames only; accelerations depend on neighbouring patches and on the principal
components too. Without this head the Euler-Lagrange loss lowered the residual of forces by 9 % only.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from flexmotion.biomechanics.differentiation import FIRST, HALF, SECOND
from flexmotion.features.layout import JOINT_CONTACT, Layout
from flexmotion.training.differentiation import of_neighbours
from flexmotion.training.human_tensors import LOADS

UNIT_S = 0.1
"""Unit of time of the rates [s]: rates of normalised features are then of the size of the features."""

LOAD_UNIT = 0.1
"""Unit of external loads [body weight]: of their size in the variants of a set."""


class DynamicsHead(nn.Module):
    """Adds a function of the decoded motion's accelerations to the decoded torques, wrenches and joint contact forces.

    Gated linear: how a force depends on an acceleration changes with the loaded foot. No gradient reaches the motion,
    as in the Euler-Lagrange loss. Adds nothing before training.

    Args:
        hidden: width of the hidden layer.
        layout: of the features.
        loads: whether external loads are an input.
    """

    def __init__(self, hidden: int, layout: Layout, *, loads: bool = False) -> None:
        super().__init__()
        root, points = layout.blocks["root"], layout.blocks["positions"]
        self._speeds = list(range(root.start, root.start + 3))
        self._places = [root.start + 3, *range(points.start, points.stop)]
        forces = ("torques", "wrenches", *([JOINT_CONTACT] if layout.joint_contact else []))
        self._inputs = [at for name in (*forces, "contacts") for at in _columns(layout, name)]
        self._forces = [at for name in forces for at in _columns(layout, name)]
        self._unit = layout.fps * UNIT_S
        motion = len(self._speeds) + len(self._places)
        self.read = nn.Linear(2 * motion + len(self._inputs), 2 * hidden)
        # It has no bias: where there are no loads it adds zero. An exported network does not contain it.
        self.carry = nn.Linear(3 * LOADS, 2 * hidden, bias=False) if loads else None
        self.write = nn.Linear(hidden, len(self._forces))
        nn.init.zeros_(self.write.weight)
        nn.init.zeros_(self.write.bias)

    def forward(self, history: Tensor, frames: Tensor, loads: Tensor | None = None) -> Tensor:
        """Decoded frames with corrected forces.

        Args:
            history: normalised, (N, H, F).
            frames: decoded, normalised, (N, W, F).
            loads: external forces, see `physics.external_wrenches`, (N, W, LOADS, 3) [body weights]; None for none.
        """
        motion, past = frames.detach(), history.shape[1]
        whole = _extended(torch.cat([history, motion], dim=1), HALF, HALF + 1)[:, past:]
        # A speed is that since the frame before: the acceleration at a frame lies between two of them.
        rates = of_neighbours(whole[..., self._speeds], FIRST.tolist()) * self._unit
        acceleration = 0.5 * (rates[:, :-1] + rates[:, 1:])
        bending = of_neighbours(whole[:, :-1, self._places], SECOND.tolist()) * self._unit**2
        inputs = [
            acceleration,
            bending,
            motion[..., self._speeds],
            motion[..., self._places],
            frames[..., self._inputs],
        ]
        hidden = self.read(torch.cat(inputs, dim=-1))
        if self.carry is not None and loads is not None:
            hidden = hidden + self.carry(loads.flatten(2) / LOAD_UNIT)
        added = self.write(nn.functional.glu(hidden))
        first, last = self._forces[0], self._forces[-1]
        return frames + nn.functional.pad(added, (first, frames.shape[-1] - 1 - last))


def _extended(frames: Tensor, before: int, after: int) -> Tensor:
    """Frames (N, T, F), extrapolated at constant rate by `before` and `after` frames."""
    steps = torch.diff(frames, dim=1) if frames.shape[1] > 1 else torch.zeros_like(frames)
    start = [frames[:, :1] - count * steps[:, :1] for count in range(before, 0, -1)]
    end = [frames[:, -1:] + count * steps[:, -1:] for count in range(1, after + 1)]
    return torch.cat([*start, frames, *end], dim=1)


def _columns(layout: Layout, name: str) -> range:
    return range(layout.blocks[name].start, layout.blocks[name].stop)
