"""Conditions to what the shipped model's network is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import ConfigError
from flexmotion.evaluation.motions import jerk
from flexmotion.human.concatenate import concatenate
from flexmotion.sampling.condition import Condition
from flexmotion.sampling.pace import Pace
from flexmotion.sampling.request import Requests
from flexmotion.sampling.sampler import Sampler
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item


@pytest.mark.parametrize("turning", [0.5, -0.5])
def test_a_turn_on_the_spot_may_be_a_number_of_numpy(bundle: Path, turning: float) -> None:
    """A velocity of NumPy floats raised a TypeError: a comparison of them is no index of a tuple."""
    sampler = Sampler(Bundle(bundle))
    plain, numbers = ((kind(0.0), kind(0.0), kind(turning)) for kind in (float, np.float64))
    one, other = (sampler.features(sampler.standing(), Condition(velocity=each), seed=1) for each in (plain, numbers))
    np.testing.assert_array_equal(one, other)


def test_what_travels_is_known_from_measured_speeds(bundle: Path) -> None:
    """Without them a walk would count as done on the spot: its feet would be held, and the body brought over them."""
    opened = Bundle(bundle)
    requests = Requests(opened)
    spot, away = Condition(text="bow"), Condition(text="walk forward")
    assert requests.travels(away) and not requests.travels(spot) and not requests.travels(requests.meant(Condition()))
    assert requests.travels(Condition(velocity=(0.0, 0.0, 0.3))) and requests.travels(Condition(wordless=True))
    nothing = opened.manifest.corrections.model_copy(update={"speeds": {}})
    opened.manifest = opened.manifest.model_copy(update={"corrections": nothing})
    unknown = Requests(opened)
    assert unknown.travels(away) and unknown.travels(spot) and not unknown.travels(unknown.meant(Condition()))


def test_squats_are_as_slow_as_poses_that_are_held(bundle: Path) -> None:
    """Squats jerked by 20 m/s³, clips of their recipe by 2: the cut-off was that of walking."""
    sampler = Sampler(Bundle(bundle))
    slow = {
        text: sampler.requests.is_slow(sampler.meant(Condition(text))) for text in ("squat", "crouch", "bow", "walk")
    }
    assert slow == {"squat": True, "crouch": True, "bow": False, "walk": False}
    assert sampler.requests.is_slow(sampler.requests.held(sampler.meant(Condition("raise your right hand"))))
    windows = [sampler.standing()]
    for seed in (1, 2, 3, 4):
        windows.append(sampler.sample(concatenate(windows), Condition("squat"), seed))
    motion = concatenate(windows[1:])
    assert np.ptp(motion.root_position[:, 2]) > 0.3
    assert jerk(motion).mean() < 10.0


def test_a_kind_is_guided_at_its_own_scale(bundle: Path) -> None:
    """Regression: with one scale for all, poses went beyond people's, or bows and goodbyes were hardly made.

    A scale that is asked for comes first. Manners need more of it than the normal one. A velocity without words is kept
    by places: more guidance to words of walking back, which it is given, made it .55 m/s at any speed asked.
    """
    opened = Bundle(bundle)
    scales = {"guidance": {"bow": 2.0, "walk": 1.25}, "normal_guidance": 1.0}
    corrections = opened.manifest.corrections.model_copy(update=scales)
    opened.manifest = opened.manifest.model_copy(
        update={"guidance": 1.5, "manner_guidance": 1.25, "corrections": corrections}
    )
    requests = Requests(opened, unjudged=True)
    assert requests.guidance(Condition(text="bow")) == (2.0, 1.0)
    assert requests.guidance(Condition(text="bow", manner="proud")) == (2.0, 1.25)
    assert requests.guidance(Condition(text="raise your right hand")) == (1.5, 1.0)
    assert requests.guidance(Condition(text="walk forward")) == (1.25, 1.0)
    assert requests.guidance(Condition(velocity=(0.5, 0.0, 0.0))) == (1.5, 1.0)
    assert requests.guidance(Condition(text="walk forward", velocity=(0.5, 0.0, 0.0))) == (1.25, 1.0)
    assert requests.guidance(Condition(text="bow", guidance=1.0, manner_guidance=2.0)) == (1.0, 2.0)
    assert requests.guidance(Condition(wordless=True)) == (1.5, 1.0)
    with pytest.raises(ConfigError, match=r"guidance\.bow: unknown kind"):
        corrections.require_known({*corrections.speeds, "walk"}, opened.manners.names, "corrections.yaml")


def test_words_are_done_as_fast_as_people_do_them_in_their_manner(bundle: Path) -> None:
    """Regression: all walks were kept at 1.1 m/s: an old man hurried, and who was full of energy dawdled."""
    opened = Bundle(bundle)
    ways = {"old": {"walk": (0.8, 0.0, 0.0)}}
    speeds = {"speeds": {"walk": (1.2, 0.0, 0.0), "run": (3.0, 0.0, 0.0)}, "manner_speeds": ways}
    corrections = opened.manifest.corrections.model_copy(update=speeds)
    opened.manifest = opened.manifest.model_copy(update={"corrections": corrections})
    requests = Requests(opened, unjudged=True)

    def speed(**asked: Any) -> tuple[float, float, float] | None:
        return requests.own_velocity(requests.meant(Condition(**asked)))

    assert speed(text="walk forward") == (1.2, 0.0, 0.0) == speed(text="walk forward", manner="proud")
    assert speed(text="walk forward like an old man") == (0.8, 0.0, 0.0) == speed(text="walk forward", manner="old")
    assert speed(text="run like an old man") == (3.0, 0.0, 0.0)
    # Only what is faster than the robot keeps up with is slowed to it.
    pace = Pace(1.0, 0.5, 0.3, 1.0)
    assert speed(text="walk forward", pace=pace) == (1.0, 0.0, 0.0)
    assert speed(text="walk forward like an old man", pace=pace) == (0.8, 0.0, 0.0)
    corrections.require_known(["run", "walk", *corrections.guidance], ["old"], "corrections.yaml")
    with pytest.raises(ConfigError, match=r"manner_speeds\.old: unknown manner, expected one of: proud"):
        corrections.require_known(["run", "walk", *corrections.guidance], ["proud"], "corrections.yaml")


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.5])
def test_a_way_back_is_never_asked_for_with_the_words_of_walking_ahead(bundle: Path, speed: float) -> None:
    """Regression: a stick that was hardly pulled back sent the robot ahead by 15 cm."""
    sampler = Sampler(Bundle(bundle))
    source = ModelSource(sampler, [Item(0.0, Velocity(-speed, 0.0, 0.0))], "back", seconds=4.0)
    way = source.human().root_position[:, 0]
    assert way.max() < 0.05 and way[-1] == pytest.approx(-4.0 * speed, abs=0.35)
