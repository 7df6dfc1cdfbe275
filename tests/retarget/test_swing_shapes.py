from __future__ import annotations

import numpy as np
import pytest

from flexmotion.configs.robot import Robot, load_robot
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.swing_effort import SwingEffort
from flexmotion.retarget.swing_shapes import TOLERANCE, Basis, Shape, between, fastest_shape, floor_clearance
from flexmotion.spatial.transitions import minimum_jerk, smoothstep


@pytest.fixture(scope="module")
def effort(op3: Robot, retargeter: Retargeter) -> SwingEffort:
    return SwingEffort(op3, retargeter.body.legs, retargeter.omega)


@pytest.fixture(scope="module", params=[-0.13, 0.08, 0.18])
def travel(request: pytest.FixtureRequest) -> np.ndarray:
    return np.array([request.param, 0.0, 0.0])


@pytest.fixture(scope="module")
def shape(effort: SwingEffort, travel: np.ndarray) -> Shape:
    found = fastest_shape(effort, travel)
    assert found is not None
    return found


def asked(effort: SwingEffort, progress: np.ndarray, lift: np.ndarray, travel: np.ndarray, seconds: float) -> float:
    found = effort.asked(progress[None], effort.gait.clearance * lift[None], travel[None], np.array([seconds]))
    return float(np.abs(found).max())


def test_the_shape_is_within_the_envelope_and_uses_it(effort: SwingEffort, shape: Shape, travel: np.ndarray) -> None:
    basis = Basis.at(effort.phase)
    most = asked(effort, basis.progress(shape), basis.height(shape), travel, shape.seconds)
    assert 0.9 < most <= 1.0 + TOLERANCE


def test_the_shape_keeps_to_what_the_floor_asks(effort: SwingEffort, shape: Shape) -> None:
    basis = Basis.at(effort.phase)
    progress, height = basis.progress(shape), basis.height(shape)
    assert (height >= floor_clearance(progress) - TOLERANCE).all()
    assert progress[0] == height[0] == pytest.approx(0.0) and progress[-1] == pytest.approx(1.0)


def test_it_asks_for_less_than_a_path_of_polynomials(effort: SwingEffort, shape: Shape, travel: np.ndarray) -> None:
    """Of a cubic and a quintic, which asked knees of OP3 for 1.6 times what they give."""
    s = effort.phase
    progress = 0.7 * smoothstep(s) + 0.3 * minimum_jerk(s)
    assert asked(effort, progress, 16.0 * (s * (1.0 - s)) ** 2, travel, shape.seconds) > 1.1


def test_a_mix_of_shapes_that_are_found_from_each_other_is_nearly_as_fast_as_both(effort: SwingEffort) -> None:
    """Went wrong: shapes of neighbouring travels were of two kinds, and the mix took a tenth longer than either."""
    travels = [np.array([travel, 0.0, 0.0]) for travel in (0.198, 0.176)]
    first = fastest_shape(effort, travels[0])
    assert first is not None
    second = fastest_shape(effort, travels[1], first)
    assert second is not None and second.seconds < first.seconds
    mixed, basis = between(first, second), Basis.at(effort.phase)
    most = asked(effort, basis.progress(mixed), basis.height(mixed), 0.5 * (travels[0] + travels[1]), mixed.seconds)
    # What the rotors ask falls with the square of the duration.
    assert most < 1.03**2


def test_the_same_robot_gives_the_same_shape(effort: SwingEffort, shape: Shape, travel: np.ndarray) -> None:
    again = fastest_shape(effort, travel)
    assert again is not None
    np.testing.assert_array_equal(np.append(again.progress, again.height), np.append(shape.progress, shape.height))
    assert again.seconds == shape.seconds


def test_servos_too_weak_for_the_leg_have_none(retargeter: Retargeter) -> None:
    weak = load_robot("op3")
    weak.usable_torque = weak.stall_torque = 0.02 * weak.usable_torque
    assert fastest_shape(SwingEffort(weak, retargeter.body.legs, retargeter.omega), np.array([0.1, 0.0, 0.0])) is None
