import numpy as np
import pytest

from flexmotion.drivers.sim.options import Push, RandomPushes, SimOptions
from flexmotion.drivers.sim.pushes import PushSchedule


def impulse(options: SimOptions, steps: int, seed: int = 0) -> np.ndarray:
    schedule = PushSchedule(options, np.random.default_rng(seed))
    total = np.zeros(3)
    for step in range(steps):
        force = schedule.force(step)
        if force is not None:
            total += force * options.timestep
    return total


@pytest.mark.parametrize("duration", [0.0001, 0.013, 0.1])
def test_a_push_delivers_its_impulse(duration: float) -> None:
    options = SimOptions(pushes=(Push(at=0.05, impulse=(0.2, -0.1, 0.0), duration=duration),))
    np.testing.assert_allclose(impulse(options, 200), [0.2, -0.1, 0.0])


def test_pushes_act_at_their_time_and_add_up() -> None:
    options = SimOptions(
        pushes=(Push(at=0.1, impulse=(1, 0, 0), duration=0.01), Push(at=0.104, impulse=(1, 0, 0), duration=0.01))
    )
    schedule = PushSchedule(options, np.random.default_rng(0))
    forces = [schedule.force(step) for step in range(70)]
    sizes = [0.0 if force is None else 1.0 for force in forces]
    assert sizes.index(1.0) == 50 and sum(sizes) == 7
    np.testing.assert_allclose(impulse(options, 100), [2, 0, 0])


def test_random_pushes_come_regularly_and_by_seed() -> None:
    options = SimOptions(random_pushes=RandomPushes(every_s=0.2, impulse=0.3, duration=0.02))
    assert not impulse(options, 100).any()  # none at the start
    first = impulse(options, 120)
    assert np.linalg.norm(first) == pytest.approx(0.3)
    np.testing.assert_array_equal(first, impulse(options, 120))
    assert not np.array_equal(first, impulse(options, 120, seed=1))


def test_a_push_can_be_added_while_the_robot_runs() -> None:
    schedule = PushSchedule(
        SimOptions(pushes=(Push(at=0.4, impulse=(1, 0, 0), duration=0.01),)), np.random.default_rng(0)
    )
    assert all(schedule.force(step) is None for step in range(50))
    schedule.add(Push(at=0.1, impulse=(0, 2, 0), duration=0.01))
    found = np.zeros((160, 3))
    for step in range(50, 210):
        force = schedule.force(step)
        found[step - 50] = 0.0 if force is None else force * 0.002
    np.testing.assert_allclose(found[:10].sum(axis=0), [0, 2, 0])
    np.testing.assert_allclose(found[10:].sum(axis=0), [1, 0, 0])  # the one from before still comes
