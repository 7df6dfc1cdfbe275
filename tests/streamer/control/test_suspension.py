"""A robot on a stand: its legs carry no load, and balance feedback must be off."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import PERTURBED, SimOptions
from flexmotion.importers.default_clip import default_clip
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.suspension import Suspension
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.session import Session


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def streamed(op3: Robot, options: SimOptions) -> RunTrace:
    source = ClipSource(default_clip()[225:330])
    return Session(op3, SimDriver(op3, options=options), source, load_stream()).run()


def messages(record: RunTrace) -> list[str]:
    return [event.message for event in record.events if event.kind == "note"]


@pytest.mark.parametrize("options", [SimOptions(), PERTURBED.model_copy(update={"total_mass": 3.5})])
def test_a_walking_robot_never_counts_as_hanging(op3: Robot, options: SimOptions) -> None:
    record = streamed(op3, options)
    assert not record.hung.any() and messages(record) == []


def test_a_robot_on_a_stand_moves_its_legs_and_does_not_balance(op3: Robot) -> None:
    record = streamed(op3, SimOptions(suspended=True))
    assert messages(record) == ["the feet are in the air: balance is off"]
    streaming = record.state == State.STREAMING
    assert record.hung[streaming].all()
    assert (record.zmp_shift[streaming] == 0).all() or np.isnan(record.zmp_shift[streaming]).all()
    # With the torque that carries the robot the legs would be off by some degrees.
    error = np.abs(record.q - record.q_ref)[streaming][:, op3.chain("left_leg")["knee"]]
    assert np.median(error) < np.radians(2.0)
    assert record.violations_sent == 0 and record.state[-1] == State.OFF


def test_after_landing_it_balances_again(op3: Robot) -> None:
    suspension, torque = Suspension(op3), np.zeros(op3.n)
    knees = [op3.chain(f"{side}_leg")["knee"] for side in ("left", "right")]
    torque[knees] = 1.0
    q, still = np.zeros(op3.n), np.zeros(op3.n)
    carrying = q + torque / op3.kp  # under load the goal is ahead of the joint
    changes = [suspension.update(goal, q, still, torque) for goal in [carrying] * 50 + [q] * 100 + [carrying] * 100]
    assert [k for k, changed in enumerate(changes) if changed] == pytest.approx([93, 172], abs=8)
    assert not suspension.hung


def test_with_little_load_the_share_is_kept(op3: Robot) -> None:
    suspension, none = Suspension(op3), np.zeros(op3.n)
    for _ in range(500):
        assert not suspension.update(none, none, none, none)
    assert suspension.carried == 1.0


def test_a_reading_that_is_not_finite_is_ignored(op3: Robot) -> None:
    suspension, ones = Suspension(op3), np.ones(op3.n)
    assert not suspension.update(np.full(op3.n, np.nan), ones, ones, ones)
    assert suspension.carried == 1.0
