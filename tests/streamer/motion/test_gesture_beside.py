"""A gesture beside another motion, before and after a rest of the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.gesture_beside import GestureBeside
from flexmotion.streamer.motion.intents import Intent, Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.targets import Target

from ...standing_human import standing

RAISED = Text("raise your right hand")


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


def rested(sampler: Sampler, before: Intent, after: Intent) -> np.ndarray:
    """How far the right hand is above its shoulder in the second after a rest of the robot of one second [m]."""
    source = ModelSource(sampler, (), "rests", 1)
    source.steer(before)
    assert source.window(0, 60) is not None
    source.change(after, 89, None, 0.0)
    motion = source.window(90, 30)
    assert motion is not None
    human = forward(motion)
    return np.asarray(human.wrist[:, 1, 2] - human.shoulder[:, 1, 2])


def test_a_gesture_began_anew_from_a_hanging_arm_after_every_rest_of_a_measured_turn(sampler: Sampler) -> None:
    """With "turn left 90 degrees with your hands on your hips" the hands left the hips in mid-turn."""
    turns, faces = Velocity(0.0, 0.0, 0.5, beside=RAISED), Text("stand still", beside=RAISED)
    assert rested(sampler, turns, faces).min() > 0.0, "the hand stays up"
    assert rested(sampler, replace(turns, beside=None), faces)[:5].max() < 0.0, "that of a new gesture hangs"


def test_an_arm_was_lowered_as_fast_as_its_servos_could_after_a_gesture_on_the_way(sampler: Sampler) -> None:
    """The robot had held it up while it rested, and its human stood with a hanging arm."""
    up = rested(sampler, Velocity(0.3, 0.0, 0.0, beside=RAISED), Text("stand still"))
    assert up[0] > 0.0 and up[-1] < up[0] and np.abs(np.diff(up)).max() < 0.1


class Forgetful:
    """A source of a gesture that gives no frame that it was told to forget."""

    def __init__(self, human: Motion) -> None:
        self.human, self.dropped = human, 0

    def drawn(self, first: int, last: int) -> Motion:
        assert first >= self.dropped - 2
        return self.human[: last - first]

    def forget(self, before: int) -> None:
        self.dropped = max(before, 0)


def test_a_gesture_goes_on_where_it_was_made_up_to_and_for_the_same_words_alone() -> None:
    gesture = GestureBeside(RAISED, 40, "raise-up-right-hand", Forgetful(standing(4.0)))
    assert gesture.goes_on(RAISED, 40) and not gesture.goes_on(RAISED, 41)
    gesture.window(40, 32)
    assert gesture.goes_on(RAISED, 72) and gesture.goes_on(RAISED, 50), "also where a target cuts the motion"
    assert not gesture.goes_on(RAISED, 73) and not gesture.goes_on(RAISED, 39)
    assert not gesture.goes_on(Text("wave"), 72)


def test_a_rest_changes_no_gesture_of_a_plan_that_is_given_up() -> None:
    """It was shifted in place: after `Undo` the old plan's gesture was a second late."""
    gesture = GestureBeside(RAISED, 0, "raise-up-right-hand", Forgetful(standing(4.0)))
    gesture.window(0, 32)
    later = gesture.after_rest(60)
    assert later.goes_on(RAISED, 60) and not gesture.goes_on(RAISED, 60)
    assert later.first == 28 and gesture.first == 0


def test_frames_are_kept_as_long_as_the_walk_s_own(sampler: Sampler) -> None:
    """They were dropped by how far the walk was sampled ahead: a target soon after a long window ended the planner."""
    source = ModelSource(sampler, (), "long", 1)
    source.steer(Text("walk", beside=Text("wave")))
    made = source.window(0, 100)
    assert made is not None
    source.turn_to(Target(1, 1, Text("walk while waving")), 20, made[11:21])
    assert source.window(21, 60) is not None
    for first in range(81, 600, 30):
        assert source.window(first, 30) is not None
    assert len(source._gesture._source._pieces) < 10, "old frames of the gesture are dropped too"  # type: ignore[union-attr]


def test_the_first_window_takes_one_sample_of_each_human(sampler: Sampler, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gesture's human was sampled two windows ahead, for forces that nobody used: 44 ms instead of 29."""
    taken = []
    extend = Sampler.extend
    monkeypatch.setattr(Sampler, "extend", lambda self, *of: taken.append(1) or extend(self, *of))
    source = ModelSource(sampler, (), "first", 1)
    source.steer(Text("walk", beside=Text("wave")))
    assert source.window(0, 20) is not None
    assert len(taken) == 2
