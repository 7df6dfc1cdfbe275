"""What counts as a kind of motion that the robot did."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.robot.kinds import Ran, Task, figures_of, judged_of, run
from benchmarks.shared.robot_judge import Done, best
from benchmarks.shared.robot_motion import SAMPLED_HZ, Part

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
    assert not best("wave-right-hand", {"arm": Part(wave, still)}).makes
    assert best("wave-right-hand", {"arm": Part(wave, 0.7 * wave)}).makes


def test_a_kind_of_several_parts_is_done_by_one_of_them() -> None:
    assert best("crouch", {"head": Part(UP, 0.0 * UP), "leg": Part(UP, UP)}).makes


def test_a_robot_that_falls_has_done_nothing() -> None:
    done = Done.of(Part(UP, UP), has_strokes=False)
    figures = figures_of([Ran("bow", 0, True, done), Ran("bow", 1, False, done)])
    assert figures["bow"]["did"] == 0.5 and not judged_of(figures)["bow"].passed


def test_a_tilt_of_a_head_that_only_turns_and_nods_is_not_done() -> None:
    """A tilt of OP3's head was taken for done: no judge looked at the robot."""
    found = run(Task("tilt-head-right", 0, "op3"), None)
    assert found.upright and not found.makes and found.done.share < 0.1
