"""Runs of the whole system in lockstep: the real driver, an emulated bus, and servos that move the simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import Driver
from flexmotion.drivers.registry import create
from flexmotion.human.motion import Motion
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session

SECONDS = 2.0


@dataclass
class Run:
    """A finished run.

    Attributes:
        record: what the loop recorded.
        driver: its `violations` are goals outside the envelope, counted where bytes arrive.
        body: the robot at the end of the run; None without a bus.
    """

    record: RunTrace
    driver: Driver
    body: SimBody | None

    @property
    def tracking_rmse(self) -> float:
        """Root mean square error of the legs against their reference, while a plan plays [rad]."""
        error = self.record.q - self.record.q_ref
        return float(np.sqrt(np.mean(error[np.isfinite(error).all(axis=1)][:, 8:] ** 2)))

    @property
    def faults(self) -> list[tuple[int, str]]:
        return [(event.tick, event.message) for event in self.record.events if event.kind == "fault"]

    @property
    def states(self) -> list[str]:
        return [message.partition(":")[0] for message in self._changes]

    @property
    def end(self) -> str:
        """Message of the last change of state."""
        return self._changes[-1]

    @property
    def _changes(self) -> list[str]:
        return [event.message for event in self.record.events if " -> " in event.message]

    @property
    def lowest(self) -> float:
        """Lowest height of the torso before the robot parks [m]."""
        parked = next((e.tick for e in self.record.events if "-> PARK" in e.message), len(self.record.true_base))
        return float(self.record.true_base[:parked, 2].min())

    def seconds_since_torque(self, tick: int) -> float:
        """Time from torque on to a tick [s]; times of faults count from torque on."""
        return (tick - self._began) / self.record.rate_hz

    def tick_at(self, seconds: float) -> int:
        """The tick at a time since torque on [s]."""
        return self._began + round(seconds * self.record.rate_hz)

    @property
    def _began(self) -> int:
        return next(event.tick for event in self.record.events if "OFF -> READY" in event.message)


def through(robot: Robot, driver: Driver, body: SimBody | None = None, motion: Motion | None = None) -> Run:
    """A run of a motion, by default of the first `SECONDS` of the shipped one."""
    source, seconds = ClipSource(choose_motion() if motion is None else motion), SECONDS if motion is None else None
    session = Session(robot, driver, source, load_stream(None), seconds)
    return Run(session.run(), driver, body)


def through_bytes(
    robot: Robot,
    *faults: str,
    bad_packets: float = 0.0,
    false_readings: float = 0.0,
    imu_port: str | None = None,
    seed: int = 1,
    motion: Motion | None = None,
) -> Run:
    """The same over an emulated bus with faults, bad packets and false readings."""
    body = SimBody(robot)
    world = Loopback(
        body,
        faults=[Fault.parse(text) for text in faults],
        bad_packets=bad_packets,
        false_readings=false_readings,
        seed=seed,
    )
    driver = create("dynamixel", robot, port="main", imu_port=imu_port)
    assert isinstance(driver, BusDriver)
    return through(robot, LockstepBus(driver, world, body), body, motion)
