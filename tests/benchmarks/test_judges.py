"""What the benchmarks count as a velocity, a wave, a sentence that is understood; and the prompts that they judge."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.model.prompts import CHECKS, judged_shares
from benchmarks.robot.prompts import RULES
from benchmarks.shared.gesture_judges import GESTURE_CHECKS
from benchmarks.shared.judges import at_least, confuses_sides, frame_velocities, reversals, understood, waves
from benchmarks.shared.prompts import gesture_kinds, prompt_kinds
from flexmotion.text.phrases import STAND, kinds
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sides import mirrored


def test_velocity_is_along_and_across_the_heading(circling) -> None:
    found = frame_velocities(circling(60, 0.8, -0.2, 0.9))
    np.testing.assert_allclose(found, np.tile([0.8, -0.2, 0.9], (59, 1)), atol=1e-9)


def test_reversals_are_counted_beyond_a_reach() -> None:
    """Went wrong: no reversal was counted in a signal with steps shorter than the reach, so slow waves were missed."""
    swing = 0.1 * np.sin(np.linspace(0.0, 4 * np.pi, 200))
    assert reversals(swing, 0.05) == 4
    assert reversals(swing, 0.25) == 0
    # Noise below the reach neither adds reversals nor hides them.
    assert reversals(swing + 0.01 * np.random.default_rng(0).uniform(-1, 1, 200), 0.05) == 4
    assert reversals(np.linspace(0.0, 1.0, 50), 0.05) == 0


@pytest.mark.parametrize(("raised", "wave"), [(60, True), (4, False), (0, False)])
def test_only_a_raised_hand_waves(raised: int, wave: bool) -> None:
    hand = np.zeros((60, 3))
    hand[:, 1] = 0.1 * np.sin(np.linspace(0.0, 6 * np.pi, 60))
    assert waves(hand, np.arange(60) < raised, 0.05, fewest=5) == wave
    assert not waves(hand, np.arange(60) < raised, 0.3, fewest=5)


def test_signed_limits() -> None:
    assert at_least(0.5, 0.4) and not at_least(0.3, 0.4)
    assert at_least(-0.5, -0.4) and not at_least(-0.3, -0.4) and not at_least(0.5, -0.4)


def test_kinds_that_count_as_one_another() -> None:
    assert understood("run", "dash") and understood("dash", "run")
    assert understood(NOTHING, STAND) and understood(STAND, NOTHING)
    assert not understood("walk", "run") and not understood("walk", STAND)


def test_sides_are_confused_only_where_both_have_one() -> None:
    assert confuses_sides("walk-left", "walk-right") and confuses_sides("wave-right-hand", "walk-left")
    assert not confuses_sides("walk-left", "walk-turn-left") and not confuses_sides("walk-left", "walk")


def test_every_check_of_a_prompt_is_known() -> None:
    """A robot has no rule for a bow, and stays where it is if it stays up."""
    named = {name for entry in prompt_kinds() for name in entry.check}
    assert named == set(CHECKS) - set(GESTURE_CHECKS)
    assert {name for entry in gesture_kinds() for name in entry.check} == set(GESTURE_CHECKS)
    assert {entry.kind for entry in gesture_kinds()} <= {*kinds(), *map(mirrored, kinds())}
    assert named - set(RULES) == {"leans", "stays"}
    moving = {entry.kind for entry in prompt_kinds() if entry.moves}
    assert {"walk forward", "turn left", "step right"} <= moving and not {"bow", "stand", "wave left"} & moving
    assert len({entry.kind for entry in prompt_kinds()}) == len(prompt_kinds()) == 18


def test_kinds_of_untaught_sentences_exist() -> None:
    from benchmarks.model.hearing import untaught_sentences

    assert set(untaught_sentences()) <= {*kinds(), NOTHING}


def test_kinds_that_a_bundle_refuses_do_not_count_against_it(capsys: pytest.CaptureFixture[str]) -> None:
    """The shipped bundle failed by clapping, which it refuses by name: the kept figure was of the bundle before."""
    shares = {"walk": 1.0, "bow": 0.95, "clap": 0.07}
    assert [verdict.holds for verdict in judged_shares(shares, ["walk", "bow"], 20, 1000).verdicts] == [True, True]
    assert "not offered, 1: clap (7 %)" in capsys.readouterr().out
    assert [verdict.holds for verdict in judged_shares(shares, list(shares), 20, 1000).verdicts] == [False, False]
    told = judged_shares({"walk": 1.0, "nonsense": 1.0}, ["walk", "nonsense"], 20, 0).verdicts[0].sentence
    assert told.startswith("done: 100.0 % of 1 kinds"), "nonsense is not counted as a kind"
    assert [one.holds for one in judged_shares({"walk": 1.0, "bow": 0.84}, ["walk", "bow"], 20, 0).verdicts] == [
        False,
        False,
    ]
