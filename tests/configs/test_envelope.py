from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexmotion.configs.envelope import COPPER, Envelope
from flexmotion.configs.heat import AMBIENT
from flexmotion.configs.robot import load_robot
from flexmotion.drivers.plant import ServoPlant

ROBOT = load_robot("op3")  # hypothesis takes no fixtures
ENVELOPE = Envelope.of(ROBOT)
N, STALL, USABLE, FASTEST = ROBOT.n, ROBOT.stall_torque, ROBOT.usable_torque, ROBOT.no_load_speed

supplies = st.floats(10.2, 14.0)
speeds = st.floats(-8.0, 8.0)


@pytest.mark.parametrize(
    ("torque", "speed", "expected"), [(1.0, 1.0, 2.5), (-1.0, 1.0, 4.1), (1.0, -1.0, 4.1), (1.0, 0.0, 4.1)]
)
def test_limit_by_hand(torque: float, speed: float, expected: float) -> None:
    """XM430-W350: 2.5 N·m while it drives, 4.1 N·m while it brakes or stands."""
    assert ENVELOPE.limit(np.full(N, torque), np.full(N, speed)) == pytest.approx(np.full(N, expected))


def test_back_emf_takes_the_rest_at_speed() -> None:
    assert ENVELOPE.limit(np.ones(N), 0.9 * FASTEST) == pytest.approx(0.1 * STALL)
    assert ENVELOPE.limit(np.ones(N), 2 * FASTEST) == pytest.approx(np.zeros(N))
    lowest, highest = ENVELOPE.bounds(1.2 * FASTEST)
    assert highest == pytest.approx(-0.2 * STALL)
    assert lowest == pytest.approx(-STALL)


@given(speed=speeds, supply=supplies, aim=st.floats(-3.0, 3.0))
def test_servo_plant_gives_what_is_inside_and_no_more(speed: float, supply: float, aim: float) -> None:
    """The plant is written on its own: whatever its goal, its torque is within the envelope, and reaches its border."""
    plant = ServoPlant(ROBOT, supply=supply)
    plant.enabled[:] = True
    plant.goal[:] = aim
    torque, velocity = plant.step(np.zeros(N), np.full(N, speed)).copy(), np.full(N, speed)
    lowest, highest = ENVELOPE.at(supply).bounds(velocity)
    assert (torque >= lowest - 1e-9).all() and (torque <= highest + 1e-9).all()
    assert (ENVELOPE.at(supply).load(torque, velocity) <= 1 + 1e-9).all()
    plant.goal[:] = 3.0 if aim >= 0 else -3.0
    strongest = plant.step(np.zeros(N), velocity)
    border = highest if aim >= 0 else lowest
    if abs(speed) < 0.9 * FASTEST.min() * supply / 12.0:
        assert strongest == pytest.approx(border)


@given(torque=st.floats(-4.0, 4.0), speed=st.floats(-4.7, 4.7), supply=supplies, warm=st.floats(10.0, 79.0))
def test_load_is_1_on_the_border(torque: float, speed: float, supply: float, warm: float) -> None:
    envelope = ENVELOPE.at(supply, warm)
    torques, velocities = np.full(N, torque), np.full(N, speed)
    lowest, highest = envelope.bounds(velocities)
    load = envelope.load(torques, velocities)
    inside = (torques >= lowest) & (torques <= highest)
    near = np.abs(load - 1.0) < 1e-9
    assert (inside == (load <= 1.0))[~near].all()
    for border in (lowest, highest):
        if abs(border[0]) > 1e-6:
            assert envelope.load(border, velocities) == pytest.approx(np.ones(N))


def test_torque_scales_with_the_supply() -> None:
    low = ENVELOPE.at(0.85 * ROBOT.nominal_voltage)
    assert low.stall == pytest.approx(0.85 * STALL)
    assert low.usable == pytest.approx(0.85 * USABLE)
    assert low.limit(np.ones(N), 0.84 * FASTEST) == pytest.approx(0.01 * STALL)


def test_warm_windings_give_less_torque_at_the_same_fastest_speed() -> None:
    warm = ENVELOPE.at(temperature=75.0)
    assert warm.stall == pytest.approx(STALL / (1 + COPPER * 50))
    assert warm.stall / warm.back_emf == pytest.approx(FASTEST)
    assert warm.usable == pytest.approx(USABLE)  # gears and current limit it, not the windings
    assert ENVELOPE.at(temperature=0.0).stall == pytest.approx(STALL)


def test_a_servo_at_its_temperature_limit_gives_none() -> None:
    temperature = np.full(N, AMBIENT)
    temperature[3] = ENVELOPE.temperature_limit[3]
    shut = ENVELOPE.at(temperature=temperature)
    assert shut.limit(np.ones(N), np.zeros(N))[3] == 0.0
    load = shut.load(np.full(N, 0.1), np.zeros(N))
    assert np.isinf(load[3]) and load[2] == pytest.approx(0.1 / STALL[2])
    assert shut.load(np.zeros(N), np.zeros(N))[3] == 0.0


def test_unknown_supply_and_temperature_are_nominal() -> None:
    unknown = np.full((5, N), np.nan)
    rows = ENVELOPE.at(unknown, unknown)
    assert rows.stall.shape == (5, N)
    assert rows.limit(np.ones((5, N)), np.ones((5, N))) == pytest.approx(np.broadcast_to(USABLE, (5, N)))
    assert np.isnan(ENVELOPE.load(np.full(N, np.nan), np.zeros(N))).all()


def test_corners_are_on_the_border() -> None:
    speed, torque = ENVELOPE.corners(0)
    assert len(speed) == len(torque) == 10
    for one_speed, one_torque in zip(speed, torque, strict=True):
        if one_speed and one_torque:
            limit = ENVELOPE.limit(np.full(N, one_torque), np.full(N, one_speed))
            assert abs(one_torque) == pytest.approx(limit[0])


@given(cap=st.floats(0.01, 10.0), torque=st.floats(-5.0, 5.0), speed=speeds)
def test_a_cap_lowers_the_envelope_and_raises_nothing(cap: float, torque: float, speed: float) -> None:
    capped = ENVELOPE.capped(np.full(N, cap))
    torques, rates = np.full(N, torque), np.full(N, speed)
    assert (capped.limit(torques, rates) <= np.minimum(ENVELOPE.limit(torques, rates), cap)).all()
    assert (capped.load(torques, rates) >= ENVELOPE.load(torques, rates)).all()
    assert (capped.load(torques, rates) >= abs(torque) / cap).all()
