"""The configuration `paper`: clips of two seconds without history, through the same stages."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.training.export import export
from flexmotion.training.run import Run


def test_paper_goes_through_the_same_stages(small_set: Path, paper_config: Path, stages, tmp_path: Path) -> None:
    run = Run(tmp_path / "paper", str(paper_config))
    assert run.store(small_set).layout.fps == 20.0
    stages.copy_text(run)
    stages.train(run, "autoencoder", stages.autoencoder(run), 2)
    stages.train(run, "diffusion", stages.diffusion(run), 2)
    sampler = Sampler(export(run, tmp_path / "bundle", distilled=False), steps=3)
    clip = sampler.sample(sampler.standing(), Condition("walk forward"), 0)
    assert len(clip) == run.config.window.future
