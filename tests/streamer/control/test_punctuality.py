from __future__ import annotations

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.streamer.control.punctuality import Punctuality


@pytest.fixture
def punctuality() -> Punctuality:
    """Of OP3: a tick is 8 ms, five stale reads are allowed."""
    return Punctuality(load_robot("op3"))


def test_a_loop_on_time_adds_no_remark(punctuality: Punctuality) -> None:
    for tick in range(100):
        punctuality.woke(tick, 0.0002)
    assert punctuality.remark == ""


def test_lateness_is_mentioned_for_as_long_as_it_may_be_the_cause(punctuality: Punctuality) -> None:
    """Runs on a busy machine ended in "bus lost", as if the servos had failed."""
    for tick in range(100):
        punctuality.woke(tick, 0.007 if tick == 50 else 0.0)
        assert ("woke 7 ms late" in punctuality.remark) == (50 <= tick < 62)


def test_skipped_ticks_count_as_lateness(punctuality: Punctuality) -> None:
    punctuality.woke(10, 0.0)
    punctuality.woke(15, 0.003)
    assert "woke 35 ms late" in punctuality.remark


def test_time_in_which_the_driver_blocked_is_no_lateness(punctuality: Punctuality) -> None:
    """Switching torque on takes some ticks on a bus; faults soon after it mentioned a busy machine."""
    punctuality.woke(10, 0.0)
    punctuality.woke(15, 0.003, waited_s=0.050)
    assert punctuality.remark == ""
    punctuality.woke(20, 0.003, waited_s=0.020)
    assert "woke 23 ms late" in punctuality.remark
