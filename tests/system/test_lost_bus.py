"""A walking robot whose servos stop answering, at every phase of a step: it is held, lowered, and switched off."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.faults import Fault
from flexmotion.drivers.emulator.lockstep import LockstepBus
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.motion.clip_library import ClipLibrary
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

FIRST_S, STEP_S, PHASES = 3.4, 0.8, 4
"""From the start of a run to its second step [s], duration of two steps [s], and phases that are tried."""


class Unheard(SimDriver):
    """A robot that takes goals, and whose answers get lost from a time on [s]."""

    def __init__(self, robot: Robot, silent_from: float) -> None:
        super().__init__(robot, options=SimOptions())
        self._silent_from, self._kept = silent_from, RobotState(robot.n)

    def read(self, state: RobotState) -> None:
        if self.time < self._silent_from:
            super().read(state)
            return
        state.stale += 1
        state.imu_stale += 1


@pytest.mark.parametrize("phase", range(PHASES))
def test_it_is_held_and_lowered_without_answers(op3: Robot, steps: Motion, phase: int) -> None:
    """All torque was cut after 50 ms, with every goal heard."""
    begin = FIRST_S + phase / PHASES * STEP_S
    driver = Unheard(op3, begin)
    record = Session(op3, driver, ClipSource(steps), load_stream(), None).run()
    lost = int(np.argmax(record.rows["stale"].min(axis=1) > op3.safety.max_stale_reads))
    assert record.rows["state"][lost - 1] == State.STREAMING and record.rows["plan"][lost - 1]
    states = [State(s) for s in dict.fromkeys(record.rows["state"][lost - 1 :].tolist())]
    assert states == [State.STREAMING, State.HOLD, State.PARK, State.FAULT]
    held = np.count_nonzero(record.rows["state"] == State.HOLD) / op3.rate_hz
    assert held == pytest.approx(op3.safety.lost_bus_hold_s, abs=0.02)
    up = 1 - 2 * (record.true_base[:, 4] ** 2 + record.true_base[:, 5] ** 2)
    assert (up[record.rows["state"] != State.FAULT] > np.cos(np.radians(45))).all()
    assert not driver.plant.enabled.any()


@pytest.mark.parametrize("missed", [0, 6])
def test_a_loop_that_gets_little_time_lowers_it_to_the_rest_pose(
    op3: Robot, steps: Motion, monkeypatch: pytest.MonkeyPatch, missed: int
) -> None:
    """Six of seven ticks of a starved process were missed while it lowered a robot that did not answer.

    The joints were believed to run on at the speed of the move, which advances by one tick with each that is done: the
    goals followed them, to where joints ended 1.6 rad from the rest pose. What a late tick leaves in the goals stayed
    too, 0.2 rad, since every tick was late. In a run on the real clock 26 goals left the envelope.
    """
    tick = ControlLoop.tick

    def starved(self: ControlLoop, late_ns: int = 0) -> None:
        if self.ladder.state is State.PARK:
            self.tick_count += missed
            self.driver.advance(missed / op3.rate_hz)  # type: ignore[attr-defined]
        tick(self, late_ns)

    monkeypatch.setattr(ControlLoop, "tick", starved)
    driver = Unheard(op3, FIRST_S)
    record = Session(op3, driver, ClipSource(steps), load_stream(), None).run()
    parking = record.ticks[record.rows["state"] == State.PARK]
    held_up = op3.usable_torque / op3.kp  # how far a goal is ahead of a joint that needs all its torque
    assert (np.abs(parking.q_cmd - parking.q_ref)[10:] <= held_up).all()
    assert np.abs(parking.true_q[-1] - op3.rest_pose).max() < 0.05
    assert driver.violations == 0


@pytest.mark.parametrize(("fault", "comes_back"), [("cable", True), ("port", False)])
def test_the_way_back_is_told_while_the_bus_is_silent(op3: Robot, fault: str, comes_back: bool) -> None:
    """`arm` was refused for ever with "servo of head_pan (id 19) does not answer", and nothing told of another run."""
    body = SimBody(op3)
    world = Loopback(body)
    driver = create("dynamixel", op3, port="main")
    assert isinstance(driver, BusDriver)
    source = ClipLibrary({"wave": default_clip()[:120]}, "wave")
    session = Session(op3, LockstepBus(driver, world, body), source, load_stream(), stay=True, attended=True)
    (line,) = world.emulator.lines
    told: list[str] = []
    session.on_event = lambda event: told.append(event.message)
    with session:
        session.advance(2.0)
        line.act([Fault.parse(fault)])
        session.advance(6.0)
        assert session.state.ladder is State.FAULT
        session.ask(Request.CLEAR)
        session.advance(0.1)
        session.ask(Request.ARM)
        session.advance(0.1)
        refused = told[-1]
        assert refused.startswith("ARM: the bus is silent, no joint has answered for ")
        assert "if it stays silent, start the run again" in refused and "head_pan" not in refused
        line.act([])  # a cable is plugged in again; the port of an adapter is another one by then
        session.advance(0.2)
        session.ask(Request.ARM)
        session.advance(2.0)
        assert (session.state.ladder is State.READY) == comes_back
        session.finish()
