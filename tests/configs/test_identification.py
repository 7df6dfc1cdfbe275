"""Identified figures take precedence over the catalogue, in the plant, the inversion of servos and the MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.identification import (
    FILE,
    Identification,
    IdentifiedFigure,
    IdentifiedServo,
    read_identification,
    write_identification,
)
from flexmotion.configs.robot import load_robot
from flexmotion.drivers.emulator.body import BenchBody
from flexmotion.drivers.plant import ServoPlant
from flexmotion.drivers.registry import create

FIGURES = {
    "kp": 15.0,
    "back_emf": 0.6,
    "frictionloss": 0.1,
    "damping": 0.05,
    "armature": 0.03,
    "delay": 0.004,
    "torque_constant": 2.0,
}


def identified(figures: dict[str, float], **servo: Any) -> Identification:
    known = {
        name: IdentifiedFigure(value=value, uncertainty=0.01, date="2026-11-23", motion="on a stand")
        for name, value in figures.items()
    }
    given = {"servo": "XM430-W350", "id": 14, "figures": known} | servo
    return Identification(joints={"l_knee": IdentifiedServo(**given)})


def test_a_robot_uses_them(spoiled: Any) -> None:
    folder = spoiled(lambda content: content["joints"][11].update(p_gain=400))
    plain = load_robot(folder)
    write_identification(folder, identified(FIGURES))
    robot = load_robot(folder)
    knee, other = robot.index("l_knee"), robot.index("r_knee")
    assert robot.kp[knee] == pytest.approx(7.5)  # at half of the gain for which it was identified
    assert robot.back_emf[knee] == pytest.approx(0.6)
    assert robot.stall_torque[knee] == plain.stall_torque[knee]
    dof = robot.dof_address[knee]
    assert robot.model.dof_armature[dof] == pytest.approx(0.03)
    assert robot.model.dof_frictionloss[dof] == pytest.approx(0.1)
    assert float(np.ravel(robot.model.dof_damping)[dof]) == pytest.approx(0.05)
    assert robot.servo_delay == pytest.approx(0.004) and plain.servo_delay == pytest.approx(0.001)
    assert "identified 2026-11-23" in robot.servos[knee].provenance["kp"].text
    # The others stay as in the catalogue.
    assert robot.kp[other] == plain.kp[other] and robot.back_emf[other] == plain.back_emf[other]

    plant = ServoPlant(robot)
    plant.enabled[:] = True
    plant.goal[knee] = 0.1
    velocity = np.zeros(robot.n)
    velocity[knee] = 0.5
    assert plant.step(np.zeros(robot.n), velocity)[knee] == pytest.approx(7.5 * 0.1 - 0.6 * 0.5)
    assert create("sim", robot).delay_s == pytest.approx(create("sim", plain).delay_s + 0.003)
    bus, before = create("dynamixel", robot, port="main"), create("dynamixel", plain, port="main")
    assert bus.delay_s == pytest.approx(before.delay_s + 0.003)


def test_a_servo_on_a_bench_brakes_by_its_viscous_friction(spoiled: Any) -> None:
    folder = spoiled(lambda content: None)
    write_identification(folder, identified({"damping": 0.5}))
    robot = load_robot(folder)
    body, knee, other = BenchBody(robot), robot.index("l_knee"), robot.index("r_knee")
    body.velocity[:] = 2.0
    body.step(0.02)
    assert body.velocity[knee] < 0.9 * body.velocity[other]


def test_it_is_read_as_it_was_written(tmp_path: Path) -> None:
    assert read_identification(tmp_path).joints == {}
    known = identified(FIGURES)
    assert write_identification(tmp_path, known) == tmp_path / FILE
    assert read_identification(tmp_path) == known


@pytest.mark.parametrize(
    ("servo", "message"),
    [
        ({"id": 3}, r"'l_knee' was identified with XM430-W350 \(id 3\), the robot file has XM430-W350 \(id 14\)"),
        ({"servo": "XM540-W270"}, "identified with XM540-W270 .* identify again, or remove the joint"),
    ],
)
def test_another_servo_or_id_is_refused(spoiled: Any, servo: dict[str, Any], message: str) -> None:
    folder = spoiled(lambda content: None)
    write_identification(folder, identified(FIGURES, **servo))
    with pytest.raises(ConfigError, match=message):
        load_robot(folder)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda content: content["joints"].update(knee=content["joints"].pop("l_knee")), "unknown joint 'knee'"),
        (
            lambda content: content["joints"]["l_knee"]["figures"]["kp"].update(value=0.0),
            "kp is 0, expected more than 0",
        ),
        (lambda content: content["joints"]["l_knee"]["figures"]["kp"].update(value=-1.0), "figures.kp.value"),
        (lambda content: content["joints"]["l_knee"]["figures"].update(mass={}), "mass"),
        (lambda content: content["joints"]["l_knee"]["figures"]["kp"].pop("uncertainty"), "figures.kp.uncertainty"),
        (lambda content: content["joints"]["l_knee"]["figures"]["delay"].update(value=3.0), "delay is 3"),
    ],
)
def test_a_malformed_file_is_refused_with_its_field(spoiled: Any, edit: Any, message: str) -> None:
    folder = spoiled(lambda content: None)
    write_identification(folder, identified(FIGURES))
    content = yaml.safe_load((folder / FILE).read_text())
    edit(content)
    (folder / FILE).write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match=message):
        load_robot(folder)
