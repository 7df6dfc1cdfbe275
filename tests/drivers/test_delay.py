import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.delay import DelayLine


def test_a_row_takes_effect_after_exactly_its_delay() -> None:
    line = DelayLine(np.array([0.0]), delay=0.005)
    line.push(np.array([1.0]))
    assert [float(line.advance(0.002)[0]) for _ in range(4)] == pytest.approx([0.0, 0.0, 0.5, 1.0])


def test_no_delay_is_no_delay() -> None:
    line = DelayLine(np.array([0.0]), delay=0.0)
    line.push(np.array([1.0]))
    assert line.advance(0.002)[0] == 1.0


@given(
    delay=st.floats(0, 0.03),
    gaps=st.lists(st.integers(1, 6), min_size=1, max_size=12),
    step=st.sampled_from([0.001, 0.002, 0.004]),
)
def test_the_mean_over_time_is_that_of_the_delayed_signal(delay: float, gaps: list[int], step: float) -> None:
    line = DelayLine(np.array([0.0]), delay=delay)
    times, area, now = [], 0.0, 0.0
    for number, gap in enumerate(gaps, start=1):
        line.push(np.array([float(number)]))
        times.append(now)
        for _ in range(gap):
            area += float(line.advance(step)[0]) * step
            now += step
    expected = sum(max(0.0, now - sent - delay) for sent in times)  # each row adds 1 to the one before
    assert area == pytest.approx(expected, abs=1e-9)


def test_reset_drops_delayed_rows() -> None:
    line = DelayLine(np.array([0.0]), delay=0.002)
    line.push(np.array([1.0]))
    line.reset(np.array([5.0]))
    assert line.advance(0.01)[0] == 5.0


def test_a_full_line_never_loses_the_newest_row() -> None:
    line = DelayLine(np.array([0.0]), delay=1.0, capacity=4)
    for number in range(1, 11):
        line.push(np.array([float(number)]))
    assert line.value[0] == 6.0
    line.advance(1.0)
    line.advance(0.1)
    assert line.value[0] == 10.0


@pytest.mark.parametrize("delay", [-1.0, float("nan")])
def test_a_negative_delay_is_refused(delay: float) -> None:
    with pytest.raises(ValueError, match="expected 0 or more"):
        DelayLine(np.array([0.0]), delay=delay)
