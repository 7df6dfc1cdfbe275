"""The stages of the autoencoder: it learns, and forces trained later do not change its motion."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import ConfigError  # noqa: E402
from flexmotion.training.autoencoder import Autoencoder  # noqa: E402
from flexmotion.training.autoencoder_task import AutoencoderTask, load_autoencoder  # noqa: E402
from flexmotion.training.checkpoints import BEST, load_weights  # noqa: E402
from flexmotion.training.export import load_networks  # noqa: E402
from flexmotion.training.personal import personal_run  # noqa: E402
from flexmotion.training.processes import Processes  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402
from flexmotion.training.stage import train_stage  # noqa: E402
from flexmotion.training.window_set import WindowSet  # noqa: E402


def test_losses_fall(trained: Run, stages, tmp_path: Path) -> None:
    """Of what is decoded; the equations of motion enter later (`physics_from`)."""
    task = stages.autoencoder(trained)
    untrained = task.validate()
    blocks = {name: weight for name, weight in trained.config.losses.blocks.items() if name in untrained}
    before = sum(weight * untrained[name] for name, weight in blocks.items())
    changes = {"steps": 50, "learning_rate": 3e-3, "validate_every": 50}
    stage = trained.config.stages.autoencoder.model_copy(update=changes)
    done = train_stage(task, stage, tmp_path / "autoencoder", fingerprint="")
    after = sum(weight * done.figures[name] for name, weight in blocks.items())
    assert after < 0.9 * before


def test_an_untrained_autoencoder_is_the_principal_components(trained: Run) -> None:
    """Regression: after 2,000 steps the networks alone were worse than the linear maps before training."""
    alone = trained.config.autoencoder.model_copy(update={"shortcut": False})
    with_components, without = (
        AutoencoderTask(
            trained.config.model_copy(update={"autoencoder": config}), trained.store(), trained.seed, Processes()
        ).validate()
        for config in (trained.config.autoencoder, alone)
    )
    for block in ("root", "rotations", "positions"):
        assert with_components[block] < 0.5 * without[block]


def test_trained_forces_do_not_change_the_motion(trained: Run) -> None:
    """A diffusion trained on the latents stays valid, bit for bit."""
    before = Autoencoder(trained.config.autoencoder, trained.config.window, trained.layout)
    load_weights(before, trained.stage("autoencoder"))
    after = load_autoencoder(trained)
    windows = WindowSet(trained.store(), trained.config.window, "validation").draw((7,), 4)
    with torch.no_grad():
        latents = [network.encode(windows.history, windows.future) for network in (before, after)]
        assert all(torch.equal(*pair) for pair in zip(*latents, strict=True))
        decoded = [network.decode(windows.history, latents[0][0]) for network in (before, after)]
    blocks = trained.layout.blocks
    changed = {name for name, cut in blocks.items() if not torch.equal(*(frames[..., cut] for frames in decoded))}
    assert changed == {"accelerations", "torques", "wrenches", "contacts"}


def test_only_better_forces_are_kept(trained: Run, stages, tmp_path: Path) -> None:
    """Regression: weights that a minute of training had made worse were exported."""
    task = stages.forces(trained)
    before = {name: value.clone() for name, value in task.network.state_dict().items()}
    stage = trained.config.stages.forces.model_copy(update={"learning_rate": 1.0, "warm_up": 0})
    train_stage(task, stage, tmp_path / "forces", fingerprint="", pretrained=True)
    kept = torch.load(tmp_path / "forces" / BEST, weights_only=True)["network"]
    assert all(torch.equal(kept[name], before[name]) for name in before)


def test_forces_of_another_motion_are_refused(trained: Run, tmp_path: Path) -> None:
    """Regression: an autoencoder trained further after its forces was exported with those."""
    run = personal_run(trained, tmp_path / "other", "like Ada")
    weights = torch.load(run.stage("autoencoder") / BEST, weights_only=True)
    weights["network"]["read.maps.root.weight"] += 0.1
    torch.save(weights, run.stage("autoencoder") / BEST)
    with pytest.raises(ConfigError, match="another autoencoder's motion"):
        load_networks(run, distilled=False)


def test_a_zero_has_no_sign_to_tell_motions_apart(trained: Run, tmp_path: Path) -> None:
    """Regression: weights from half precision had negative zeros, their averages positive ones, and were refused."""
    run = personal_run(trained, tmp_path / "other", "like Ada")
    for stage, zero in (("autoencoder", -0.0), ("forces", 0.0)):
        weights = torch.load(run.stage(stage) / BEST, weights_only=True)
        weights["network"]["read.maps.root.weight"][0, 0] = zero
        torch.save(weights, run.stage(stage) / BEST)
    load_autoencoder(run)
