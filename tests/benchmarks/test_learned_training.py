"""The training of the learned walk and the search for its gait go on exactly from where they were stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")
pytest.importorskip("cma", reason="the search needs the extra 'tune'")

from benchmarks.robot.learned import gait_search, training
from benchmarks.robot.learned.gait import Gait
from benchmarks.robot.learned.policy import Policy
from benchmarks.robot.learned.ppo import Batch, Learner
from benchmarks.robot.learned.training import POLICY, Training
from benchmarks.robot.learned.walk import ACTIONS, PRIVATE, SEEN
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def test_a_stopped_training_goes_on_as_if_it_had_not_been(
    op3: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "KEPT_EVERY", 1)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    Training(op3, Gait(), 1, whole, walks=2, steps=12).run(0.0, updates=3)
    for updates in (1, 2, 3):
        Training(op3, Gait(), 1, parts, walks=2, steps=12).run(0.0, updates=updates)
    one, other = Policy.load(whole / POLICY), Policy.load(parts / POLICY)
    for weight, same in zip(one.weights, other.weights, strict=True):
        np.testing.assert_array_equal(weight, same)
    np.testing.assert_array_equal(one.mean, other.mean)
    with pytest.raises(ConfigError, match="another gait"):
        Training(op3, replace(Gait(), lift=0.03), 1, parts, walks=2, steps=12)


def test_a_stopped_search_goes_on(op3: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gait_search, "POPULATION", 4)
    monkeypatch.setattr(gait_search, "SECONDS", 0.4)
    first = gait_search.search_gait(op3, tmp_path, 1e-6, 0)
    assert gait_search.search_gait(op3, tmp_path, 1e-6, 0) != first
    assert gait_search.search_gait(op3, tmp_path, 0.0, 0) != Gait()


def test_the_policy_turns_to_what_is_rewarded() -> None:
    """Actions above 0 of the first joint are rewarded: their mean rises."""
    learner, rng = Learner(0), np.random.default_rng(0)
    seen, private = rng.standard_normal((16, 8, SEEN)), rng.standard_normal((16, 8, PRIVATE))
    for _ in range(20):
        mean = learner.policy(Gait(), 0.2).act(seen)
        actions = mean + learner.deviation * rng.standard_normal((16, 8, ACTIONS))
        over = np.ones((16, 8), np.bool_)
        learner.update(Batch(seen, private, actions, actions[..., 0], over, over, np.zeros((16, 8))))
    assert learner.policy(Gait(), 0.2).act(seen)[..., 0].mean() > 0.1
