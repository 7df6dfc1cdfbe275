"""Each fault of the emulator ends as `docs/faults.md` says: state, time, message. One run each, in lockstep."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from flexmotion.configs.robot import ROBOTS, Robot, load_robot
from flexmotion.drivers.emulator.faults import FALSE_OF_IMU, FALSE_OF_SERVO, FaultKind
from flexmotion.streamer.control.ladder import State

from .bus_runs import Run, through_bytes

AT = 1.7
"""When the fault begins, after torque went on [s]."""

BUS_LOST = ("cable", "lost", "corrupt", "truncated", "late", "late:0.009")
ONE_PART = {
    "dead:4": "servo of l_sho_roll (id 4) does not answer",
    "reset:4": "servo of l_sho_roll (id 4) does not answer",
    "overheat:4": "servo of l_sho_roll (id 4) reports hardware error 0x04",
    "voltage:9.5": "supply at 9.5 V, below 10.2 V",
}
PASSES = (f"lost@{AT}+0.02", f"corrupt@{AT}+0.01", f"truncated@{AT}+0.01", f"late:0.01@{AT}+0.02", f"duplicated@{AT}",
          f"voltage:9.5@{AT}+0.03")  # fmt: skip
SILENT_IMU = ("imu", "dead:200")
OTHER = {*FALSE_OF_SERVO, *FALSE_OF_IMU, FaultKind.BLOCKED, FaultKind.TRIPPED, FaultKind.ECHO}
"""Faults of devices that answer: `tests/drivers/emulator/test_false_readings.py`."""


@pytest.fixture(scope="module")
def clean(op3: Robot) -> Run:
    return through_bytes(op3)


def with_imu(folder: Path, **imu: object) -> Robot:
    """OP3 with some fields of `imu` in its robot file replaced."""
    place = Path(shutil.copytree(ROBOTS / "op3", folder / "op3"))
    content = yaml.safe_load((place / "op3.yaml").read_text(encoding="utf-8"))
    content["imu"] |= imu
    (place / "op3.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_robot(place)


def warned(run: Run) -> list[str]:
    return [event.message for event in run.record.events if event.kind == "warning"]


def test_every_fault_of_the_emulator_is_here() -> None:
    tried = {
        fault.partition("@")[0].partition(":")[0] for fault in ("port", *BUS_LOST, *ONE_PART, *PASSES, *SILENT_IMU)
    }
    assert tried == set(FaultKind) - OTHER


@pytest.mark.parametrize("fault", BUS_LOST)
def test_a_robot_whose_servos_do_not_answer_is_held_then_lowered(op3: Robot, fault: str) -> None:
    """All torque was cut after 50 ms, also where answers were late and every goal was heard: the robot fell."""
    run = through_bytes(op3, f"{fault}@{AT}")
    assert run.states[-3:] == ["STREAMING -> HOLD", "HOLD -> PARK", "PARK -> FAULT"]
    held = next(event for event in run.record.events if "STREAMING -> HOLD" in event.message)
    assert held.message.endswith(": bus lost: no joint has answered for 6 reads")
    assert 0 < run.seconds_since_torque(held.tick) - AT < 0.1
    assert run.driver.violations == 0
    # Late replies: the servos still take goals, and are switched off. With the other faults no servo can be reached.
    assert run.body is not None and not run.body.fell
    reached = fault.startswith("late")
    assert run.body.plant.enabled.all() != reached
    named = [message for _, message in run.faults if message.startswith("torque off is not confirmed by ")]
    assert len(named) == (not reached)
    assert all(f"{joint.name} (id {joint.id})" in message for message in named for joint in op3.joints)


def test_a_port_that_is_gone_is_a_fault_at_once(op3: Robot) -> None:
    """No goal can be sent: the servos hold by themselves."""
    run = through_bytes(op3, f"port@{AT}")
    (tick, message), (_, named) = run.faults
    assert message == "STREAMING -> FAULT: bus lost: no joint has answered for 6 reads"
    assert 0 < run.seconds_since_torque(tick) - AT < 0.1
    assert named.startswith("torque off is not confirmed by head_pan (id 19), head_tilt (id 20), ")
    assert run.body is not None and not run.body.fell and run.body.plant.enabled.all()


@pytest.mark.parametrize(("fault", "message"), ONE_PART.items())
def test_a_fault_of_one_part_ends_in_a_parked_robot(op3: Robot, fault: str, message: str) -> None:
    run = through_bytes(op3, f"{fault}@{AT}")
    assert run.states[-3:] == ["STREAMING -> HOLD", "HOLD -> PARK", "PARK -> FAULT"]
    # 0x104 if the torque switch is read in the tick of the error, which is so in three of four.
    assert run.end.replace("0x104", "0x04") == f"PARK -> FAULT: {message}"
    assert run.driver.violations == 0
    assert run.body is not None and not run.body.fell
    # Only the servo that cannot be reached still holds.
    assert run.body.plant.enabled.sum() == (1 if fault.startswith("dead") else 0)
    stands = next(event.tick for event in run.record.events if "STREAMING -> HOLD" in event.message)
    assert run.seconds_since_torque(stands) - AT < 1.5


def test_an_error_bit_is_seen_in_the_next_reads(op3: Robot) -> None:
    run = through_bytes(op3, f"overheat:4@{AT}")
    seen = int(np.argmax(run.record.rows["hardware_error"][:, op3.index("l_sho_roll")] != 0))
    assert 0 <= run.seconds_since_torque(seen) - AT < 0.03


def test_a_leg_that_gives_way_ends_damped_or_parked(op3: Robot) -> None:
    """A dead knee goes on holding its last goal, so that parking throws the robot over: it is damped, then off."""
    run = through_bytes(op3, f"dead:14@{AT}")
    assert run.states[-2:] == ["PARK -> DAMPED", "DAMPED -> FAULT"]
    assert run.end.endswith("servo of l_knee (id 14) does not answer")
    assert run.record.state[-1] == State.FAULT and run.driver.violations == 0


@pytest.mark.parametrize("fault", PASSES)
def test_a_fault_that_passes_does_not_change_the_states(op3: Robot, clean: Run, fault: str) -> None:
    run = through_bytes(op3, fault)
    assert run.states == clean.states and run.driver.violations == 0


# ---------------------------------------------------------------- the IMU: the board's, and one on a port of its own

SENSORS = {"opencr": {}, "witmotion": {"driver": "witmotion", "id": None, "bus": None}}


@pytest.mark.parametrize("sensor", SENSORS)
def test_an_imu_that_falls_silent_is_open_loop_with_a_warning(tmp_path: Path, clean: Run, sensor: str) -> None:
    run = through_bytes(with_imu(tmp_path, **SENSORS[sensor]), f"imu@{AT}", imu_port="imu")
    assert run.states == clean.states and run.faults == []
    assert warned(run) == ["no IMU: the robot runs open loop, falls are not detected"]
    blind = int(np.argmax(run.record.rows["imu_stale"] > 5))
    assert 0 < run.seconds_since_torque(blind) - AT < 0.1


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_silent_imu_that_the_robot_file_requires_parks_the_robot(tmp_path: Path, sensor: str) -> None:
    robot = with_imu(tmp_path, **SENSORS[sensor], required=True)
    run = through_bytes(robot, f"{'dead:200' if sensor == 'opencr' else 'imu'}@{AT}", imu_port="imu")
    assert run.states[-3:] == ["STREAMING -> HOLD", "HOLD -> PARK", "PARK -> FAULT"]
    assert run.end.startswith("PARK -> FAULT: IMU has not answered for ")
    assert run.body is not None and not run.body.fell and not run.body.plant.enabled.any()


def test_a_robot_walks_with_a_serial_imu_as_with_that_of_its_board(tmp_path: Path, clean: Run) -> None:
    robot = with_imu(tmp_path, **SENSORS["witmotion"], quaternion=[0.7071068, 0, 0, 0.7071068])
    run = through_bytes(robot, imu_port="imu")
    assert run.states == clean.states and run.driver.violations == 0 and warned(run) == []
    assert run.tracking_rmse < 1.2 * clean.tracking_rmse
