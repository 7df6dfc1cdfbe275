"""Figures of the benchmarks of the model, on motion whose answer is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.model import long_horizon
from benchmarks.model.agreement import apart
from benchmarks.model.long_horizon import Run, around, frozen_share, prompts, spanning
from benchmarks.model.roll_out import RollOut
from benchmarks.model.window_distance import mean_distance, nearest_distance, windows_of
from flexmotion.configs.errors import ConfigError
from flexmotion.human.body import Body


def test_windows_do_not_depend_on_place_and_heading(circling) -> None:
    walk = circling(80, 1.0, 0.0, 0.5)
    windows = windows_of(walk, walk.body, 32, 16)
    assert windows.shape == (4, 8 * 16 * 3)
    np.testing.assert_allclose(windows - windows[:1], 0.0, atol=1e-5)
    # Root mean square over frames of a body that is further ahead by .3 m/s.
    faster = windows_of(circling(32, 1.3, 0.0, 0.0), walk.body, 32, 32)
    slower = windows_of(circling(32, 1.0, 0.0, 0.0), walk.body, 32, 32)
    expected = 0.3 * np.sqrt(np.mean((np.arange(0, 32, 4) / 30) ** 2)) / walk.body.leg
    assert nearest_distance(faster, slower)[0] == pytest.approx(expected, rel=1e-3)


def test_windows_do_not_depend_on_the_body(circling) -> None:
    walk = circling(32, 1.0, 0.0, 0.5)
    child = Body(height=1.2, mass=25.0)
    smaller = replace(walk, body=child, root_position=walk.root_position * child.leg / walk.body.leg)
    np.testing.assert_allclose(windows_of(smaller, walk.body, 32, 32), windows_of(walk, walk.body, 32, 32), atol=1e-6)


def test_nearest_and_mean_distance() -> None:
    rng = np.random.default_rng(0)
    windows, among = (rng.normal(size=(count, 6)).astype(np.float32) for count in (5, 40))
    distance = np.linalg.norm(windows[:, None] - among, axis=-1)
    np.testing.assert_allclose(nearest_distance(windows, among), distance.min(axis=1), atol=1e-5)
    assert mean_distance(np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0]], np.float32)) == pytest.approx(10 / 3)


def test_distance_of_two_plans(circling) -> None:
    here, there = circling(40, 0.0, 0.0, 0.3), circling(40, 0.0, 0.0, 0.3)
    there = replace(there, root_position=there.root_position + [0.03, 0.04, 0.0])
    np.testing.assert_allclose(apart(here, there, 30, 30), [0.05, 0.05, 0.0], atol=1e-6)
    assert apart(here, here, 30, 20)[2] == pytest.approx(np.degrees(0.1), abs=1e-6)


def test_jerk_at_joins(circling) -> None:
    """A jump between frames 49 and 50 is in the three third differences that span it, and in no other."""
    motion = circling(100)
    jump = np.where(np.arange(100) >= 50, 0.01, 0.0)[:, None] * [1.0, 0.0, 0.0]
    made = RollOut(replace(motion, root_position=motion.root_position + jump), np.array([50]), np.array([False]))
    change = around(made, cued=False)[0]
    assert (np.flatnonzero(change > 1e-3) - 12).tolist() == [-3, -2, -1]
    marked = spanning(97, made.joins)
    assert np.flatnonzero(marked).tolist() == [47, 48, 49]


def test_a_body_is_frozen_after_a_prompt_to_move(circling) -> None:
    still, going = circling(240), circling(240, 0.5)
    no_joins = (np.zeros(0, np.intp), np.zeros(0, np.bool_))
    asked = ("walk forward", "stand still")
    assert frozen_share(Run(asked, RollOut(still, *no_joins)), every=4.0) == 1.0
    assert frozen_share(Run(asked, RollOut(going, *no_joins)), every=4.0) == 0.0
    assert frozen_share(Run(("stand still", "bow"), RollOut(still, *no_joins)), every=4.0) == 0.0
    texts = prompts(3, 120.0, 4.0)
    assert len(texts) == 30 and all(one != two for one, two in zip(texts, texts[1:], strict=False))


def test_a_set_without_held_out_clips_is_refused(circling, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Went wrong: it ended in an IndexError once all roll-outs were made."""

    class Walker:
        fps = 30.0

        def prompt(self, text: str) -> SimpleNamespace:
            return SimpleNamespace(kind=text)

    run = Run(("walk forward",), RollOut(circling(60, 1.0), np.zeros(0, np.intp), np.zeros(0, np.bool_)))
    monkeypatch.setattr(long_horizon, "open_sampler", lambda _bundle, _steps: Walker())
    monkeypatch.setattr(long_horizon, "rolled_out", lambda *_arguments: ([run], 0))
    monkeypatch.setattr(long_horizon, "open_set", lambda _folder: None)
    monkeypatch.setattr(long_horizon, "real_clips", lambda *_arguments, **_kinds: iter(()))
    with pytest.raises(ConfigError, match="no held-out clips"):
        long_horizon.main(tmp_path)
