"""Torques and forces that go with the accelerations of a decoded motion."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.features.layout import Layout  # noqa: E402
from flexmotion.training.dynamics_head import DynamicsHead  # noqa: E402

LAYOUT = Layout(30.0, 0)
HEIGHT = LAYOUT.blocks["root"].start + 3
PULL = LAYOUT.blocks["wrenches"].start + 2


def _swaying(count: int, frames: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Heights that rise and fall at up to 2 Hz, alone in their frames, and their accelerations [1/s²]."""
    generator = torch.Generator().manual_seed(0)
    frequency, phase = torch.rand((2, count, 1), generator=generator)
    omega, time = 2 * torch.pi * (0.5 + 1.5 * frequency), torch.arange(frames) / LAYOUT.fps
    height = torch.sin(omega * time + 2 * torch.pi * phase)
    motion = torch.zeros(count, frames, LAYOUT.size)
    motion[..., HEIGHT] = height
    return motion, -omega.square() * height


def test_it_adds_nothing_before_it_is_trained() -> None:
    torch.manual_seed(0)
    history, frames = torch.randn(2, 3, 8, LAYOUT.size)
    assert torch.equal(DynamicsHead(8, LAYOUT)(history, frames), frames)
    assert torch.equal(DynamicsHead(8, LAYOUT)(None, frames), frames)


def test_it_learns_the_force_of_an_acceleration() -> None:
    torch.manual_seed(0)
    head = DynamicsHead(16, LAYOUT)
    optimiser = torch.optim.Adam(head.parameters(), lr=1e-2)
    motion, acceleration = _swaying(64, 40)
    history, frames = motion[:, :8], motion[:, 8:]
    wanted = acceleration[:, 8:-3] / 50  # the last three frames do not know what comes
    for _ in range(300):
        optimiser.zero_grad()
        loss = (head(history, frames)[:, :-3, PULL] - wanted).square().mean()
        loss.backward()
        optimiser.step()
    assert loss < 0.01 * wanted.square().mean()


def test_only_torques_and_wrenches_are_touched_and_the_gradient_stops_at_the_motion() -> None:
    """Went wrong: through two differentiations of the motion the gradient made it jerk by a quarter more."""
    torch.manual_seed(0)
    head = DynamicsHead(8, LAYOUT)
    torch.nn.init.normal_(head.write.weight)
    history, frames = torch.randn(2, 3, 8, LAYOUT.size)
    frames.requires_grad_(True)
    found = head(history, frames)
    first, last = LAYOUT.blocks["torques"].start, LAYOUT.blocks["wrenches"].stop
    changed = (found != frames).any(dim=0).any(dim=0)
    assert changed[first:last].all() and not changed[:first].any() and not changed[last:].any()
    found[..., first:last].square().sum().backward()
    assert frames.grad is not None and not frames.grad[..., :first].any() and frames.grad[..., first:last].any()
