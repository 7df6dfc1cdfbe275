"""The table of conditions: what is asked, what is kept of it, and what a model without a branch cannot follow."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.features.constraint_layout import FORCES, PLACES, TORQUE_LIMITS, window_values
from flexmotion.features.layout import POINTS
from flexmotion.sampling.sampler import Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training import evaluate
from flexmotion.training.condition_rows import CONDITIONS, NONE, ConditionRows
from flexmotion.training.evaluator_task import EvaluatorTask
from flexmotion.training.processes import Processes
from flexmotion.training.run import Run

if TYPE_CHECKING:
    from flexmotion.bundles.bundle import Bundle
    from tests.flexmotion.training.conftest import Stages

JOINT = "1 joint"


@pytest.fixture(scope="module")
def rows(trained: Run, bundle: Bundle, stages: Stages, tmp_path_factory: pytest.TempPathFactory) -> ConditionRows:
    # A copy: other tests share the run, and it has no evaluator.
    run = Run(Path(copytree(trained.folder, tmp_path_factory.mktemp("evaluated") / "run")))
    encode = SentenceEncoder(run.stage("text"))
    stages.train(run, "evaluator", EvaluatorTask(run.config, run.store(), encode, run.seed, Processes()))
    return ConditionRows(evaluate.Judge(run, bundle.body, 64), Sampler(bundle), seed=1)


def test_values_of_the_clip_itself_are_asked(rows: ConditionRows) -> None:
    clip = window_values(rows._judge.real(3, 0).astype(np.float64), rows._judge.layout, np)
    for name in CONDITIONS:
        if "muscle" in name:  # the small set has none
            with pytest.raises(ValueError, match="has no activations"):
                rows.asked(name, 3)
            continue
        asked = rows.asked(name, 3)
        assert asked.mask.any()
        np.testing.assert_array_equal(asked.values[asked.mask], clip[asked.mask])
        assert not asked.mask[:, asked.layout.blocks[TORQUE_LIMITS]].any()
        np.testing.assert_array_equal(asked.mask, rows.asked(name, 3).mask)


def test_conditions_ask_for_as_much_as_they_say(rows: ConditionRows) -> None:
    layout = rows._layout
    one, every = (rows.asked(name, 0).mask for name in (JOINT, f"{len(POINTS)} joints"))
    assert one.sum(axis=1).tolist() == [3] * len(one)
    assert every[:, layout.blocks[PLACES]].all()
    assert rows.asked("contact force with place", 0).mask[:, layout.blocks[FORCES]].all()
    shares = [rows.asked(name, 0).mask.any(axis=1).sum() for name in ("1 % of frames, all", "20 % of frames, all")]
    assert shares == [1, round(0.2 * len(one))]


def test_a_told_joint_is_where_it_was_told_and_an_untold_one_is_not(
    rows: ConditionRows, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluate, "PHYSICAL", 1)
    monkeypatch.setattr(evaluate, "TEXTS", 1)
    monkeypatch.setattr(evaluate, "SAMPLES", 2)
    made = dict(rows.rows([JOINT, "1 actuation"]))
    assert list(made) == [NONE, JOINT, "1 actuation"]
    joint, actuation = made[JOINT], made["1 actuation"]
    assert not isinstance(joint, str) and not isinstance(actuation, str)
    assert joint["place_cm"].mean < 0.5 * joint["place_cm_untold"].mean
    assert 0.0 <= joint["trajectory_error"].mean <= joint["trajectory_error_untold"].mean <= 1.0
    assert {"fid", "diversity", "contact_force"} <= set(joint) and "place_cm" not in actuation
    assert actuation["torque"].mean > 0.0


def test_what_a_model_cannot_follow_is_said_and_not_measured(
    rows: ConditionRows, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluate, "PHYSICAL", 1)
    monkeypatch.setattr(evaluate, "TEXTS", 1)
    monkeypatch.setattr(evaluate, "SAMPLES", 2)
    rows._sampler.balanced, before = False, rows._sampler.balanced
    made = dict(rows.rows(["1 actuation", "20 muscles"]))
    rows._sampler.balanced = before
    assert made["20 muscles"] == "the model's motion has no activations"
    assert "has no control branch" in str(made["1 actuation"])
