"""The floor of a whole clip, and what a human is on at a moment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.floor import clip_floor, ground_under
from flexmotion.human.kinematics import HumanKinematics, forward


@pytest.mark.parametrize("height", [-0.5, 0.0, 1.3])
def test_height(clip, height):
    moved = replace(clip, root_position=clip.root_position + [0, 0, height])
    assert clip_floor(forward(moved), 30.0) == pytest.approx(height, abs=1e-4)


def test_a_rolling_foot_that_dips_through_the_floor_does_not_lower_it(clip_kinematics):
    toe = clip_kinematics.toe.copy()
    toe[240:320:8, 0, 2] = -0.04
    assert clip_floor(replace(clip_kinematics, toe=toe), 30.0) == pytest.approx(0.0, abs=2e-3)


def test_one_frame_and_flight(make_standing):
    human = forward(make_standing())
    assert clip_floor(human, 30.0) == pytest.approx(0.0, abs=1e-4)
    flying = forward(make_standing(30))
    rise = np.zeros((30, 1, 3))
    rise[:, 0, 0] = np.arange(30) * 0.2
    flying = replace(flying, heel=flying.heel + rise, toe=flying.toe + rise)
    assert clip_floor(flying, 30.0) == pytest.approx(0.0, abs=1e-4)


def feet_moved(human: HumanKinematics, up: np.ndarray, sides: list[int]) -> HumanKinematics:
    """Feet of some sides moved upwards, (T,) [m]."""
    heel, toe = human.heel.copy(), human.toe.copy()
    heel[:, sides, 2] += up[:, None]
    toe[:, sides, 2] += up[:, None]
    return replace(human, heel=heel, toe=toe)


@pytest.mark.parametrize("height", [-0.5, 0.0, 1.3])
def test_who_stands_is_on_the_ground_at_any_height(make_standing, height):
    for frames in (1, 2, 12):
        standing = make_standing(frames)
        moved = replace(standing, root_position=standing.root_position + [0, 0, height])
        assert ground_under(forward(moved), 30.0) == pytest.approx(height, abs=0.01)


def test_a_jump_does_not_raise_the_ground(make_standing):
    standing = forward(make_standing(18))
    seconds = np.maximum(np.arange(18) - 5, 0) / 30.0
    flight = np.maximum(2.0 * seconds - 4.905 * seconds**2, 0.0)
    for now in range(5, 18):
        so_far = forward(make_standing(now + 1))
        jumping = feet_moved(so_far, flight[: now + 1], [0, 1])
        assert ground_under(jumping, 30.0) == pytest.approx(ground_under(standing, 30.0), abs=1e-6)


def test_a_foot_in_the_air_is_no_ground_until_the_other_has_left(make_standing):
    # The left foot is put on a step; the right one leaves the floor, and is lifted to the step as well.
    human = forward(make_standing(40))
    left = np.interp(np.arange(40), [5, 12], [0.0, 0.3])
    right = np.interp(np.arange(40), [22, 29], [0.0, 0.3])
    human = feet_moved(feet_moved(human, left, [0]), right, [1])
    # The hands and the head of this figure are higher than its feet at any time.
    heights = [ground_under(_until(human, now), 30.0) for now in range(1, 40)]
    assert np.abs(heights[:20]).max() < 0.02
    assert np.abs(np.array(heights[32:]) - 0.3).max() < 0.02
    assert np.diff(heights).min() > -0.01


def test_who_stands_on_the_head_is_on_the_floor(make_standing):
    # Feet that rest in the air are no ground: the human would be below it.
    standing = make_standing(12)
    turned = Rotation.from_euler("y", np.pi) * Rotation.from_quat(standing.root_quaternion, scalar_first=True)
    upside_down = replace(standing, root_quaternion=turned.as_quat(scalar_first=True))
    head = forward(upside_down).vertex[0, 2]
    on_the_floor = replace(upside_down, root_position=upside_down.root_position - [0.0, 0.0, head])
    assert ground_under(forward(on_the_floor), 30.0) < 0.01


def _until(human: HumanKinematics, last: int) -> HumanKinematics:
    return replace(human, **{name: value[: last + 1] for name, value in vars(human).items()})
