"""Once is away from the stand and back, and not a stroke of a waving hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.streamer.planning.repetitions import Repetitions

# Ways of the right hand of the simulated OP3 for "wave twice", .3 s apart (seed 1), and of its left one for a wave.
TWO_WAVES = [0.2, 1.9, 4.3, 5.1, 5.0, 4.8, 4.6, 4.3, 4.6, 4.5, 5.2, 5.1, 5.1, 5.0, 4.7, 3.9, 2.3, 0.5, 3.2, 5.1, 5.2]
TWO_WAVES += [5.3, 5.1, 5.2, 5.3, 5.3, 5.2, 5.2, 5.1, 5.0, 4.8, 4.3, 3.3, 1.0, 0.5, 0.5]
A_WAVE_THAT_DIPS = [1.1, 3.8, 5.3, 5.3, 5.2, 5.0, 4.1, 3.0, 3.9, 4.4, 4.4, 4.9, 5.0, 4.7, 3.9, 3.0, 2.0, 1.2]


def counted(ways: list[float]) -> tuple[int, int]:
    made = Repetitions()
    for way in ways:
        made.update(way)
    return made.begun, made.done


@pytest.mark.parametrize(("ways", "times"), [(TWO_WAVES, 2), (A_WAVE_THAT_DIPS, 1)])
def test_strokes_of_a_waving_hand_are_not_waves(ways: list[float], times: int) -> None:
    """The judge took each dip of a raised hand for another wave: "wave twice" was judged as three."""
    assert counted(ways) == (times, times)


def test_a_hand_that_stays_up_has_begun_and_is_not_done() -> None:
    assert counted([0.1, 2.0, 5.0, 4.0, 5.0]) == (1, 0)


def test_a_gesture_that_begins_with_the_hand_still_up_counts_from_when_it_came_down() -> None:
    assert counted([5.0, 4.0, 0.5, 4.5, 0.5]) == (1, 1)


@given(
    st.lists(st.floats(2.0, 6.0), max_size=6),
    st.floats(0.0, 0.4),
    st.floats(0.0, 0.5),
)
def test_as_many_as_there_are_ways_there_and_back_however_they_tremble(
    peaks: list[float], stand: float, tremble: float
) -> None:
    ways, sign = [stand], 1.0
    for peak in peaks:
        there = np.linspace(stand, peak, 12)
        for way in [*there, *([peak] * 5), *there[::-1]]:
            sign = -sign
            ways.append(max(float(way) + 0.5 * sign * tremble, 0.0))
    assert counted(ways) == (len(peaks), len(peaks))
