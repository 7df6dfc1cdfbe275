"""The embedded clip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexmotion.importers.default_clip
from flexmotion.configs.schema import load
from flexmotion.human.body import Body
from flexmotion.importers.default_clip import Script, build_clip, minimum_jerk

DATA = Path(flexmotion.importers.default_clip.__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def script() -> Script:
    return load(Script, DATA / "default_clip.yaml")


def test_the_shipped_file_is_that_of_the_keyframes(clip, script):
    built = build_clip(script, Body())
    assert (built.fps, built.body, built.source) == (clip.fps, clip.body, clip.source)
    for name in ("root_position", "root_quaternion", "joints"):
        np.testing.assert_allclose(getattr(clip, name), getattr(built, name), atol=1e-9)
    assert (DATA / "default.npz").stat().st_size < 64_000


def test_another_body_makes_another_clip(script):
    short = build_clip(script, Body(height=1.5))
    assert short.root_position[0, 2] < 0.81


def test_planted_feet_stay_in_place_and_level(clip, clip_kinematics, script):
    time = np.arange(len(clip)) / clip.fps
    for side, name in enumerate("lr"):
        planted = np.ones(len(clip), bool)
        for step in script.steps:
            if step.foot == name:
                planted &= (time < step.lift) | (time > step.land)
        heel, toe = clip_kinematics.heel[:, side], clip_kinematics.toe[:, side]
        assert np.abs(heel[planted, 2]).max() < 1e-3
        assert np.abs(toe[planted, 2]).max() < 1e-3
        stays = planted[1:] & planted[:-1]
        assert np.linalg.norm(np.diff(toe, axis=0), axis=1)[stays].max() < 2e-3
        assert clip_kinematics.heel[:, side, 2].max() >= 0.08


def test_the_body_is_over_its_feet(clip, clip_kinematics):
    """Standing and bowing the centre of mass projects into the soles, sideways and fore-aft."""
    standing = np.r_[0:225, 345 : len(clip)]
    com = clip_kinematics.com[standing, :2]
    heel, toe = clip_kinematics.heel[standing], clip_kinematics.toe[standing]
    assert (com[:, 0] > heel[..., 0].max(axis=1)).all()
    assert (com[:, 0] < toe[..., 0].min(axis=1)).all()
    assert np.abs(com[:, 1]).max() < 0.06


def test_it_waves_bows_and_walks(clip, clip_kinematics):
    hand, shoulder = clip_kinematics.hand[:, 1], clip_kinematics.shoulder[:, 1]
    assert (hand[45:115, 2] > shoulder[45:115, 2]).all()
    assert (clip_kinematics.hand[:, 0, 2] < clip_kinematics.shoulder[:, 0, 2]).all()
    assert np.degrees(np.arccos(clip_kinematics.torso_rotation[:, 2, 2].min())) > 35
    assert clip.root_position[-1, 0] - clip.root_position[0, 0] == pytest.approx(1.24, abs=0.02)
    assert 11.5 <= clip.duration <= 12.5


def test_joint_speeds_are_human(clip):
    speed = np.abs(np.diff(clip.joints, axis=0)) * clip.fps
    # Knee in swing: about 6 rad/s in brisk walking (Winter 2009).
    assert speed.max() < 12


def test_minimum_jerk_rests_in_keyframes():
    time = np.linspace(0, 3, 301)
    value = minimum_jerk(time, [(1.0, 2.0), (2.0, 5.0)])
    assert value[[0, 100, 200, 300]] == pytest.approx([2, 2, 5, 5])
    assert value[150] == pytest.approx(3.5)
    # The peak speed of a minimum-jerk move is 15/8 of its mean (Flash and Hogan 1985).
    assert np.diff(value).max() / 0.01 == pytest.approx(3 * 15 / 8, rel=1e-3)
    assert minimum_jerk(time, [(0.0, 7.0)]) == pytest.approx(np.full(301, 7.0))
