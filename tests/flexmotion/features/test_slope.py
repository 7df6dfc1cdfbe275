"""Motions on a slope, on their levelled floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.features.slope import levelled


def test_the_floor_of_a_slope_is_level(make_standing) -> None:
    """Regression: heights above z = 0 rose by .3 m over six seconds of walking up a slope."""
    standing = make_standing(31)
    slope, way = np.array([0.05, -0.03]), np.linspace(0.0, 6.0, 31)
    place = standing.root_position + [1.0, 2.0, 0.0] + way[:, None] * [0.8, 0.6, 0.0]
    place[:, 2] += (place[:, :2] - place[0, :2]) @ slope
    climbing = replace(standing, root_position=place, wrenches=np.tile([0.0, 0.0, 350.0, 0.0, 0.0, 0.0], (31, 2, 1)))
    found = levelled(climbing, np.zeros((31, 2, 3)), np.zeros((31, 3, 3)), slope.tolist())
    assert np.ptp(place[:, 2]) > 0.1 and np.ptp(found.motion.root_position[:, 2]) < 1e-9
    assert found.motion.root_position[0, :2] == pytest.approx(place[0, :2], abs=0.06)
    assert np.linalg.norm(found.motion.root_position[-1] - found.motion.root_position[0]) == pytest.approx(
        np.linalg.norm(place[-1] - place[0])
    )
    # Ground forces turn with the floor, gravity's difference points down the slope.
    assert found.motion.wrenches is not None
    assert found.motion.wrenches[0, 0, :3] == pytest.approx(-350.0 * (found.gravity + [0.0, 0.0, -1.0]))
    assert found.gravity[:2] == pytest.approx(-slope, rel=5e-3) and abs(found.gravity[2]) < 2e-3


def test_a_level_floor_changes_nothing(make_standing) -> None:
    standing = make_standing(3)
    centres, loads = np.zeros((3, 2, 3)), np.ones((3, 3, 3))
    found = levelled(standing, centres, loads, (0.0, 0.0))
    assert found.motion is standing and found.loads is loads and not found.gravity.any()
