"""A synthetic run whose figures are known, and a real run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexmotion.streamer.api import open_session
from flexmotion.streamer.commands.choice import choose_motion
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.control.tick_row import REPAIRS, TickRow, blank
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.outcome import Outcome
from flexmotion.streamer.outcome import outcome as judge
from flexmotion.streamer.plots.pictures import write_plots
from flexmotion.streamer.report.metrics import HumanTrack, RobotFigures

JOINTS = ("l_hip_pitch", "l_knee", "r_hip_pitch", "r_knee", "l_el", "head_pan")
LEGS = np.array([0, 1, 2, 3])
STANDING_HEIGHT = 0.3
WEIGHT = 30.0
LEG_RATIO = 0.25
SPEED = 0.1
"""The robot's walking speed [m/s]; the human's is `SPEED / LEG_RATIO`, so that the ratio of paths is 1."""
LAG_TICKS = 2
TURN = 0.3
"""Turn of robot and human in the whole run [rad]."""


def make_record(seconds: float = 8.0, rate_hz: float = 125.0) -> RunTrace:
    """Stand 0.5 s, walk and turn a little, hold for the last 0.5 s; the measurement lags by `LAG_TICKS`."""
    ticks, n = int(seconds * rate_hz), len(JOINTS)
    record = RunTrace(rate_hz=rate_hz, joint_names=JOINTS)
    record.append(blank(TickRow.dtype(joints=n), ticks))
    record.rows["tick"] = np.arange(ticks)
    t = np.arange(ticks) / rate_hz
    rows, quiet = slice(ticks), int(0.5 * rate_hz)
    playing = np.zeros(ticks, bool)
    playing[quiet:-quiet] = True
    record.state[rows] = np.where(playing, State.STREAMING, State.HOLD)
    record.source_s[rows] = np.where(playing, t - 0.5, np.nan)

    phase = np.linspace(0, np.pi, n)
    wave = 0.4 * np.sin(2 * np.pi * 1.2 * t[:, None] + phase)
    record.q_ref[rows], record.qd_ref[rows] = wave, np.gradient(wave, 1 / rate_hz, axis=0)
    record.q[rows] = np.roll(wave, LAG_TICKS, axis=0)
    record.qd[rows] = np.roll(record.qd_ref[rows], LAG_TICKS, axis=0)
    record.q_cmd[rows] = wave * 1.05
    record.torque_ref[rows] = record.true_torque[rows] = 1.2 * np.sin(2 * np.pi * 1.2 * t[:, None] + phase)
    record.true_q[rows] = record.q[rows]
    record.true_saturated[rows] = 0.0
    record.true_saturated[: ticks // 4, 1] = 1.0

    x = SPEED * np.clip(t - 0.5, 0.0, t[playing][-1] - 0.5)
    yaw = TURN * np.clip(t - 0.5, 0, None) / t[-1]
    base = np.zeros((ticks, 7))
    base[:, 0], base[:, 2] = x, STANDING_HEIGHT
    base[:, 3], base[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    record.true_base[rows] = record.base_ref[rows] = base

    step = 0.4
    foot = np.zeros((ticks, 2, 3))
    contact = np.ones((ticks, 2), bool)
    for side in (0, 1):
        cycle = (t - 0.5) / (2 * step) + 0.5 * side
        stride = SPEED * 2 * step
        moving = playing & (cycle % 1.0 < 0.4)
        contact[:, side] = ~moving
        foot[:, side, 0] = np.where(playing, stride * (np.floor(cycle) + np.clip((cycle % 1.0) / 0.4, 0, 1) - 0.5), 0.0)
        foot[~playing & (t > 1), side, 0] = x[-1]
        foot[:, side, 1] = 0.05 * (1 - 2 * side)
        foot[moving, side, 2] = 0.02
    record.true_foot[rows] = foot
    record.foot_ref[rows, :, :3] = foot
    record.foot_ref[rows, :, 3] = 0.0
    record.contact_ref[rows] = contact
    record.true_foot_force[rows] = 0.0
    record.true_foot_force[rows, :, 2] = WEIGHT * contact / np.maximum(contact.sum(axis=1, keepdims=True), 1)
    record.true_foot_velocity[rows] = 0.0
    record.true_foot_velocity[rows, :, 0] = np.where(contact, 0.002, 0.5)

    com = np.stack([x, 0.02 * np.sin(2 * np.pi * t / 0.8)], axis=1)
    record.com_ref[rows] = com
    record.com[rows] = com + 0.002
    record.dcm_ref[rows] = com + np.gradient(com, 1 / rate_hz, axis=0) / 6.6
    record.dcm[rows] = record.dcm_ref[rows] + 0.003
    record.zmp_ref[rows] = np.stack([x, 0.045 * np.sign(np.sin(2 * np.pi * t / 0.8))], axis=1)
    record.true_com[rows, :2], record.true_com[rows, 2] = com, 0.25
    record.work_s[rows] = 3e-4
    record.rows["plan"] = 1 + np.arange(ticks) // 31
    record.rows["asked_tick"] = 31 * (np.arange(ticks) // 31)
    record.rows["plan_start"] = record.rows["asked_tick"] + 2
    record.rows["sample_s"], record.rows["retarget_s"] = 0.0, 0.004
    record.events = [Event(0, "state", "READY -> STREAMING"), Event(ticks - quiet, "state", "STREAMING -> HOLD")]
    record.human_steps = 17
    record.rows["steps_planned"] = 16
    record.rows["repairs"][:, REPAIRS.index("speed")] = 3
    return record


@pytest.fixture
def record() -> RunTrace:
    return make_record()


@pytest.fixture
def make() -> Callable[..., RunTrace]:
    return make_record


@pytest.fixture
def figures() -> RobotFigures:
    n = len(JOINTS)
    return RobotFigures(
        legs=LEGS,
        standing_height=STANDING_HEIGHT,
        weight=WEIGHT,
        leg_ratio=LEG_RATIO,
        torque_limit=np.full(n, 2.5),
        stall_torque=np.full(n, 4.0),
        speed_limit=np.full(n, 4.8),
        arm_length=0.2,
    )


@pytest.fixture
def human() -> HumanTrack:
    t = np.linspace(0.0, 10.0, 301)
    position = np.stack([SPEED / LEG_RATIO * t, np.zeros_like(t), np.full_like(t, 0.9)], axis=1)
    return HumanTrack(t=t, pelvis_position=position, heading=1.0 + TURN * t / (8.0 - 1 / 125))


@pytest.fixture(scope="session")
def outcome() -> Outcome:
    """A run of the shipped motion's first seconds on the simulated OP3; read-only."""
    source = ClipSource(choose_motion()).cut(1.5)
    session = open_session("op3", source=source)
    session.run()
    return judge(session)


@pytest.fixture(scope="session")
def pictures(outcome: Outcome, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """All pictures of `outcome`."""
    folder = tmp_path_factory.mktemp("pictures")
    return write_plots(folder, outcome.record, outcome.robot, outcome.figures, outcome.motion, outcome.profile)
