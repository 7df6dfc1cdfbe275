"""What counts as a kind of motion that the robot did."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot.kinds import Ran, Task, figures_of, judged_of, made_by_pace, main, run
from benchmarks.robot.model_run import sampler_of
from benchmarks.shared.robot_judge import Done, deciding
from benchmarks.shared.robot_motion import SAMPLED_HZ, Part
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.repertoire import FILE
from flexmotion.configs.robot import ROBOTS, load_robot
from flexmotion.streamer.motion.robot_pace import human_pace

T = np.arange(round(6 * SAMPLED_HZ)) / SAMPLED_HZ
UP = np.clip(T - 1.0, 0.0, 1.0)[:, None]
"""A part that leaves the stand after a second, and is there after another."""
NOD = np.clip(T - 1.0, 0.0, 0.2)[:, None] * (1.0 + np.sin(9.0 * T))[:, None]


def test_a_part_that_does_not_move_or_moves_another_way_is_not_done() -> None:
    human = UP * [0.0, 1.0, 1.0]
    for robot in (0.0 * human, UP * [1.0, 0.0, 0.0], UP * [0.0, 0.0, 2.0], 0.3 * human, -human):
        assert not Done.of(Part(human, robot), has_strokes=False).makes
    for robot in (human, 0.6 * human, 1.5 * human, UP * [0.4, 1.0, 0.8]):
        assert Done.of(Part(human, robot), has_strokes=False).makes


def test_the_lag_of_a_robot_is_none_of_its_motion() -> None:
    """Nods of two a second would be their own opposite a quarter of a second later."""
    late = np.concatenate([np.zeros((8, 1)), NOD[:-8]])
    found = Done.of(Part(NOD, late), has_strokes=True)
    assert found.makes and found.like == pytest.approx(1.0)


def test_a_hand_that_is_up_and_still_does_not_wave() -> None:
    wave = UP * [1.0, 0.0] + (T[:, None] > 2.0) * 0.2 * np.sin(9.0 * T)[:, None] * [0.0, 1.0]
    still = UP * [1.0, 0.0]
    assert Done.of(Part(wave, still), has_strokes=False).makes
    assert not deciding("wave-right-hand", {"arm": Part(wave, still)}).makes
    assert deciding("wave-right-hand", {"arm": Part(wave, 0.7 * wave)}).makes


def test_an_answer_with_head_or_hand_is_done_by_one_of_them() -> None:
    assert deciding("respond", {"head": Part(NOD, 0.0 * NOD), "arm": Part(NOD, NOD)}).makes


def test_a_head_that_ducks_over_straight_legs_was_a_crouch() -> None:
    """One part of several decided, whichever it was."""
    made, missed = Part(UP, UP), Part(UP, 0.0 * UP)
    assert deciding("crouch", {"head": missed, "leg": made}).makes
    assert not deciding("crouch", {"head": made, "leg": missed}).makes


def test_a_walked_turn_was_judged_by_its_heading_alone() -> None:
    """A robot that turned on the spot, or walked off another way, did it."""
    turn, way = Part(UP, UP), UP * [1.0, 2.0]
    assert deciding("walk-turn-left", {"turn": turn, "way": Part(way, way)}).makes
    for robot in (0.0 * way, 0.3 * way, way * [1.0, -1.0]):
        assert not deciding("walk-turn-left", {"turn": turn, "way": Part(way, robot)}).makes
    assert not deciding("walk-turn-left", {"turn": Part(UP, 0.0 * UP), "way": Part(way, way)}).makes


def test_the_way_of_a_walked_turn_was_left_out() -> None:
    done = run(Task("walk-turn-left", 2000, "op3"), None)
    assert done.makes and done.done.share < 0.95 < done.done.like, "the worse of both is the way"


def test_a_run_at_a_walking_pace_was_told_as_a_run() -> None:
    """Run, dash and walk had the same figures: the human was slowed to OP3's pace, and only the way was compared."""
    sampler, op3 = sampler_of(None), load_robot("op3")
    pace = human_pace(op3, sampler.body)
    found = {words: made_by_pace(sampler, words, pace) for words in ("run forward", "dash", "walk", "turn left", "nod")}
    assert found == {"run forward": "walk", "dash": "walk", "walk": None, "turn left": None, "nod": None}
    assert made_by_pace(sampler, "run forward", None) is None
    done = Done.of(Part(UP, UP), has_strokes=False)
    assert figures_of([Ran("run", 0, True, done, "walk")])["run"]["done_as"] == "walk"
    assert op3.repertoire is not None and op3.repertoire.done_as == {"run": "walk", "dash": "walk"}


def test_one_kind_written_at_an_unjudged_robot_took_all_others_away(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ROBOTS / "op3", tmp_path / "op3"))
    (folder / FILE).unlink()
    with pytest.raises(ConfigError, match="would refuse every other kind; judge all first: python -m benchmarks") as no:
        main(str(folder), seeds=1, kind=["nod"], write=True)
    assert f"robot/kinds --robot {folder} --write" in str(no.value) and not (folder / FILE).exists()


def test_a_robot_that_falls_has_done_nothing() -> None:
    done = Done.of(Part(UP, UP), has_strokes=False)
    figures = figures_of([Ran("bow", 0, True, done), Ran("bow", 1, False, done)])
    assert figures["bow"]["did"] == 0.5 and not judged_of(figures)["bow"].passed


def test_a_tilt_of_a_head_that_only_turns_and_nods_is_not_done() -> None:
    """A tilt of OP3's head was taken for done: no judge looked at the robot."""
    found = run(Task("tilt-head-right", 0, "op3"), None)
    assert found.upright and not found.makes and found.done.share < 0.1
