"""Which drivers are simulated, and which can be stepped."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import Capabilities, Driver
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.simulated import lockstep, simulated

from .bus.robots import looped


class WithoutTruth(SimDriver):
    @property
    def capabilities(self) -> Capabilities:
        return replace(super().capabilities, truth=False, lockstep=False)


def test_the_simulation_is_simulated_and_steps(op3: Robot) -> None:
    driver = SimDriver(op3)
    assert simulated(driver) is driver and lockstep(driver) is driver


def test_the_detached_simulation_is_simulated_and_does_not_step(op3: Robot) -> None:
    driver = SimDriver(op3).detached(realtime=False)
    assert simulated(driver) is driver and lockstep(driver) is None


def test_a_bus_driver_is_neither(op3: Robot) -> None:
    driver, _ = looped("dynamixel", op3)
    assert simulated(driver) is None and lockstep(driver) is None


def test_a_driver_whose_capabilities_deny_it_is_neither(op3: Robot) -> None:
    assert simulated(WithoutTruth(op3)) is None and lockstep(WithoutTruth(op3)) is None


def test_the_hardware_interface_has_no_method_of_the_simulation() -> None:
    assert not {"truth", "advance", "detached", "lateness_s"} & set(dir(Driver))


def test_a_driver_that_runs_in_lockstep_only_says_so(op3: Robot) -> None:
    driver, _ = looped("dynamixel", op3)
    body = SimBody(op3)
    bus = LockstepBus(driver, Loopback(body), body)
    with pytest.raises(ConfigError, match="'lockstep_bus' runs in lockstep only; use --clock lockstep"):
        bus.detached(realtime=False)
