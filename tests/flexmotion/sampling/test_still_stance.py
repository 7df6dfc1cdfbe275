"""Pelvis and legs of a human that stands stay as they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.bundles.bundle import Bundle
from flexmotion.evaluation.motions import jerk
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import foot_points, forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.sampling.still_stance import SETTLING_S, StillStance
from flexmotion.spatial.heading import heading
from flexmotion.spatial.tilt import tilt_of
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.motion.targets import Target


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


def tilted(motion: Motion, degrees: float) -> Motion:
    half = np.radians(degrees) / 2.0
    return replace(motion, root_quaternion=np.tile([np.cos(half), 0.0, np.sin(half), 0.0], (len(motion), 1)))


def turning(motion: Motion, speed: float) -> Motion:
    """With all of its body, by a speed about the vertical [rad/s]."""
    half = np.arange(len(motion)) * speed / motion.fps / 2.0
    turned = np.column_stack([np.cos(half), np.zeros((len(half), 2)), np.sin(half)])
    root = Rotation.from_quat(turned, scalar_first=True) * Rotation.from_quat(motion.root_quaternion, scalar_first=True)
    return replace(motion.kinematics, root_quaternion=root.as_quat(scalar_first=True))


def moving(motion: Motion, speed: float) -> Motion:
    """Along with its feet."""
    way = np.arange(len(motion))[:, None] * [speed / motion.fps, 0.0, 0.0]
    return replace(motion, root_position=motion.root_position + way)


def test_who_stands_on_both_feet_stands(make_standing: Callable[..., Motion]) -> None:
    rest = make_standing(1)
    assert StillStance.of(make_standing(10), rest) is not None
    assert StillStance.of(make_standing(1), rest) is None, "of one frame nobody knows whether it moves"
    assert StillStance.of(moving(make_standing(10), 0.3), rest) is None
    knee = {"hip_flexion_l": 0.8, "knee_flexion_l": 1.0}
    assert StillStance.of(make_standing(10, **knee), rest) is None, "a foot is in the air"


def test_nobody_is_left_bowed_or_in_half_a_squat(make_standing: Callable[..., Motion]) -> None:
    """A stand that was asked at the bottom of a bow stayed bowed by 18 degrees."""
    rest = make_standing(1)
    assert StillStance.of(tilted(make_standing(10), 18.0), rest) is None
    bent = {f"{joint}_{side}": angle for side in "lr" for joint, angle in (("hip_flexion", 0.5), ("knee_flexion", 1.0))}
    assert StillStance.of(make_standing(10, **bent), rest) is None


def test_a_pelvis_that_leans_under_an_upright_trunk_stands(make_standing: Callable[..., Motion]) -> None:
    """People whose pelvis leaned by 18 degrees, under a trunk by 8, stood as sampled: they trembled in a nod."""
    angle = np.radians(17.0)
    legs = {f"hip_flexion_{side}": angle for side in "lr"}
    rest = make_standing(1)
    assert StillStance.of(tilted(make_standing(10, lumbar_extension=angle, **legs), 17.0), rest) is not None
    assert StillStance.of(tilted(make_standing(10, **legs), 17.0), rest) is None, "it is bowed"


@pytest.mark.parametrize("upright", [True, False])
def test_a_pelvis_comes_upright_in_a_stand_and_stays_in_a_gesture(
    upright: bool, make_standing: Callable[..., Motion]
) -> None:
    past = tilted(make_standing(10), 6.0)
    stance = StillStance.of(past, make_standing(1))
    assert stance is not None
    window = stance.kept(tilted(make_standing(120), 3.0), upright=upright)
    assert np.degrees(tilt_of(window.root_quaternion[-1])) == pytest.approx(0.0 if upright else 6.0, abs=0.1)
    assert np.linalg.norm(window.root_quaternion, axis=1) == pytest.approx(1.0)


def test_what_still_moves_stops_on_its_way(make_standing: Callable[..., Motion]) -> None:
    past = moving(make_standing(10), 0.05)
    stance = StillStance.of(past, make_standing(1))
    assert stance is not None
    ahead = stance.kept(make_standing(60), upright=False).root_position[:, 0] - past.root_position[-1, 0]
    assert ahead.max() - ahead[-1] < 1e-4 and ahead[-1] == pytest.approx(2 * 0.05 * SETTLING_S, rel=0.01)


def test_a_human_that_stands_does_not_tremble(sampler: Sampler) -> None:
    """Points of the body jerked by 2.4 m/s³ in a stand, those of people by .3."""
    history = sampler.standing()
    for seed in (1, 2, 3):
        history = sampler.sample(history, Condition(), seed)
    assert jerk(history).mean() < 0.05
    assert np.ptp(foot_points(history), axis=0).max() < 5e-4


def test_feet_of_a_gesture_stay_where_they_are(sampler: Sampler) -> None:
    history = sampler.standing()
    before = foot_points(history[len(history) - 1 :])[0]
    for seed in (1, 2, 3):
        history = sampler.sample(history, Condition("wave with the right hand"), seed)
    assert np.abs(foot_points(history)[-1] - before).max() < 5e-3
    assert np.ptp(history.joints[:, 21:24], axis=0).max() > 0.1, "the arm waves"


def test_who_turns_a_little_as_it_comes_to_rest_stays_still(sampler: Sampler) -> None:
    """A pelvis that had turned by 3 degrees as it came to rest was turned back: legs trembled by 5 m/s³ in a nod."""
    stands = sampler.standing()[:1]
    history = turning(concatenate([stands] * 20), 0.2)
    source = ModelSource(sampler, [], "model:shipped")
    source.turn_to(Target(1, 1, Text("nod")), len(history) - 1, history)
    motion = source.window(len(history), 90)
    assert motion is not None
    headings = np.degrees(heading(motion.root_quaternion))
    assert 2.5 < headings[40] - np.degrees(heading(history.root_quaternion[-1])) < 5.0
    assert np.ptp(headings[40:]) < 0.1
    assert np.linalg.norm(np.diff(foot_points(motion[35:]), n=3, axis=0) * 30.0**3, axis=-1).mean() < 0.3


@pytest.mark.parametrize(
    "items",
    [
        [("walk forward", 3.0), ("nod", 6.0)],
        [("bow", 1.3), ("look down", 6.0)],
        [("walk backward", 3.0), ("clap", 6.0)],
    ],
)
def test_a_trunk_that_leans_comes_upright_in_a_gesture(items: list[tuple[str, float]], bundle: Path) -> None:
    """Robots that nodded after a walk or a bow leaned by 10 to 17 degrees for as long as they did."""
    starts = np.cumsum([0.0, *(seconds for _, seconds in items)])
    script = [Item(at, Text(text)) for (text, _), at in zip(items, starts[:-1].tolist(), strict=True)]
    motion = ModelSource(Sampler(Bundle(bundle)), script, "model:shipped").window(0, round(30 * starts[-1]))
    assert motion is not None
    torso = forward(motion[len(motion) - 5 :]).torso_rotation
    assert np.degrees(np.arccos(torso[:, 2, 2])).max() < 6.0


@pytest.mark.parametrize("balanced", [True, False])
def test_feet_stay_below_a_pelvis_that_comes_upright(balanced: bool, bundle: Path) -> None:
    """Of windows that are not balanced, which a robot follows, they slid by 15 cm after a bow."""
    sampler = Sampler(Bundle(bundle), balanced=balanced)
    source = ModelSource(sampler, [Item(0.0, Text("bow")), Item(2.5, Text("stand still"))], "model:shipped")
    motion = source.window(0, 300)
    assert motion is not None
    feet, tilt = foot_points(motion[180:]), np.degrees(tilt_of(motion.root_quaternion[180:]))
    upright = np.degrees(tilt_of(sampler.standing().root_quaternion[-1]))
    assert np.ptp(tilt) > 1.0 and tilt[-1] == pytest.approx(upright, abs=0.2)
    assert np.ptp(feet, axis=0).max() < 0.01 and np.abs(feet[..., 2]).max() < 0.02


def test_asked_to_walk_a_still_human_walks(sampler: Sampler) -> None:
    history = sampler.standing()
    for seed in (1, 2, 3):
        history = sampler.sample(history, Condition(velocity=(0.8, 0.0, 0.0)), seed)
    assert history.net_speed > 0.4
