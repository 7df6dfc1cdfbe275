"""Metrics of a trained model, of real motion and of a motionless pose."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import Bundle
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training import evaluate
from flexmotion.training.evaluator_task import EvaluatorTask
from flexmotion.training.processes import Processes
from flexmotion.training.run import Run


def test_evaluation(trained: Run, bundle: Bundle, stages, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # A copy: other tests share the run, and it has no evaluator.
    run = Run(Path(copytree(trained.folder, tmp_path / "run")))
    encode = SentenceEncoder(run.stage("text"))
    stages.train(run, "evaluator", EvaluatorTask(run.config, run.store(), encode, run.seed, Processes()))
    monkeypatch.setattr(evaluate, "PHYSICAL", 1)
    monkeypatch.setattr(evaluate, "TEXTS", 2)
    monkeypatch.setattr(evaluate, "NEIGHBOURS", 64)
    judge = evaluate.Judge(run, bundle.body, 64)
    real, model, still = (
        judge.measure(generator) for generator in (judge.real, judge.sampled(Sampler(bundle)), judge.motionless)
    )
    assert set(real) == set(model) and {"fid", "contact_force", "jerk_join", "skate_ratio"} <= set(real)
    assert still["fid"].mean > real["fid"].mean > 0.0 and real["fid"].half_width > 0.0
    assert still["multimodality"].mean == pytest.approx(0.0, abs=1e-6)
    assert model["jerk_join"].half_width > 0.0
    assert judge.nearest()(0, 0).shape == judge.real(0, 0).shape
