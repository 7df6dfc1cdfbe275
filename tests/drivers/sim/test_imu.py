from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot


def readings(run: Any, ticks: int) -> np.ndarray:
    """Gyro and accelerometer, tick by tick, (ticks, 6)."""
    rows = []
    for _ in range(ticks):
        run.tick()
        rows.append(np.concatenate([run.state.gyro, run.state.accel]))
    return np.array(rows)


def test_at_rest_it_reads_gravity_up_and_no_rotation(start: Callable) -> None:
    run = start(noise_scale=0.0)
    run.tick(250)
    assert np.linalg.norm(run.state.accel) == pytest.approx(9.81, abs=0.01)
    assert run.state.accel[2] > 9.7
    assert np.abs(run.state.gyro).max() < 0.01
    assert run.state.imu_stale == 0


def test_the_first_reading_is_valid(start: Callable) -> None:
    run = start(noise_scale=0.0, suspended=True)
    run.driver.read(run.state)
    np.testing.assert_allclose(run.state.accel, [0, 0, 9.81], atol=1e-6)


def test_noise_and_bias_are_as_in_the_options(start: Callable) -> None:
    rows = readings(start(suspended=True, gyro_noise=0.02, gyro_bias=0.0, accel_noise=0.3, accel_bias=0.0), 400)
    np.testing.assert_allclose(rows.std(axis=0), np.repeat([0.02, 0.3], 3), rtol=0.15)
    quiet = readings(start(suspended=True, gyro_noise=0.0, gyro_bias=0.1), 20)
    assert (np.abs(quiet[:, :3].mean(axis=0)) > 1e-3).all()
    assert (quiet[:, :3].std(axis=0) < 1e-2).all()


def test_a_turned_sensor_reports_in_the_frame_of_the_body(op3: Robot, start: Callable) -> None:
    robot = load_robot("op3")
    assert robot.config.imu is not None
    turned = robot.config.imu.model_copy(update={"quaternion": (0.5, 0.5, 0.5, 0.5)})
    robot.config = robot.config.model_copy(update={"imu": turned})
    run = start(robot=robot, noise_scale=0.0)
    run.tick(125)
    assert run.state.accel[2] > 9.7


def test_a_tilting_torso_shows_in_the_gyro(start: Callable) -> None:
    run = start(noise_scale=0.0, pushes=[{"at": 0.2, "impulse": [1.5, 0, 0]}])
    rows = readings(run, 100)
    assert rows[:, 1].max() > 0.5  # pushed forward: turns about +y


@pytest.mark.parametrize("how", ["option", "robot file"])
def test_a_robot_without_imu_says_so(start: Callable, how: str) -> None:
    robot = load_robot("op3")
    if how == "robot file":
        robot.config = robot.config.model_copy(update={"imu": None})
    run = start(robot=robot, imu=how != "option")
    run.tick(3)
    assert run.state.imu_stale == -1
    assert not run.driver.capabilities.imu
