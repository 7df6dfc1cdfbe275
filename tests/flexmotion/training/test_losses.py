"""Which frames count in the losses of the autoencoder."""

from __future__ import annotations

from dataclasses import replace

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.features.layout import FORCES  # noqa: E402
from flexmotion.training.losses import Reconstruction  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.window_set import WindowSet  # noqa: E402
from flexmotion.training.windows import Windows  # noqa: E402

ROW, FRAME = 1, 5


def gradients(trained: Run, windows: Windows) -> dict[str, torch.Tensor]:
    """Size of each block's gradient in every frame, (N, W), where all features are off by as much."""
    loss = Reconstruction(trained.store().layout, trained.store().statistics, trained.config.losses)
    decoded = (windows.future + 0.1).requires_grad_()
    terms = loss.kinematic(decoded, windows)
    names = [name for name in terms if name in loss.layout.blocks]
    torch.stack([terms[name] for name in names]).sum().backward()
    assert decoded.grad is not None
    return {name: decoded.grad[..., loss.layout.blocks[name]].norm(dim=-1) for name in names}


@pytest.fixture
def windows(trained: Run) -> Windows:
    """Windows whose frames are all good and within their clip, with forces known without error."""
    drawn = WindowSet(trained.store(), trained.config.window, "train").draw((3,), 4)
    known, sure = torch.ones_like(drawn.good), torch.zeros_like(drawn.force_error)
    return replace(drawn, good=known, force_error=sure, mask=torch.ones_like(drawn.mask))


def test_uncertain_forces_have_small_gradients(trained: Run, windows: Windows) -> None:
    """Of the inverse variance: at the configured scale half of that of a frame without error, at ten times 1/101."""
    scale = trained.config.losses.force_error
    past = windows.history.shape[1]
    error = windows.force_error.clone()
    error[ROW, past + FRAME], error[ROW, past + FRAME + 1] = scale, 10 * scale
    found = gradients(trained, replace(windows, force_error=error))
    for name, size in found.items():
        share = (size[ROW, FRAME : FRAME + 2] / size[0, FRAME]).tolist()
        assert share == pytest.approx([0.5, 1 / 101] if name in FORCES else [1.0, 1.0], rel=1e-3), name


def test_forces_of_frames_that_are_not_good_do_not_count(trained: Run, windows: Windows) -> None:
    """Regression: `good` counted in the equations of motion, but forces of other frames were learnt all the same."""
    good = windows.good.clone()
    good[ROW, windows.history.shape[1] + FRAME] = False
    for name, size in gradients(trained, replace(windows, good=good)).items():
        assert bool(size[ROW, FRAME] == 0) == (name in FORCES), name
        assert size[0].min() > 0


def test_without_a_scale_every_good_frame_counts_alike(trained: Run, windows: Windows) -> None:
    weights = trained.config.losses.model_copy(update={"force_error": 0.0})
    loss = Reconstruction(trained.store().layout, trained.store().statistics, weights)
    assert torch.equal(loss.certainty(replace(windows, force_error=windows.force_error + 3.0)), windows.mask.float())
