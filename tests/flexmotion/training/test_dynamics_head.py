"""Torques and forces that go with the accelerations of a decoded motion."""

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
    """Heights that rise and fall at up to 2 Hz, alone in their frames, and their accelerations [1/s²]."""
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


def test_even_motion_has_no_acceleration_to_its_ends() -> None:
    """Went wrong: with no history a body that moved evenly seemed to start with a jerk."""
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
    """Heights are of their frames, speeds since the frame before."""
    torch.manual_seed(0)
    head = DynamicsHead(16, LAYOUT)
    optimiser = torch.optim.Adam(head.parameters(), lr=1e-2)
    motion, acceleration = _swaying(64, 40)
    if what == "speed":
        motion[:, 1:, SPEED] = torch.diff(motion[..., HEIGHT], dim=1) * LAYOUT.fps / 10
        motion[..., HEIGHT] = 0.0
    history, frames = motion[:, :8], motion[:, 8:]
    wanted = acceleration[:, 8:-4] / 50  # the last four frames do not know what comes
    for _ in range(300):
        optimiser.zero_grad()
        loss = (head(history, frames)[:, :-4, PULL] - wanted).square().mean()
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
