"""The short way for the answers of all servos in order gives what the long way gives."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from flexmotion.drivers.dynamixel.staleness import ReplyClock

M, OLDEST_MS = 3, 5.0
LATE = st.integers(-300, 300)
"""How late an answer is [ms]."""


@given(
    gaps=st.lists(st.sampled_from([0.008, 0.016, 0.09, 0.2]), min_size=1, max_size=12),
    late=st.lists(st.tuples(*[st.one_of(st.just(0), st.integers(-1, 1), LATE)] * M), min_size=12, max_size=12),
)
def test_servos_asked_together_or_one_by_one(gaps: list[float], late: list[tuple[int, ...]]) -> None:
    together, alone = ReplyClock(M, OLDEST_MS), ReplyClock(M, OLDEST_MS)
    now = 1.0
    for clock in (together, alone):
        clock.begin()
        clock.learn(range(M), bytes(_ticks(now, (0,) * M)), now)
    for gap, each in zip(gaps, late, strict=False):
        now += gap
        ticks = bytes(_ticks(now, each))
        one_by_one = [alone.accept([slot], ticks[slot : slot + 1], now)[0] for slot in range(M)]
        assert together.accept(list(range(M)), ticks, now) == one_by_one


def test_an_answer_of_the_tick_before_is_not_fresh() -> None:
    clock = ReplyClock(M, OLDEST_MS)
    clock.learn(range(M), bytes(_ticks(1.0, (0,) * M)), 1.0)
    assert clock.accept(list(range(M)), bytes(_ticks(1.008, (0,) * M)), 1.008) == [True] * M
    assert clock.accept(list(range(M)), bytes(_ticks(1.016, (0, 8, 0))), 1.016) == [True, False, True]


def _ticks(now: float, late: tuple[int, ...]) -> list[int]:
    return [(round(1e3 * now) + 40 * slot - own) & 0xFF for slot, own in enumerate(late)]
