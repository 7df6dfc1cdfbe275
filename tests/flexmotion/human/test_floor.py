"""The floor of a whole clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.floor import clip_floor
from flexmotion.human.kinematics import forward


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
