from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.retarget.human import Swing
from flexmotion.retarget.human_steps import count_steps, is_consumed, is_step

from .conftest import Windows


def test_every_swing_of_a_walk_is_a_step(window: Windows, walk: Motion) -> None:
    seen = window(walk)
    assert len(seen.swings) == 8
    assert all(is_step(seen, swing) for swing in seen.swings)
    assert count_steps(walk) == 8


def test_a_step_without_its_landing_is_not_counted(window: Windows, walk: Motion) -> None:
    cut = walk[:42]
    assert [swing.landed for swing in window(cut).swings] == [False]
    assert count_steps(cut) == 0


@pytest.mark.parametrize(
    ("distance", "yaw", "lift", "step"),
    [
        (0.05, 0.19, 0.035, False),
        (0.07, 0.0, 0.0, True),
        (0.0, 0.21, 0.0, True),
        (0.0, 0.0, 0.045, True),
    ],
)
def test_a_swing_that_moves_turns_or_lifts_the_foot_enough_is_a_step(
    window: Windows, stand: Callable[..., Motion], distance: float, yaw: float, lift: float, step: bool
) -> None:
    still = stand(60)
    share = np.clip((np.arange(60) - 20) / 20, 0.0, 1.0)
    up = np.where((share > 0.0) & (share < 1.0), lift, 0.0)
    # About the right foot, so that the turn does not move it.
    turn = Rotation.from_euler("z", yaw * share[:, None])
    foot = np.array([*window(still).feet[0, 1, :2], 0.0])
    position = turn.apply(still.root_position - foot) + foot + np.column_stack([distance * share, 0.0 * up, up])
    moved = replace(still, root_position=position, root_quaternion=turn.as_quat(scalar_first=True))
    assert is_step(window(moved), Swing(1, 0.6, 1.4, landed=True)) == step


@pytest.mark.parametrize(
    ("lift_s", "land_s", "consumed"),
    [
        (1.0, 1.4, True),  # before the last step's landing
        (1.2, 1.6, True),  # the last step's swing, landing .1 s later in a new window
        (1.2, 1.7, False),  # lands too late to be the same swing
        (1.5, 1.55, False),  # began after the last landing
    ],
)
def test_a_swing_is_used_up_by_the_step_that_it_overlaps(lift_s: float, land_s: float, consumed: bool) -> None:
    assert is_consumed(Swing(0, lift_s, land_s, landed=True), consumed_s=1.5) == consumed
