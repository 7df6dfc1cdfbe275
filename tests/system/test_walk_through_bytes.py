"""The whole system in lockstep: the real driver and emulated servos that move the simulated robot."""

from __future__ import annotations

import pytest

from flexmotion.configs.robot import Robot
from flexmotion.drivers.registry import create

from .bus_runs import Run, through, through_bytes


@pytest.fixture(scope="module")
def clean(op3: Robot) -> Run:
    return through_bytes(op3)


def test_it_stays_up_as_the_simulation_does(op3: Robot, clean: Run) -> None:
    straight = through(op3, create("sim", op3))
    assert clean.states == straight.states and clean.states[-1] == "PARK -> OFF"
    assert clean.driver.violations == 0
    assert clean.lowest == pytest.approx(straight.lowest, abs=0.005)
    assert clean.tracking_rmse < 1.2 * straight.tracking_rmse


def test_bad_packets_change_tracking_by_less_than_a_tenth(op3: Robot, clean: Run) -> None:
    noisy = through_bytes(op3, bad_packets=0.005)
    assert noisy.states == clean.states and noisy.driver.violations == 0
    assert noisy.tracking_rmse < 1.1 * clean.tracking_rmse
