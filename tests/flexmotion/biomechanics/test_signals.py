"""Derivatives and the smoothing spline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.biomechanics.differentiation import FIRST, SECOND, derivative, second_derivative
from flexmotion.biomechanics.smoothing import BALL_JOINTS, smooth, smoothing_spline
from flexmotion.human.angles import three_angle_rotation
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS


def test_stencils_are_central_differences_of_sixth_order() -> None:
    """Fornberg, Math. Comp. 51(184), 1988, table 1."""
    np.testing.assert_allclose(60 * FIRST, [-1, 9, -45, 0, 45, -9, 1], atol=1e-9)
    np.testing.assert_allclose(180 * SECOND, [2, -27, 270, -490, 270, -27, 2], atol=1e-9)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 6.0])
def test_derivatives_of_a_sine(frequency: float) -> None:
    fps, omega = 30.0, 2 * np.pi * frequency
    times = np.arange(90)[:, None] / fps
    inner = slice(5, -5)
    first = derivative(np.sin(omega * times), fps)[inner]
    second = second_derivative(np.sin(omega * times), fps)[inner]
    assert np.allclose(first, omega * np.cos(omega * times)[inner], atol=0.025 * omega)
    assert np.allclose(second, -(omega**2) * np.sin(omega * times)[inner], atol=0.01 * omega**2)


@pytest.mark.parametrize("frames", [3, 4, 7, 30])
def test_derivatives_of_a_parabola_hold_up_to_the_ends(frames: int) -> None:
    times = np.arange(frames) / 10.0
    assert np.allclose(derivative(times**2, 10.0), 2 * times)
    assert np.allclose(second_derivative(times**2, 10.0), 2.0)


@pytest.mark.parametrize(("differentiated", "weights"), [(derivative, FIRST), (second_derivative, SECOND)])
@pytest.mark.parametrize("frames", [3, 5, 7, 13, 14, 15, 60])
def test_ends_of_a_signal_go_on_as_parabolas(differentiated, weights, frames: int) -> None:
    signal = np.random.default_rng(0).normal(size=(frames, 4, 3))

    def beyond(last: np.ndarray) -> list[np.ndarray]:
        return [
            last[2] + k * (last[2] - last[1]) + k * (k + 1) / 2 * (last[2] - 2 * last[1] + last[0]) for k in (1, 2, 3)
        ]

    longer = np.array([*beyond(signal[:3][::-1])[::-1], *signal, *beyond(signal[-3:])])
    wanted = [np.tensordot(weights, longer[t : t + 7], 1) for t in range(frames)]
    order = 1 if differentiated is derivative else 2
    assert differentiated(signal, 30.0) == pytest.approx(30.0**order * np.array(wanted), abs=1e-10)


@pytest.mark.parametrize("frames", [1, 2])
def test_too_few_frames_have_no_acceleration(frames: int) -> None:
    assert np.allclose(second_derivative(np.zeros((frames, 3)), 30.0), 0.0)


def test_spline_keeps_parabolas_and_halves_the_cutoff() -> None:
    times = np.arange(200) / 30.0
    assert np.allclose(smoothing_spline(times**2, 30.0, 6.0), times**2)
    wave = np.sin(2 * np.pi * 6.0 * times)
    ratio = np.linalg.norm(smoothing_spline(wave, 30.0, 6.0)[20:-20]) / np.linalg.norm(wave[20:-20])
    assert ratio == pytest.approx(0.5, abs=0.02)


def test_rotations_are_smoothed_as_rotations(make_standing) -> None:
    # An arm that swings through gimbal lock at 1 Hz, well below the cut-off frequency.
    motion = make_standing(frames=90)
    swing = np.sin(2 * np.pi * np.arange(90) / 30.0)
    joints = motion.joints.copy()
    joints[:, JOINTS.index("shoulder_adduction_r")] = -np.pi / 2 + 0.3 * swing
    joints[:, JOINTS.index("shoulder_flexion_r")] = 0.8
    result: Motion = smooth(replace(motion, joints=joints))
    names, columns = BALL_JOINTS[-1][0], [JOINTS.index(f"{name}_r") for name in BALL_JOINTS[-1][0]]
    before, after = (three_angle_rotation(value[:, columns], names, "r") for value in (joints, result.joints))
    assert (before.inv() * after).magnitude().max() < 5e-3
