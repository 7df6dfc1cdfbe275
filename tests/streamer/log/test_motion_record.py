"""The motion of a joint in a log: an arm is identified from any run, a leg while the feet are in the air."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.shared.hidden_servos import hide
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.identification.excitation import plan
from flexmotion.drivers.identification.identify import identify
from flexmotion.drivers.interface import JointCommand, RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow, blank
from flexmotion.streamer.log.motion_record import motion_record
from flexmotion.streamer.log.reader import Log, read_log

LOG = Path(__file__).parent / "data" / "version_0.1.0.mcap"
FIGURES = {"kp": 15.5, "back_emf": 0.7, "frictionloss": 0.06, "damping": 0.1, "armature": 0.06, "delay": 0.005}


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


def logged(hidden: Robot, joint: int, goals: np.ndarray[Any, Any], template: Log) -> Log:
    """What a log says of a robot that hangs and moves one joint, in lockstep."""
    driver = SimDriver(hidden, options=SimOptions(suspended=True, timestep=0.0005))
    state, command = RobotState(hidden.n), JointCommand(hidden.n)
    servo = hidden.servos[joint]
    unit = (servo.current_unit or 0.0) * (servo.torque_constant or 0.0)
    rows = blank(TickRow.dtype(joints=hidden.n), len(goals))
    with driver:
        driver.read(state)
        driver.set_torque(True)
        command.position[:] = state.position
        for tick, (goal, row) in enumerate(zip(goals, rows, strict=True)):
            driver.read(state)
            command.position[joint] = goal
            driver.write(command)
            driver.advance(1.0 / hidden.rate_hz)
            row["tick"], row["state"], row["hung"] = tick, int(State.STREAMING), True
            row["q_cmd"], row["q"] = command.position, state.position
            row["effort"] = np.rint(state.effort / unit) * unit
            row["voltage"], row["stale"] = state.voltage, state.stale
            row["accel"], row["gyro"], row["imu_stale"] = state.accel, state.gyro, state.imu_stale
    header = template.header.model_copy(update={"driver": "sim", "driver_options": {}, "clock": "lockstep"})
    return replace(template, header=header, rows=rows)


def test_hidden_figures_are_found_in_a_log(op3: Robot, tmp_path: Path) -> None:
    joint = op3.index("l_knee")
    hidden = hide(op3, "l_knee", tmp_path, FIGURES)
    goals = plan(op3, joint, op3.stand_pose).goals
    log = logged(hidden, joint, goals, read_log(LOG))
    found = identify(op3, joint, motion_record(log, op3, joint), "2026-11-23")
    for name, true in FIGURES.items():
        figure = found.figures[name]  # type: ignore[index]
        assert abs(figure.value - true) <= figure.uncertainty, name
        scale = true + (FIGURES["back_emf"] if name == "damping" else 0.0)
        assert figure.value == pytest.approx(true, abs=0.1 * scale), name
        assert figure.motion == "log version_0.1.0.mcap"


def test_a_log_of_slow_motion_shows_no_inertia_and_names_what_would(op3: Robot, tmp_path: Path) -> None:
    joint, time = op3.index("l_knee"), np.arange(0.0, 16.0, 1.0 / op3.rate_hz)
    goals = op3.stand_pose[joint] + 0.4 * np.sin(2 * np.pi * 0.08 * time)
    log = logged(hide(op3, "l_knee", tmp_path, FIGURES), joint, goals, read_log(LOG))
    found = identify(op3, joint, motion_record(log, op3, joint), "2026-11-23")
    assert "quick reversals show it" in found.refused["armature"]
    for name, figure in found.figures.items():
        assert abs(figure.value - (FIGURES | {"torque_constant": 1.783})[name]) <= figure.uncertainty, name


def test_a_leg_that_carries_the_robot_is_refused(op3: Robot) -> None:
    log = read_log(LOG)
    assert log.header.joints == op3.joint_names
    with pytest.raises(ConfigError, match="'l_knee' carries the robot, and the ground's forces are not measured"):
        motion_record(log, op3, op3.index("l_knee"))
    assert len(motion_record(log, op3, op3.index("l_el")))


def test_a_log_without_torque_or_of_another_robot_is_refused(op3: Robot) -> None:
    log = read_log(LOG)
    rows = log.rows.copy()
    rows["state"] = int(State.OFF)
    with pytest.raises(ConfigError, match="the torque of 'l_el' is never on"):
        motion_record(replace(log, rows=rows), op3, op3.index("l_el"))
    other = log.header.model_copy(update={"joints": tuple(reversed(log.header.joints))})
    with pytest.raises(ConfigError, match="is of a robot with other joints"):
        motion_record(replace(log, header=other), op3, op3.index("l_el"))
    plugin = log.header.model_copy(update={"driver": "udp"})
    with pytest.raises(ConfigError, match="driver 'udp', whose bus time is not known"):
        motion_record(replace(log, header=plugin), op3, op3.index("l_el"))
