"""Personalisation: the denoiser is trained further, its normalisation stays, and the bundle knows the manner."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.configs.errors import ConfigError  # noqa: E402
from flexmotion.sampling.sampler import Sampler  # noqa: E402
from flexmotion.training.personal import personal_run, personal_task  # noqa: E402
from flexmotion.training.personal_export import export_bundle  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402


def test_personalisation(trained: Run, small_set: Path, stages, tmp_path: Path) -> None:
    run = personal_run(trained, tmp_path / "ada", "like Ada")
    task = personal_task(run, trained, small_set, "like Ada")
    before = {name: value.clone() for name, value in task.network.state_dict().items()}
    done = stages.train(run, "diffusion", task, 2)
    assert set(done.parts) == {"kept", "learnt"}
    after = task.network.state_dict()
    assert any(not torch.equal(before[name], after[name]) for name in before)
    assert torch.equal(before["latent_mean"], after["latent_mean"])
    sampler = Sampler(export_bundle(run, tmp_path / "bundle", distilled=False), steps=2)
    assert sampler.prompt("turn left like Ada").manner == "like Ada"
    assert sampler.prompt("turn left").manner == "normal"
    # Only requests in the person's manner are trained on the person's clips.
    asked = task.person.training.describe(task.person.training.draw((1,), 64), (2,))
    assert bool(asked.present[:, 2].all())


def test_an_untrained_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not trained"):
        personal_run(Run(tmp_path / "empty", "stream"), tmp_path / "none", "like Ada")


@pytest.mark.parametrize(
    ("manner", "message"),
    [
        ("like an old man", "asks for the manner 'old' already"),
        ("normal", "asks for the manner 'normal' already"),
        ("walk", "is a part of 'Walk'"),
        (" like Ada", "without spaces"),
        ("", "expected words such as 'like Ada'"),
    ],
)
def test_words_that_ask_for_something_already_name_nobody(
    trained: Run, tmp_path: Path, manner: str, message: str
) -> None:
    """A person called "walk" would walk wherever a sentence says so, and all others would not be as before."""
    with pytest.raises(ConfigError, match=message):
        personal_run(trained, tmp_path / "ada", manner)
    assert not (tmp_path / "ada").exists()


def test_a_folder_keeps_the_training_that_it_began_from(trained: Run, tmp_path: Path) -> None:
    run = personal_run(trained, tmp_path / "ada", "like Ada")
    assert run.before().folder == trained.folder.resolve()
    assert not (run.folder / "before").readlink().is_absolute()  # both may be moved together
    copytree(trained.folder, tmp_path / "other")
    with pytest.raises(ConfigError, match="holds a personalisation of .*; use another folder"):
        personal_run(Run(tmp_path / "other"), tmp_path / "ada", "like Ada")
