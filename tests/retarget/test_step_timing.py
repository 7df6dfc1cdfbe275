from __future__ import annotations

import numpy as np
import pytest

from flexmotion.human.motion import Motion
from flexmotion.retarget.human import Swing
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.step_timing import StepTiming
from flexmotion.retarget.view import HumanView

from .conftest import RATE, Views


@pytest.fixture
def timing(retargeter: Retargeter) -> StepTiming:
    return StepTiming(retargeter.gait, retargeter.swings, RATE)


@pytest.fixture
def walking(view: Views, walk: Motion) -> HumanView:
    return view(walk)


def test_the_foot_that_landed_rests_longer_than_the_other(timing: StepTiming, retargeter: Retargeter) -> None:
    pause = round(retargeter.gait.double_support_min_s * RATE)
    assert pause < round(0.3 * RATE)
    for side in (0, 1):
        free, landed_by = timing.free(side, 1000.0), timing.landed_by(side, 1000)
        assert free[side] == 1000 + round(0.3 * RATE) and free[1 - side] == 1000 + pause
        np.testing.assert_array_equal(landed_by, 2000 - free)


def test_the_foot_that_landed_rests_longer_also_where_a_robot_pauses_for_long(retargeter: Retargeter) -> None:
    """Regression: with a pause of .3 s or more a stop moved the foot that had landed last, as if it were the other."""
    for pause_s in (0.3, 0.5):
        gait = retargeter.gait.model_copy(update={"double_support_min_s": pause_s})
        slow = StepTiming(gait, retargeter.swings, RATE)
        assert [int(np.argmax(slow.free(side, 1000.0))) for side in (0, 1)] == [0, 1]


@pytest.mark.parametrize("delay_s", [0.29, 0.31])
def test_a_step_is_left_out_once_the_human_landed_long_ago(
    timing: StepTiming, walking: HumanView, delay_s: float
) -> None:
    swing = walking.window.swings[0]
    lift = walking.tick_at(swing.land_s) + round(delay_s * RATE)
    assert timing.is_too_late(walking, swing, lift) == (delay_s > 0.3)
    unfinished = Swing(swing.side, swing.lift_s, swing.land_s, landed=False)
    assert not timing.is_too_late(walking, unfinished, lift)


def test_a_step_lands_with_the_human_or_a_little_later_in_its_double_support(
    timing: StepTiming, walking: HumanView
) -> None:
    first, second, *_, last = walking.window.swings
    human, following = walking.tick_at(first.land_s), walking.tick_at(second.lift_s)
    for pause, later in ((0, 8), (following - human - 3, 3), (following - human + 1, 0)):
        timing.pause = pause
        assert timing.landing(walking, first, human - 100) == human + later
    # After the last swing there is no double support to take from.
    assert timing.landing(walking, last, walking.tick_at(last.land_s) - 100) == walking.tick_at(last.land_s)


def test_a_step_lasts_at_least_the_shortest_swing(
    timing: StepTiming, walking: HumanView, retargeter: Retargeter
) -> None:
    swing = walking.window.swings[0]
    lift = walking.tick_at(swing.land_s)
    assert timing.landing(walking, swing, lift) == lift + np.ceil(retargeter.swings.least_s * RATE)


def test_a_swing_without_a_landing_is_assumed_to_last_a_while(timing: StepTiming, view: Views, walk: Motion) -> None:
    cut = view(walk[:42])
    (swing,) = cut.window.swings
    assert not swing.landed
    land = timing.landing(cut, swing, cut.tick_at(swing.lift_s))
    assert land >= cut.tick_at(cut.window.end_s)
    assert (land - cut.tick_at(swing.lift_s)) / RATE == pytest.approx(0.42, abs=0.01)
