"""Metrics of a trained model, of real motion and of a motionless pose."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import Bundle
from flexmotion.dataset.compact_set import open_set
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training import evaluate
from flexmotion.training.evaluator_task import EvaluatorTask
from flexmotion.training.processes import Processes
from flexmotion.training.run import Run


def test_evaluation(
    trained: Run, bundle: Bundle, small_set: Path, stages, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # A copy: other tests share the run, and it has no evaluator.
    run = Run(Path(copytree(trained.folder, tmp_path / "run")))
    encode = SentenceEncoder(run.stage("text"))
    stages.train(run, "evaluator", EvaluatorTask(run.config, run.store(), encode, run.seed, Processes()))
    monkeypatch.setattr(evaluate, "PHYSICAL", 1)
    monkeypatch.setattr(evaluate, "TEXTS", 2)
    monkeypatch.setattr(evaluate, "NEIGHBOURS", 64)
    judge = evaluate.Judge(run, bundle.body, 64)
    sampler = Sampler(bundle)
    real, still = (judge.measure(generator) for generator in (judge.real, judge.motionless))
    model = judge.measure(judge.sampled(sampler), judge.delivered(sampler))
    assert set(real) < set(model) and {"fid", "contact_force", "residual_force", "zmp_outside"} <= set(real)
    delivered = {"delivered_residual_force", "delivered_euler_force", "moved_by_planting", "moved_by_projection"}
    assert delivered <= set(model) - set(real)
    assert still["fid"].mean > real["fid"].mean > 0.0 and real["fid"].half_width > 0.0
    assert still["multimodality"].mean == pytest.approx(0.0, abs=1e-6)
    assert model["jerk_join"].half_width > 0.0
    # The features of a run are in half precision, whose rounding is a residual of its own.
    exact = evaluate.Judge(run, bundle.body, 64, source=open_set(small_set))
    rounded = judge.real(0, 0)
    assert exact.real(0, 0) == pytest.approx(rounded, abs=0.02)
    assert not np.array_equal(exact.real(0, 0), rounded)
    np.testing.assert_array_equal(exact.real(10, 0), judge.real(10, 0))
    assert judge.nearest()(0, 0).shape == judge.real(0, 0).shape
