"""A gesture beside another motion, before and after a rest of the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.kinematics import forward
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Intent, Text, Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item

RAISED = Text("raise your right hand")


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


def rested(sampler: Sampler, before: Intent, after: Intent) -> np.ndarray:
    """How far the right hand is above its shoulder in the second after a rest of the robot of one second [m]."""
    source = ModelSource(sampler, [Item(0.0, before)], "rests", 1)
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
