"""The whole system in lockstep, the real driver speaking in bytes to emulated servos that carry the simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from configs.robot import Robot, load_robot
from configs.stream import load_stream
from drivers.emulator.faults import Fault
from drivers.emulator.lockstep import LockstepBus
from drivers.emulator.loopback import Loopback
from drivers.emulator.sim_body import SimBody
from drivers.interface import Driver
from drivers.registry import create
from streamer.commands.choice import choose_motion
from streamer.record import RunRecord
from streamer.session import Session
from streamer.sources import ClipSource

SECONDS, FAULT_AT = 2.0, 1.2


@dataclass
class Run:
    """A finished run.

    Attributes:
        record: of the loop.
        body: the robot, as the run left it; `violations` goals outside the envelope, counted where bytes arrive.
    """

    record: RunRecord
    driver: Driver
    body: SimBody | None

    @property
    def tracking_rmse(self) -> float:
        """Measured legs against their reference while it moves [rad]."""
        error = self.record.q - self.record.q_ref
        return float(np.sqrt(np.mean(error[np.isfinite(error).all(axis=1)][:, 8:] ** 2)))

    @property
    def faults(self) -> list[tuple[int, str]]:
        return [(event.tick, event.message) for event in self.record.events if event.kind == "fault"]

    @property
    def states(self) -> list[str]:
        return [event.message.partition(":")[0] for event in self.record.events if event.kind in ("state", "fault")]

    @property
    def lowest(self) -> float:
        """Of the torso before it parks [m]."""
        parked = next((e.tick for e in self.record.events if "-> PARK" in e.message), len(self.record.true_base))
        return float(self.record.true_base[:parked, 2].min())


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("op3")


def through(robot: Robot, driver: Driver, body: SimBody | None = None) -> Run:
    settings = load_stream(None)
    motion = choose_motion()
    session = Session(robot, driver, ClipSource(motion), settings, SECONDS)
    return Run(session.run("lockstep"), driver, body)


def through_bytes(robot: Robot, *faults: str, bad_packets: float = 0.0) -> Run:
    body = SimBody(robot)
    world = Loopback(body, faults=[Fault.parse(text) for text in faults], bad_packets=bad_packets, seed=1)
    return through(robot, LockstepBus(create("dynamixel", robot, port="main"), world, body), body)


@pytest.fixture(scope="module")
def clean(robot: Robot) -> Run:
    return through_bytes(robot)


def test_it_stays_up_as_the_simulation_does(robot: Robot, clean: Run) -> None:
    straight = through(robot, create("sim", robot))
    assert clean.states == straight.states and clean.states[-1] == "PARK -> OFF"
    assert clean.driver.violations == 0
    assert clean.lowest == pytest.approx(straight.lowest, abs=0.005)
    assert clean.tracking_rmse < 1.2 * straight.tracking_rmse


def test_bad_packets_change_next_to_nothing(robot: Robot, clean: Run) -> None:
    noisy = through_bytes(robot, bad_packets=0.005)
    assert noisy.states == clean.states
    assert noisy.driver.violations == 0
    assert noisy.tracking_rmse < 1.1 * clean.tracking_rmse


@pytest.mark.parametrize("fault", ["cable", "port"])
def test_a_pulled_cable_is_a_fault_within_100_ms(robot: Robot, fault: str) -> None:
    run = through_bytes(robot, f"{fault}@{FAULT_AT}")
    (tick, message) = run.faults[-1]
    assert "bus lost" in message
    began = next(event.tick for event in run.record.events if "OFF -> READY" in event.message)
    assert (tick - began) / robot.rate_hz - FAULT_AT < 0.1
    assert run.driver.violations == 0
    # Nobody can switch them off any more: their watchdogs stop them, stiff.
    assert run.body is not None and run.body.plant.enabled.all()


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("dead:4", r"servo of l_sho_roll \(id 4\) does not answer"),
        ("voltage:9.8", "supply at 9.8 V, below 10.2 V"),
    ],
)
def test_what_is_wrong_with_one_part_ends_in_a_parked_robot(robot: Robot, fault: str, says: str) -> None:
    run = through_bytes(robot, f"{fault}@{FAULT_AT}")
    assert run.states[-3:] == ["STREAMING -> HOLD", "HOLD -> PARK", "PARK -> FAULT"]
    assert run.record.events[-1].message.endswith(says.replace("\\", ""))
    assert run.driver.violations == 0


@pytest.mark.parametrize("fault", [f"lost@{FAULT_AT}+0.02", f"voltage:9.5@{FAULT_AT}+0.03", f"duplicated@{FAULT_AT}"])
def test_what_passes_is_ridden_out(robot: Robot, clean: Run, fault: str) -> None:
    run = through_bytes(robot, fault)
    assert run.states == clean.states and run.driver.violations == 0
