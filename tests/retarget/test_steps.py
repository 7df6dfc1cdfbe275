from __future__ import annotations

import numpy as np
import pytest

from flexmotion.retarget.state import SETTLED_STEPS
from flexmotion.retarget.steps import NOTICE_S, UNHURRIED_S, Bend, Step, pack_steps, settled_from

RATE = 125
STEPS = [
    Step(0, 100, 150, np.arange(4.0), np.arange(4.0) + 1, 2.5, notice_s=0.45, human=np.array([0.3, -0.1])),
    Step(1, 160, 210, np.arange(4.0) - 1, np.arange(4.0) + 2, 3.5, inserted=True, shift=np.array([0.02, -0.01])),
    Step(0, 220, 270, np.zeros(4), np.ones(4), 4.5, bend=Bend(240, np.arange(4.0), np.arange(4.0) - 2)),
]


def assert_equal(one: list[Step], other: list[Step]) -> None:
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        for field in ("side", "lift", "land", "consumed_s", "inserted", "notice_s"):
            assert getattr(a, field) == getattr(b, field)
        np.testing.assert_array_equal(a.start, b.start)
        np.testing.assert_array_equal(a.target, b.target)
        np.testing.assert_array_equal(a.human, b.human)
        np.testing.assert_array_equal(a.shift, b.shift)
        assert a.bend.tick == b.bend.tick
        np.testing.assert_array_equal(a.bend.offset, b.bend.offset)
        np.testing.assert_array_equal(a.bend.speed, b.bend.speed)


@pytest.mark.parametrize("count", range(SETTLED_STEPS + 1))
def test_steps_survive_packing(count: int) -> None:
    """With one slot, a foot in the air was lost when the other foot's next step was settled: it never landed."""
    assert_equal(pack_steps(STEPS[:count], SETTLED_STEPS).steps(), STEPS[:count])
    assert_equal(pack_steps(STEPS[:count]).steps(), STEPS[:count])


def test_a_packed_step_is_the_row_of_numbers_that_logs_hold() -> None:
    packed = pack_steps(STEPS[:1], 2)
    row = [0, 100, 150, *range(4), *range(1, 5), 2.5, 0, 0.45, 0.3, -0.1, *[0] * 11]
    np.testing.assert_array_equal(packed.array.view(np.float64).reshape(2, -1), [row, [-1] * 27])


def test_more_steps_than_fit_are_refused() -> None:
    """The last one was left out silently, and the next plan decided about it again."""
    with pytest.raises(ValueError, match="4 steps, expected at most 3"):
        pack_steps([*STEPS, STEPS[0]], SETTLED_STEPS)


def test_unpacked_steps_are_copies() -> None:
    packed = pack_steps(STEPS[:1])
    unpacked = packed.steps()
    packed.start = packed.target = packed.human = 9.0
    assert_equal(unpacked, STEPS[:1])


def test_a_step_is_settled_no_later_than_the_one_after_it() -> None:
    """An inserted step that was settled before the step in front of it would be taken for the only one."""
    pose = np.zeros(4)
    hurried = Step(0, 100, 120, pose, pose, 0.0)
    inserted = Step(1, 122, 172, pose, pose, 0.0, inserted=True, notice_s=UNHURRIED_S)
    last = Step(0, 200, 220, pose, pose, 0.0)
    settled = settled_from([hurried, inserted, last], RATE)
    np.testing.assert_allclose(settled, [122 - UNHURRIED_S * RATE] * 2 + [200 - NOTICE_S * RATE])
