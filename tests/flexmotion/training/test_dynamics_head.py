"""The dynamics head: torques and forces from the accelerations of a decoded motion."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.features.layout import Layout  # noqa: E402
from flexmotion.training.dynamics_head import DynamicsHead  # noqa: E402

LAYOUT = Layout(30.0, 0)
SPEED = LAYOUT.blocks["root"].start
HEIGHT = LAYOUT.blocks["root"].start + 3
PULL = LAYOUT.blocks["wrenches"].start + 2


def _swaying(count: int, frames: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Motions whose height alone varies, at up to 2 Hz, and its accelerations [1/s²]."""
    generator = torch.Generator().manual_seed(0)
    frequency, phase = torch.rand((2, count, 1), generator=generator)
    omega, time = 2 * torch.pi * (0.5 + 1.5 * frequency), torch.arange(frames) / LAYOUT.fps
    height = torch.sin(omega * time + 2 * torch.pi * phase)
    motion = torch.zeros(count, frames, LAYOUT.size)
    motion[..., HEIGHT] = height
    return motion, -omega.square() * height


@pytest.mark.parametrize(("past", "ahead"), [(8, 32), (0, 40), (2, 1), (0, 1)])
def test_it_adds_nothing_before_it_is_trained(past: int, ahead: int) -> None:
    torch.manual_seed(0)
    history, frames = torch.randn(2, past + ahead, LAYOUT.size).split([past, ahead], dim=1)
    assert torch.equal(DynamicsHead(8, LAYOUT)(history, frames), frames)


def test_uniform_motion_has_no_acceleration_at_its_ends() -> None:
    """Regression: without a history, a body of constant velocity seemed to start with a jerk."""
    head = DynamicsHead(8, LAYOUT)
    torch.nn.init.normal_(head.write.weight, generator=torch.Generator().manual_seed(0))
    motion = torch.zeros(1, 12, LAYOUT.size)
    motion[..., HEIGHT] = 0.1 * torch.arange(12)
    with torch.no_grad():
        head.read.weight[:, len(head._speeds) + len(head._places) :] = 0.0  # accelerations alone
        found = head(motion[:, :0], motion)
    torch.testing.assert_close(found[:, :, PULL], found[:, 5:6, PULL].expand(-1, 12))


@pytest.mark.parametrize("what", ["height", "speed"])
def test_it_learns_the_force_of_an_acceleration(what: str) -> None:
    """From heights, which are those of their frame, and from speeds, which are those since the frame before."""
    torch.manual_seed(0)
    head = DynamicsHead(16, LAYOUT)
    optimiser = torch.optim.Adam(head.parameters(), lr=1e-2)
    motion, acceleration = _swaying(64, 40)
    if what == "speed":
        motion[:, 1:, SPEED] = torch.diff(motion[..., HEIGHT], dim=1) * LAYOUT.fps / 10
        motion[..., HEIGHT] = 0.0
    history, frames = motion[:, :8], motion[:, 8:]
    wanted = acceleration[:, 8:-4] / 50  # the last four frames lack the frames after them
    for _ in range(300):
        optimiser.zero_grad()
        loss = (head(history, frames)[:, :-4, PULL] - wanted).square().mean()
        loss.backward()
        optimiser.step()
    assert loss < 0.01 * wanted.square().mean()


def test_only_torques_and_wrenches_change_and_no_gradient_reaches_the_motion() -> None:
    """Regression: the gradient through two differentiations of the motion gave it 25 % more jerk."""
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
