"""What is told of a motion that had to be eased."""

from __future__ import annotations

from typing import Any, cast

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.retarget.easing import LEAST_PACE, LEAST_SIZE, WHOLE, Ease, Eased
from flexmotion.retarget.effort import Effort
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.planning.ease_notes import EASED, Degree, EaseNotes

ROBOT = load_robot("op3")
HARD = Effort(1.32, ROBOT.index("l_knee"), 25, 3.3, 2.5)
LEAST = Ease(LEAST_PACE, LEAST_SIZE)


class _Planned:
    """The part of a plan that notes read."""

    def __init__(self, seconds: float, ease: Ease, *, refused: bool = False, judged: bool = True) -> None:
        self.start_tick = round(seconds * ROBOT.rate_hz)
        self.eased = Eased(ease, 2, Effort(0.9), HARD, refused) if judged else None


def plan(seconds: float, ease: Ease, **rest: Any) -> Plan:
    return cast(Plan, _Planned(seconds, ease, **rest))


def test_each_further_degree_is_told_once_with_joint_and_moment() -> None:
    notes = EaseNotes(ROBOT)
    assert notes.of(plan(0.0, WHOLE)) is None
    slowed = notes.of(plan(1.0, Ease(0.8)))
    assert slowed is not None and slowed.degree is Degree.SLOWED
    assert slowed.message == (
        f"{EASED}80 % of its pace: l_knee needs 1.32 times its servo's envelope (3.30 N·m) at 1.20 s"
    )
    assert notes.of(plan(1.25, Ease(0.7))) is None
    smaller = notes.of(plan(1.5, Ease(LEAST_PACE, 0.75)))
    assert smaller is not None and "60 % of its pace and 75 % of its size" in smaller.message
    refused = notes.of(plan(1.75, LEAST, refused=True))
    assert refused is not None and refused.degree is Degree.REFUSED and refused.slowed is None
    assert "refused, the robot comes to a stand" in refused.message
    assert notes.of(plan(2.0, LEAST, refused=True)) is None


def test_it_is_told_again_after_the_motion_went_on_as_asked_for_a_while() -> None:
    notes = EaseNotes(ROBOT)
    assert notes.of(plan(1.0, Ease(0.8))) is not None
    assert notes.of(plan(1.5, WHOLE)) is None
    assert notes.of(plan(2.0, Ease(0.8))) is None
    assert notes.of(plan(4.5, WHOLE)) is None
    assert notes.of(plan(4.75, Ease(0.8))) is not None


def test_it_is_told_anew_for_a_new_target() -> None:
    notes = EaseNotes(ROBOT)
    assert notes.of(plan(1.0, Ease(0.8)), 3) is not None
    assert notes.of(plan(1.25, Ease(0.8)), 3) is None
    assert notes.of(plan(1.5, Ease(0.8)), 4) is not None


def test_plans_that_are_not_judged_tell_nothing() -> None:
    assert EaseNotes(ROBOT).of(plan(0.0, WHOLE, judged=False)) is None


@pytest.mark.parametrize(
    ("ease", "refused", "state"), [(Ease(0.8), False, "slowed"), (LEAST, False, "slowed"), (LEAST, True, "refused")]
)
def test_the_answer_to_a_target_says_so(ease: Ease, refused: bool, state: str) -> None:
    note = EaseNotes(ROBOT).of(plan(1.0, ease, refused=refused))
    assert note is not None
    answer = note.answer(Heard(id=7, asked="walk", state="accepted", heard_as="walk"))
    assert (answer.id, answer.state) == (7, state)
    told = answer.told()
    assert told is not None and "l_knee needs 1.32 times" in told
    assert (answer.failure is not None) is refused


def test_what_was_slowed_before_keeps_its_speed_in_the_answer() -> None:
    note = EaseNotes(ROBOT).of(plan(1.0, Ease(0.8)))
    assert note is not None
    answer = note.answer(Heard(id=7, asked="run", state="slowed", slowed="0.9 m/s", heard_as="run"))
    assert answer.state == "slowed" and answer.slowed == "0.9 m/s, 80 % of its pace"
