from __future__ import annotations

import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.streamer.control.punctuality import Punctuality


@pytest.fixture
def punctuality() -> Punctuality:
    """Of OP3: a tick is 8 ms, five stale reads are borne."""
    return Punctuality(load_robot("op3"))


def test_a_loop_on_time_blames_the_servos(punctuality: Punctuality) -> None:
    for tick in range(100):
        punctuality.woke(tick, 0.0002)
    assert punctuality.remark == ""


def test_a_loop_that_woke_late_says_so_for_as_long_as_it_may_be_the_cause(punctuality: Punctuality) -> None:
    """A busy machine once ended runs in "bus lost", and the servos were blamed."""
    for tick in range(100):
        punctuality.woke(tick, 0.007 if tick == 50 else 0.0)
        assert ("woke 7 ms late" in punctuality.remark) == (50 <= tick < 62)


def test_ticks_that_were_slept_through_count(punctuality: Punctuality) -> None:
    punctuality.woke(10, 0.0)
    punctuality.woke(15, 0.003)
    assert "woke 35 ms late" in punctuality.remark


def test_what_the_driver_blocked_for_is_not_called_a_busy_machine(punctuality: Punctuality) -> None:
    """Torque going on takes some ticks on a bus; faults soon after it were blamed on this machine."""
    punctuality.woke(10, 0.0)
    punctuality.woke(15, 0.003, waited_s=0.050)
    assert punctuality.remark == ""
    punctuality.woke(20, 0.003, waited_s=0.020)
    assert "woke 23 ms late" in punctuality.remark
