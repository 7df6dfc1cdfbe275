"""Signals that come to rest from where they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.sampling.settling import KNOWN, settled, stopped

FPS = 30.0
number = st.floats(-1.0, 1.0)


@given(number, number, number, number, st.floats(0.2, 1.0))
@settings(deadline=None, max_examples=60)
def test_place_speed_and_acceleration_go_on_and_it_comes_to_the_place(
    place: float, speed: float, bend: float, goal: float, seconds: float
) -> None:
    time = np.arange(1 - KNOWN, 1)[:, None] / FPS
    before = place + speed * time + 0.5 * bend * time**2
    found = settled(before, np.array([goal]), 600, FPS, seconds)
    joined = np.concatenate([before, found])[:, 0]
    first, second = np.diff(joined) * FPS, np.diff(joined, n=2) * FPS**2
    hardest = abs(place - goal) / seconds**3 + 3 * abs(speed) / seconds**2 + 3 * abs(bend) / seconds
    assert abs(np.diff(second)).max() <= 2.0 * hardest / FPS + 1e-9, "no frame is harder than the filter itself"
    assert abs(np.diff(first)).max() <= (abs(bend) + 2.0 * hardest * seconds) / FPS + 1e-9
    assert joined[-1] == pytest.approx(goal, abs=1e-3)


def test_what_rests_in_its_place_stays_there_and_one_frame_is_enough() -> None:
    for known in (1, 2, 5):
        before = np.full((known, 2), [0.3, -0.2])
        assert np.allclose(settled(before, np.array([0.3, -0.2]), 20, FPS, 0.5), [0.3, -0.2])


@given(number, number, st.floats(0.1, 1.0))
@settings(deadline=None, max_examples=60)
def test_what_stops_does_not_come_back(place: float, speed: float, seconds: float) -> None:
    before = place + speed * np.arange(1 - KNOWN, 1)[:, None] / FPS
    found = np.concatenate([before, stopped(before, 300, FPS, seconds)])[:, 0]
    assert (np.diff(found) * np.sign(speed) >= -1e-12).all()
    assert abs(found[-1] - place) < 2.01 * abs(speed) * seconds + 1e-9
    assert stopped(before[-1:], 5, FPS, seconds) == pytest.approx(place)
