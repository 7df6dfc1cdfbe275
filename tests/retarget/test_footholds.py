from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flexmotion.human.motion import Motion
from flexmotion.retarget.footholds import Footholds, Scaling
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.steps import Step

from .conftest import RATE, Views, Windows, distance, reach


@pytest.fixture(scope="session")
def footholds(retargeter: Retargeter) -> Footholds:
    return retargeter.footsteps.footholds


def test_toes_turn_in_less_than_out(view: Views, footholds: Footholds, retargeter: Retargeter, walk: Motion) -> None:
    gait, seen = retargeter.gait, view(walk)
    for heading in (-3.0, 3.0):
        turned = Scaling(seen.scaling.ratio, heading, seen.scaling.human_width)
        for side in (0, 1):
            stance = retargeter.body.home_feet[1 - side]
            yaw = footholds.target(seen.window, turned, side, 0.0, 0.5, stance, np.full(2, np.nan)).pose[3]
            outward = (heading > 0) == (side == 0)
            assert abs(yaw) == pytest.approx(gait.max_foot_yaw if outward else gait.max_toe_in)


def test_a_foot_that_turns_reaches_less_far(footholds: Footholds) -> None:
    """Curves were walked in strides as long as straight ahead, and half of the weaker robots fell outwards."""
    start, stance = np.array([0.0, 0.05, 0, 0]), np.array([0.0, -0.05, 0, 0])
    reaches = [
        np.hypot(*footholds.within_reach(start, np.array([0.3, 0.05, 0, yaw]), stance, 0.4)[:2] - start[:2])
        for yaw in (0.0, 0.5, -0.5)
    ]
    assert reaches[1] == pytest.approx(reaches[0] / 1.5) and reaches[2] == pytest.approx(reaches[1])


@example(ahead=1.0, apart=0.0, askew=-0.4, heading=1.5, second=1.05, side=0, seconds=0.34)
@example(ahead=1.0, apart=0.0, askew=0.4, heading=-1.5, second=3.0, side=1, seconds=0.34)
@settings(max_examples=200)
@given(
    ahead=st.floats(-1.0, 1.0),
    apart=st.floats(0.0, 1.0),
    askew=st.floats(-0.4, 0.4),
    heading=st.sampled_from([-1.5, -0.5, 0.0, 0.5, 1.5]),
    second=st.floats(1.0, 4.5),
    side=st.sampled_from([0, 1]),
    seconds=st.sampled_from([0.34, 0.4, 0.5]),
)
def test_no_step_leaves_the_feet_more_than_a_stride_apart(
    retargeter: Retargeter,
    footholds: Footholds,
    window: Windows,
    walk: Motion,
    ahead: float,
    apart: float,
    askew: float,
    heading: float,
    second: float,
    side: int,
    seconds: float,
) -> None:
    """In curves a foot fell up to 23 cm behind where 11 are allowed: its turn left it too little reach to keep up."""
    gait, seen = retargeter.gait, window(walk)
    room = gait.lateral[0] + footholds.sole_half_length * abs(np.sin(askew))
    across = (room + apart * max(gait.lateral[1] - room, 0.0)) * (1.0 if side == 0 else -1.0)
    along = gait.max_stride * ahead * np.sqrt(1.0 - apart**2)
    cos, sin = np.cos(0.5 * askew), np.sin(0.5 * askew)
    feet = np.zeros((2, 4))
    feet[side] = [cos * along - sin * across, sin * along + cos * across, 0.0, askew]
    ratio = retargeter.body.leg_length / walk.body.leg
    scaling = Scaling(ratio, heading, walk.body.segments.hip_width)
    found = footholds.of_swing(seen, scaling, side, (second, second), feet, np.full((2, 2), np.nan), seconds).pose
    middle = 0.5 * found[3]
    assert abs(np.cos(middle) * found[0] + np.sin(middle) * found[1]) <= gait.max_stride + 1e-3 + 1e-9
    assert footholds.shortest_swing_s(feet[side], found) <= seconds + 1e-5


def test_a_target_out_of_reach_is_shortened_along_the_stride(footholds: Footholds, retargeter: Retargeter) -> None:
    start, stance = np.array([0.0, 0.05, 0, 0]), np.array([0.0, -0.05, 0, 0])
    target = np.array([0.5, 0.06, 0, 0.1])
    found = footholds.within_reach(start, target, stance, 0.4)
    step = Step(0, 0, round(0.4 * RATE), start, found, 0.0)
    assert distance(step) == pytest.approx(reach(retargeter.gait, step))
    assert footholds.shortest_swing_s(start, found) == pytest.approx(0.4)
    assert found[0] < target[0] and found[3] == target[3]
    near = np.array([0.02, 0.05, 0, 0])
    np.testing.assert_array_equal(footholds.within_reach(start, near, stance, 0.4), near)
