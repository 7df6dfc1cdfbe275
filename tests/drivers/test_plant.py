from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexmotion.configs.heat import AMBIENT
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.plant import ServoPlant

ROBOT = load_robot("op3")  # hypothesis takes no fixtures


def running(robot: Robot, **options: float) -> ServoPlant:
    plant = ServoPlant(robot, **options)
    plant.enabled[:] = True
    return plant


def step(plant: ServoPlant, error: float, speed: float) -> float:
    """Torque of the first servo at a position error [rad] and a speed [rad/s]."""
    n = len(plant.goal)
    plant.goal[:] = error
    return float(plant.step(np.zeros(n), np.full(n, speed))[0])


def test_stiffness_and_stall(op3: Robot) -> None:
    plant = running(op3)
    assert step(plant, 0.1, 0.0) == pytest.approx(0.1 * op3.kp[0])
    assert not plant.saturated.any()
    assert step(plant, 1.0, 0.0) == pytest.approx(op3.stall_torque[0])
    assert plant.saturated.all()


def test_back_emf_brakes_and_ends_at_the_no_load_speed(op3: Robot) -> None:
    plant = running(op3)
    assert step(plant, 0.0, 1.0) == pytest.approx(-op3.back_emf[0])
    assert step(plant, 1.0, op3.no_load_speed[0]) == pytest.approx(0.0, abs=1e-9)


@given(error=st.floats(-3, 3), speed=st.floats(-15, 15), volts=st.floats(6, 16))
def test_a_fit_sees_the_torque_of_joints_that_are_enabled(error: float, speed: float, volts: float) -> None:
    plant, fitted = running(ROBOT, supply=volts), ServoPlant(ROBOT, supply=volts)
    plant.goal[:] = fitted.goal[:] = error
    place, speeds = np.zeros(ROBOT.n), np.full(ROBOT.n, speed)
    np.testing.assert_array_equal(fitted.driven(place, speeds), plant.step(place, speeds))


def test_driving_is_bound_by_the_usable_torque_and_braking_by_the_stall_torque(op3: Robot) -> None:
    plant = running(op3)
    assert step(plant, 1.0, 0.1) == pytest.approx(op3.usable_torque[0])
    assert step(plant, 1.0, -0.1) == pytest.approx(op3.stall_torque[0])


@settings(max_examples=300)
@given(
    error=st.floats(-3, 3), speed=st.floats(-15, 15), volts=st.floats(6, 16), bound=st.floats(0.1, 9) | st.just(np.inf)
)
def test_torque_never_leaves_the_envelope(error: float, speed: float, volts: float, bound: float) -> None:
    plant = running(ROBOT, supply=volts)
    plant.torque_bound[:] = bound
    torque, share = step(plant, error, speed), volts / ROBOT.nominal_voltage[0]
    assert abs(torque) <= min(ROBOT.stall_torque[0] * share, bound) + 1e-9
    if torque * speed > 0:
        line = ROBOT.stall_torque[0] * share - ROBOT.back_emf[0] * abs(speed)
        assert abs(torque) <= min(line, ROBOT.usable_torque[0] * share) + 1e-9


@given(error=st.floats(-3, 3), speed=st.floats(-15, 15))
def test_both_directions_are_alike(error: float, speed: float) -> None:
    plant = running(ROBOT)
    assert step(plant, error, speed) == pytest.approx(-step(plant, -error, -speed))


def test_gain_and_stall_scale_with_the_supply(op3: Robot) -> None:
    plant = running(op3, supply=10.0)
    share = 10.0 / op3.nominal_voltage[0]
    assert step(plant, 0.1, 0.0) == pytest.approx(0.1 * op3.kp[0] * share)
    assert step(plant, 1.0, 0.0) == pytest.approx(op3.stall_torque[0] * share)


def test_torque_off_is_no_torque(op3: Robot) -> None:
    plant = running(op3)
    plant.enabled[0] = False
    assert step(plant, 1.0, -1.0) == 0.0
    assert not plant.saturated[0] and plant.saturated[1]


def test_a_damped_joint_gives_way_and_brakes(op3: Robot) -> None:
    plant = running(op3)
    plant.damp()
    assert step(plant, 1.0, 0.0) == pytest.approx(0.1 * op3.stall_torque[0])
    assert step(plant, 0.0, 2.0) == pytest.approx(-2.0 * op3.back_emf[0])
    plant.stiffen()
    assert step(plant, 1.0, 0.0) == pytest.approx(op3.stall_torque[0])


def test_gain_mismatch_and_gain_registers(op3: Robot) -> None:
    assert step(running(op3, kp_scale=0.92), 0.1, 0.0) == pytest.approx(0.092 * op3.kp[0])
    plant = running(op3)
    plant.set_gain(op3.kp * 0.5)
    assert step(plant, 0.1, 0.0) == pytest.approx(0.05 * op3.kp[0])


def test_windings_warm_towards_the_rise_at_stall_and_cool_again(op3: Robot) -> None:
    plant, servo = running(op3), op3.servos[0]
    for _ in range(6000):
        plant.draw(op3.stall_torque, 1.0)
    assert plant.temperature[0] == pytest.approx(AMBIENT + servo.stall_temperature_rise, rel=0.01)
    cooling = plant.temperature[0]
    plant.draw(np.zeros(op3.n), 1.0)
    assert plant.temperature[0] < cooling


def test_the_supply_sags_under_load_only(op3: Robot) -> None:
    plant = running(op3, resistance=0.2)
    step(plant, 1.0, 0.0)
    plant.draw(plant.torque, 0.008)
    assert plant.current == pytest.approx(20 * 2.3, rel=0.01)  # twenty servos at their stall current
    assert plant.voltage == pytest.approx(12.0 - 0.2 * plant.current)
    assert step(plant, 1.0, 0.0) < op3.stall_torque[0]
    step(plant, 0.0, 0.0)
    plant.draw(plant.torque, 0.008)
    assert plant.voltage == 12.0


def test_a_step_allocates_nothing_that_stays(op3: Robot) -> None:
    plant = running(op3, resistance=0.1)
    position, velocity = np.zeros(op3.n), np.ones(op3.n)
    for _ in range(100):
        plant.step(position, velocity)
        plant.draw(plant.torque, 0.008)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        plant.step(position, velocity)
        plant.draw(plant.torque, 0.008)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 2000
