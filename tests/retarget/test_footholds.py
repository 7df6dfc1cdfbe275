from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.retarget.footholds import Footholds, Scaling
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.swing import Swings

from .conftest import Views, Windows


@pytest.fixture(scope="session")
def footholds(retargeter: Retargeter) -> Footholds:
    return retargeter.footsteps.footholds


def test_toes_turn_in_less_than_out(view: Views, footholds: Footholds, retargeter: Retargeter, walk: Motion) -> None:
    gait, seen = retargeter.gait, view(walk)
    for heading in (-3.0, 3.0):
        turned = Scaling(seen.scaling.ratio, heading, seen.scaling.human_width)
        for side in (0, 1):
            stance = retargeter.body.home_feet[1 - side]
            yaw = footholds.target(seen.window, turned, side, 0.5, (0.0, 0.5), stance, np.full(2, np.nan), 0.4).pose[3]
            outward = (heading > 0) == (side == 0)
            assert abs(yaw) == pytest.approx(gait.max_foot_yaw if outward else gait.max_toe_in)


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
    swings: Swings,
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
    along = swings.stride(seconds) * ahead * np.sqrt(1.0 - apart**2)
    cos, sin = np.cos(0.5 * askew), np.sin(0.5 * askew)
    feet = np.zeros((2, 4))
    feet[side] = [cos * along - sin * across, sin * along + cos * across, 0.0, askew]
    ratio = retargeter.body.leg_length / walk.body.leg
    scaling = Scaling(ratio, heading, walk.body.segments.hip_width)
    found = footholds.of_swing(
        seen, scaling, side, second, (second, second), feet, np.full((2, 2), np.nan), seconds
    ).pose
    middle = 0.5 * found[3]
    longest = max(swings.stride(seconds), swings.stride(seconds, backward=True))
    assert abs(np.cos(middle) * found[0] + np.sin(middle) * found[1]) <= longest + 1e-3 + 1e-9
    assert swings.shortest_s(side, feet[side], found) <= seconds + 1e-5


@pytest.mark.parametrize(("turned", "followed"), [(0.0, True), (1.2, True), (2.5, False), (np.pi, False)])
def test_a_lag_is_made_up_for_ahead_and_not_behind_the_back_of_who_turned_about(
    footholds: Footholds,
    retargeter: Retargeter,
    stand: Callable[..., Motion],
    window: Windows,
    turned: float,
    followed: bool,
) -> None:
    """The robot's feet stand for a place .5 m behind where the human was when it turned."""
    still = stand(60)
    root = Rotation.from_euler("z", [[turned]] * len(still)).as_quat(scalar_first=True)
    seen = window(replace(still, root_quaternion=root))
    scaling = Scaling(retargeter.body.leg_length / still.body.leg, 0.0, still.body.segments.hip_width)
    lagging = seen.place(1, 1.0) - [0.5, 0.0]
    stance = retargeter.body.home_feet[1]
    found, level = (
        footholds.target(seen, scaling, 0, 1.0, (1.0, 1.0), stance, place, 0.5)
        for place in (lagging, seen.place(1, 1.0))
    )
    frame = 0.5 * (stance[3] + found.pose[3])
    ahead = float((found.pose - level.pose)[:2] @ [np.cos(frame), np.sin(frame)])
    assert ahead > 0.03 if followed else ahead == pytest.approx(0.0, abs=1e-9)
