from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flexmotion.configs.robot import load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.gyro_bias import REST_S, GyroBias
from flexmotion.streamer.control.loop import ControlLoop
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.telemetry import Telemetry, events
from flexmotion.streamer.control.tick_row import TickRow

RATE = 125.0
MOST_TICKS = 2000
"""Bound against hanging."""
BIAS = np.array([0.02, -0.025, 0.01])
UP = np.array([0.0, 0.0, 9.81])


def measured(gyro: np.ndarray, accel: np.ndarray) -> GyroBias:
    """The result of half a second of samples, (T, 3) each."""
    bias = GyroBias(RATE)
    for sample in zip(gyro, accel, strict=True):
        assert not bias.done
        bias.add(*sample)
    assert bias.done
    return bias


@pytest.fixture
def t() -> np.ndarray:
    return np.arange(round(REST_S * RATE))[:, None] / RATE


@pytest.fixture
def noise() -> np.random.Generator:
    return np.random.default_rng(0)


def test_at_rest_the_mean_of_the_gyro_is_its_bias(t: np.ndarray, noise: np.random.Generator) -> None:
    gyro, accel = noise.normal(BIAS, 0.01, (len(t), 3)), noise.normal(UP, 0.05, (len(t), 3))
    bias = measured(gyro, accel)
    assert bias.known
    np.testing.assert_allclose(bias.bias, BIAS, atol=0.004)


@pytest.mark.parametrize("harm", ["sways", "turns", "is shaken", "not a number"])
def test_without_rest_the_bias_is_not_known(t: np.ndarray, harm: str) -> None:
    gyro, accel = np.tile(BIAS, (len(t), 1)), np.tile(UP, (len(t), 1))
    if harm == "sways":
        gyro[:, :1] += 0.1 * np.sin(2 * np.pi * 1.5 * t)
    elif harm == "turns":
        gyro[:, 2] += np.radians(5)
    elif harm == "is shaken":
        accel[:, 1:2] += 0.6 * np.sin(2 * np.pi * 9 * t)
    else:
        gyro[3, 1] = np.nan
    bias = measured(gyro, accel)
    assert not bias.known and not bias.bias.any()


def test_a_new_measurement_replaces_the_old_bias_once_it_is_done(t: np.ndarray) -> None:
    bias = measured(np.tile(BIAS, (len(t), 1)), np.tile(UP, (len(t), 1)))
    bias.reset()
    np.testing.assert_allclose(bias.bias, BIAS)
    for _ in t:
        bias.add(-BIAS, UP)
    np.testing.assert_allclose(bias.bias, -BIAS)


@pytest.mark.parametrize(("length", "degrees"), [(0.5, 1.9), (0.5, 4.0), (1.0, 1.5), (1.0, 5.5), (2.0, 3.0)])
def test_a_swing_is_not_taken_for_a_bias(t: np.ndarray, length: float, degrees: float) -> None:
    """Half a second has only part of a swing: 0.27 rad/s of one were taken for the gyro's bias."""
    speed = np.sqrt(9.81 / length)
    for phase in np.linspace(0, 2 * np.pi, 73):
        gyro = np.zeros((len(t), 3))
        gyro[:, :1] = np.radians(degrees) * speed * np.cos(speed * t + phase)
        bias = measured(gyro, np.tile(UP, (len(t), 1)))
        assert np.abs(bias.bias).max() <= 0.03 and bias.known == bias.bias.any()


def ready_loop(**options: object) -> ControlLoop:
    """A loop whose robot has stood up and waits for a plan."""
    robot = load_robot("op3")
    driver = SimDriver(robot, options=SimOptions.model_validate(options))
    driver.open()
    retargeter = Retargeter(robot, load_stream())
    plans = PlanBuffer(robot.n, retargeter.layout.size, retargeter.horizon, robot.rate_hz)
    loop = ControlLoop(robot, driver, retargeter, plans, Telemetry(robot.n, robot.rate_hz))
    loop.inputs.start = True
    while not loop.ready:
        loop.tick()
        driver.advance(1 / robot.rate_hz)
        assert loop.tick_count < MOST_TICKS
    return loop


def test_a_biased_gyro_no_longer_tilts_a_robot_that_stands() -> None:
    """The bias of a consumer gyro is some degrees a second, and it was not subtracted."""
    loop = ready_loop(seed=3, gyro_bias=0.012)
    for _ in range(round(4 * RATE)):
        loop.tick()
        loop.driver.advance(1 / RATE)
    raw = np.abs(loop.state.gyro).max()
    assert raw > 0.025 and np.abs(loop.estimator.tilt_rate).max() < 0.015
    assert np.abs(loop.estimator.tilt).max() < 0.02
    assert [e for e in events(loop.telemetry.events.reader()) if e.kind == "warning"] == []


def test_a_push_during_the_measurement_is_warned_of_and_leaves_no_bias() -> None:
    loop = ready_loop(random_pushes={"every_s": 0.3, "impulse": 0.2})
    (warning,) = (e.message for e in events(loop.telemetry.events.reader()) if e.kind == "warning")
    assert warning == "the robot did not stand still: the gyro's bias is not known, none is subtracted"
    assert not loop.estimator.gyro_bias.any()


def test_a_hanging_robot_gives_no_bias() -> None:
    """A robot swings on its stand, where the README lets it hang at first; the swing was subtracted from the gyro."""
    loop = ready_loop(suspended=True, gyro_bias=0.02)
    assert loop.suspension.hung and not loop.estimator.gyro_bias.any()
    (warning,) = (e.message for e in events(loop.telemetry.events.reader()) if e.kind == "warning")
    assert warning == "the robot hangs: the gyro's bias is not known, none is subtracted"


def test_a_rate_too_great_for_a_bias_is_warned_of() -> None:
    loop = ready_loop(gyro_bias=0.1)
    (warning,) = (e.message for e in events(loop.telemetry.events.reader()) if e.kind == "warning")
    assert warning.startswith("the gyro measures 0.06 rad/s, more than a bias is (0.03)")


def test_without_an_imu_the_robot_is_ready_as_soon_as_it_stands() -> None:
    loop = ready_loop(imu=False)
    rows = TickRow(loop.telemetry.ticks.reader().read())
    assert rows.ready.tolist() == [False] * loop.move.ticks + [True]


def test_a_loop_stays_ready_when_its_imu_returns() -> None:
    """An IMU that answered again after a silence began another measurement: `ready` was false again."""
    loop = ready_loop(imu=False)
    loop.driver.read = answering(loop.driver.read)  # type: ignore[method-assign]
    for _ in range(20):
        loop.tick()
        assert loop.ready
    assert loop.estimator.has_imu


def answering(read: Callable[[RobotState], None]) -> Callable[[RobotState], None]:
    """`read` of a driver whose IMU answers."""

    def answered(state: RobotState) -> None:
        read(state)
        state.imu_stale = 0

    return answered
