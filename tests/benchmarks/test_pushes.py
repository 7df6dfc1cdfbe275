"""What the judge of pushes knows of a robot: its sole, and how far a push moves its divergent component."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.robot.pushes import PUSHED_S, pushed_by, sole_of, walker_of
from benchmarks.shared.branches import copied_memory
from flexmotion.configs.robot import load_robot
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.streamer import api

IMPULSE = np.array([1.2, -0.5])


def pendulum_after(driver: SimDriver, omega: float, impulse: np.ndarray, height: float) -> np.ndarray:
    """Divergent component at the end of a push [m], by the moments about the zero-moment point, at the origin.

    m z x'' = m g x + F h, in small steps; g / z is omega².
    """
    mass, z = float(driver.model.body_subtreemass[0]), float(driver.data.subtree_com[0][2])
    x, speed, steps = np.zeros(2), np.zeros(2), 20_000
    dt = PUSHED_S / steps
    for _ in range(steps):
        speed = speed + dt * (omega**2 * x + impulse / PUSHED_S * height / (mass * z))
        x = x + dt * speed
    return x + speed / omega


def test_the_sole_of_the_judge_was_the_wide_box_alone_and_ended_before_the_toes() -> None:
    """Pushed ahead, OP3 had its zero-moment point 7 mm beyond the sole that the judge gave it."""
    op3 = load_robot("op3")
    assert sole_of(op3) == pytest.approx([0.0635, 0.0390], abs=5e-4)
    assert (sole_of(op3) >= op3.sole_half_size.min(axis=0)).all()


def test_a_push_on_the_torso_was_counted_as_one_at_the_centre_of_mass() -> None:
    """It has .3 of it more moment about the ground. The pendulum that is integrated says how far it moves."""
    op3 = load_robot("op3")
    with copied_memory():
        opened = api.open_session(op3, create("sim", op3, seed=0), seed=0)
    with opened as session:
        driver, walker = session.driver, walker_of(session)
        assert isinstance(driver, SimDriver)
        torso, com = (float(point[2]) for point in (driver.data.xipos[op3.torso_id], driver.data.subtree_com[0]))
        moved = {height: pushed_by(driver, walker, IMPULSE, height=height) for height in (com, torso)}
        assert moved[torso] == pytest.approx(moved[com] * torso / com) and torso > 1.25 * com
        for height, jump in moved.items():
            # A jump at the begin of the push grows until its end.
            at_end = jump * np.exp(walker.omega * PUSHED_S)
            assert at_end == pytest.approx(pendulum_after(driver, walker.omega, IMPULSE, height), rel=1e-3)
