"""One measurement at a time: what refuses a start, what ends a run, what is only warned of."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.interface import RobotState
from flexmotion.streamer.control.hardware_audit import IMU_BACK_S, HardwareAudit
from flexmotion.streamer.control.obedience import Obedience
from flexmotion.streamer.control.plausibility import Plausibility
from flexmotion.streamer.control.punctuality import Punctuality

KNEE = 11


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def warnings() -> list[str]:
    return []


@pytest.fixture
def audit(op3: Robot, warnings: list[str]) -> HardwareAudit:
    return HardwareAudit(op3, Punctuality(op3), Plausibility(op3), Obedience(op3), warnings.append, warnings.append)


@pytest.fixture
def measured(op3: Robot) -> RobotState:
    """A robot in order, at its stand pose."""
    state = RobotState(op3.n)
    state.position[:], state.velocity[:] = op3.stand_pose, 0.0
    state.voltage[:], state.temperature[:] = op3.nominal_voltage, 30.0
    state.stale[:] = state.hardware_error[:] = state.imu_stale = 0
    return state


def test_a_robot_in_order_may_start_and_run(audit: HardwareAudit, measured: RobotState, warnings: list[str]) -> None:
    answered = np.zeros(len(measured.position), np.int64)
    assert audit.refusal(measured, answered, True) is None
    assert audit.problem(measured) is None and audit.lost_bus(measured) is None
    assert warnings == []


def test_an_imu_that_falls_silent_a_second_time_is_told_again(
    audit: HardwareAudit, warnings: list[str], op3: Robot
) -> None:
    """Once in a run was all: whether falls were detected since was not known."""
    back = round(IMU_BACK_S * op3.rate_hz)
    for has_imu, ticks in ((True, 9), (False, 9), (True, back - 1), (False, 9), (True, back), (False, 1)):
        for _ in range(ticks):
            audit.watch_imu(has_imu)
    silent, again, silent_again = warnings
    assert silent == silent_again == "no IMU: the robot runs open loop, falls are not detected"
    assert again == "the IMU measures again: balance and the detection of falls use it"


def test_one_silent_joint_is_a_problem_and_all_of_them_a_lost_bus(
    audit: HardwareAudit, measured: RobotState, op3: Robot
) -> None:
    most = op3.safety.max_stale_reads
    measured.stale[KNEE] = most
    assert audit.problem(measured) is None
    measured.stale[KNEE] = most + 1
    assert audit.problem(measured) == "servo of l_knee (id 14) does not answer" and audit.lost_bus(measured) is None
    measured.stale[:] = most + 1
    assert audit.lost_bus(measured) == f"bus lost: no joint has answered for {most + 1} reads"


def test_heat_is_warned_of_once_and_then_ends_the_run(
    audit: HardwareAudit, measured: RobotState, op3: Robot, warnings: list[str]
) -> None:
    shutdown, margin = op3.servos[KNEE].temperature_limit, op3.safety.thermal_margin
    measured.temperature[KNEE] = shutdown - 1.5 * margin
    measured.temperature[0] = np.nan  # read later than the others
    assert [audit.problem(measured) for _ in range(3)] == [None] * 3
    assert len(warnings) == 1 and warnings[0].startswith("servo of l_knee (id 14) is at ")
    measured.temperature[KNEE] = shutdown - 0.5 * margin
    problem = audit.problem(measured)
    assert problem is not None and problem.startswith("servo of l_knee (id 14) is at ") and len(warnings) == 1


def test_a_supply_counts_as_low_after_as_many_reads_as_a_servo_may_be_silent(
    audit: HardwareAudit, measured: RobotState, op3: Robot
) -> None:
    assert op3.safety.voltage_min is not None
    measured.voltage[KNEE] = op3.safety.voltage_min - 0.2
    reads = op3.safety.max_stale_reads
    assert [audit.problem(measured) for _ in range(reads)] == [None] * reads
    low = measured.voltage[KNEE]
    measured.voltage[KNEE] = op3.safety.voltage_min  # one good read, and the count begins again
    assert audit.problem(measured) is None
    measured.voltage[KNEE] = low
    assert [audit.problem(measured) for _ in range(reads)] == [None] * reads
    problem = audit.problem(measured)
    assert problem is not None and problem.startswith("supply at ")


def test_a_dip_that_a_servo_reports_passes_and_a_low_supply_does_not(
    audit: HardwareAudit, measured: RobotState, op3: Robot
) -> None:
    """One read with bit 0x01 ended the run."""
    reads = op3.safety.max_stale_reads
    measured.hardware_error[KNEE] = 0x01
    assert [audit.problem(measured) for _ in range(reads)] == [None] * reads
    measured.hardware_error[KNEE] = 0
    assert audit.problem(measured) is None
    measured.hardware_error[KNEE] = 0x01
    assert [audit.problem(measured) for _ in range(reads)] == [None] * reads
    assert audit.problem(measured) == "servo of l_knee (id 14) reports hardware error 0x01"
    measured.hardware_error[KNEE] = 0x21
    assert audit.problem(measured) == "servo of l_knee (id 14) reports hardware error 0x21"


def test_the_servos_own_limits_count_where_they_are_narrower(
    audit: HardwareAudit, measured: RobotState, op3: Robot, warnings: list[str]
) -> None:
    temperature, voltage = np.full(op3.n, 90.0), np.full(op3.n, 9.5)
    temperature[KNEE], voltage[0] = 60.0, 11.0
    audit.take_limits(temperature, voltage)
    measured.temperature[KNEE] = 53.0
    assert audit.problem(measured) is None
    assert warnings == ["servo of l_knee (id 14) is at 53 °C and shuts down at 60 °C"]
    measured.temperature[KNEE], measured.voltage[:] = 40.0, 10.5
    problems = [audit.problem(measured) for _ in range(op3.safety.max_stale_reads + 1)]
    assert problems[:-1] == [None] * op3.safety.max_stale_reads
    assert problems[-1] == "supply at 10.5 V, below 11.0 V"


@pytest.mark.parametrize(("beyond", "refused"), [(-0.01, False), (0.01, True)])
def test_a_joint_may_start_outside_its_limits_by_the_standing_margin(
    audit: HardwareAudit, measured: RobotState, op3: Robot, beyond: float, refused: bool
) -> None:
    measured.position[KNEE] = op3.upper[KNEE] + op3.safety.standing_margin + beyond
    refusal = audit.refusal(measured, np.zeros(op3.n, np.int64), True)
    assert (refusal is not None) == refused
    assert refusal is None or ("servo of l_knee" in refusal and "move it by hand" in refusal)


def test_a_start_needs_an_answer_of_every_joint_and_of_a_required_imu(
    audit: HardwareAudit, measured: RobotState, op3: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    unread = np.zeros(op3.n, np.int64)
    unread[KNEE] = op3.safety.max_stale_reads + 1
    assert audit.refusal(measured, unread, True) == "servo of l_knee (id 14) does not answer"
    unread[KNEE] = 0
    assert audit.refusal(measured, unread, False) is None
    assert op3.config.imu is not None
    required = op3.config.imu.model_copy(update={"required": True})
    monkeypatch.setitem(vars(op3), "config", op3.config.model_copy(update={"imu": required}))
    assert audit.refusal(measured, unread, False) == "the robot file requires an IMU and none answers"


def test_a_start_on_a_bus_that_is_silent_is_refused_with_the_way_back(
    audit: HardwareAudit, measured: RobotState, op3: Robot
) -> None:
    """After a bus was unplugged and plugged in, `arm` named the first joint for ever, and not what leads back."""
    measured.stale[:] = unread = np.full(op3.n, 600, np.int64)
    refusal = audit.refusal(measured, unread, True)
    assert refusal is not None and "no joint has answered for 600 reads" in refusal
    assert "mend cable or power; if it stays silent, start the run again" in refusal and "head_pan" not in refusal


def test_a_supply_that_was_low_before_the_start_refuses_it(
    audit: HardwareAudit, measured: RobotState, op3: Robot
) -> None:
    """One reading at the start was no problem yet: the robot stood up on a flat battery, and parked."""
    measured.voltage[:] = (op3.safety.voltage_min or 0.0) - 0.5
    for _ in range(op3.safety.max_stale_reads):
        audit.watch(measured)
    refusal = audit.refusal(measured, np.zeros(op3.n, np.int64), True)
    assert refusal is not None and refusal.startswith("supply at")


def test_an_imu_that_lies_refuses_a_start_also_where_none_is_required(
    audit: HardwareAudit, measured: RobotState, op3: Robot
) -> None:
    """The documents said so, and OP3, which does not require its IMU, stood up open loop with one that lied."""
    assert op3.config.imu is not None and not op3.config.imu.required
    unread, wrong = np.zeros(op3.n, np.int64), np.ones(1, np.bool_)
    for _ in range(op3.safety.max_stale_reads):
        audit.plausibility.imu_suspicion.note(wrong, wrong)
    assert audit.refusal(measured, unread, True) is None
    audit.plausibility.imu_suspicion.note(wrong, wrong)
    refusal = audit.refusal(measured, unread, False)
    assert refusal is not None and refusal.startswith("the IMU measures what cannot be: replace it")
    assert audit.problem(measured) is None  # a robot that walks goes on without it
