from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.heat import AMBIENT, endurance
from flexmotion.configs.robot import load_robot
from flexmotion.drivers.plant import ServoPlant

ROBOT = load_robot("op3")
SERVO = ROBOT.servos[0]


def test_endurance_ends_where_the_servo_would_shut_down() -> None:
    resting, stalled = endurance(ROBOT, 0, 0.0), endurance(ROBOT, 0, SERVO.stall_torque)
    assert (resting.seconds, resting.duty, resting.temperature) == (None, 1.0, AMBIENT)
    assert stalled.seconds is not None
    assert stalled.after(stalled.seconds) == pytest.approx(SERVO.temperature_limit)


def test_a_margin_ends_it_earlier() -> None:
    whole, parked = endurance(ROBOT, 0, 0.7 * SERVO.stall_torque), endurance(ROBOT, 0, 0.7 * SERVO.stall_torque, 5.0)
    assert whole.seconds is not None and parked.seconds is not None
    assert parked.limit == SERVO.temperature_limit - 5.0
    assert parked.seconds < whole.seconds
    assert parked.duty < whole.duty


def test_at_its_duty_a_servo_settles_at_its_limit() -> None:
    hard = 0.8 * SERVO.stall_torque
    found = endurance(ROBOT, 0, hard)
    rms = np.sqrt(found.duty * hard**2)  # at rest for the remaining share of the time
    assert endurance(ROBOT, 0, float(rms)).temperature == pytest.approx(SERVO.temperature_limit)


def test_simulated_windings_warm_as_foretold() -> None:
    torque, seconds, step = np.full(ROBOT.n, 0.4 * SERVO.stall_torque), 300.0, 0.1
    plant = ServoPlant(ROBOT)
    for _ in range(round(seconds / step)):
        plant.draw(torque, step)
    assert plant.temperature[0] == pytest.approx(endurance(ROBOT, 0, float(torque[0])).after(seconds), abs=0.02)
