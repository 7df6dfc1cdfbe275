"""Static optimisation, activation dynamics, and MuJoCo's muscle actuators with their results."""

from __future__ import annotations

import numpy as np
import pytest

from flexmotion.biomechanics.activation import activation_limits
from flexmotion.biomechanics.box_least_norm import Cost, box_least_norm
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS


def test_activation_rises_and_falls_as_in_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    step, rise, fall = 1 / 30, 0.01, 0.04
    limits = activation_limits(step, rise, fall)
    parameters = np.array([rise, fall, 0.0])
    for start in (0.0, 0.2, 0.7, 1.0):
        lower, upper = limits.bounds(np.array([start]))
        up = down = start
        for _ in range(20000):
            up += step / 20000 * mujoco.mju_muscleDynamics(1.0, up, parameters)
            down += step / 20000 * mujoco.mju_muscleDynamics(0.0, down, parameters)
        assert upper[0] == pytest.approx(up, abs=2e-3)
        assert lower[0] == pytest.approx(down, abs=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_box_least_norm_against_a_general_solver(seed: int) -> None:
    from scipy.optimize import lsq_linear

    generator = np.random.default_rng(seed)
    matrix = 30 * generator.standard_normal((5, 40))
    lower, upper = np.zeros(40), generator.uniform(0.2, 1.0, 40)
    target = matrix @ generator.uniform(0, 1.5, 40)
    found, _ = box_least_norm(matrix, target, lower, upper, np.zeros(5), Cost(weight=10.0))
    stacked = np.vstack([np.sqrt(10.0) * matrix, np.eye(40)])
    wanted = np.concatenate([np.sqrt(10.0) * target, np.zeros(40)])
    best = lsq_linear(stacked, wanted, (lower, upper), tol=1e-14)
    assert found == pytest.approx(best.x, abs=1e-4)


def test_soft_bound_against_a_general_solver() -> None:
    """A muscle was driven to its limit while others that could help rested."""
    from scipy.optimize import minimize

    generator = np.random.default_rng(3)
    matrix = generator.standard_normal((2, 8))
    target = matrix @ generator.uniform(0.3, 1.0, 8) * 1.5
    cost = Cost(weight=10.0, soft=0.6, steepness=9.0)
    found, _ = box_least_norm(matrix, target, np.zeros(8), np.ones(8), np.zeros(2), cost)

    def total(x: np.ndarray) -> float:
        over = np.maximum(x - 0.6, 0.0)
        return float(x @ x / 2 + 4.5 * over @ over + 5.0 * np.sum((target - matrix @ x) ** 2))

    best = minimize(total, np.full(8, 0.5), bounds=[(0.0, 1.0)] * 8, method="L-BFGS-B", options={"ftol": 1e-14})
    assert total(found) <= best.fun + 1e-6
    hard, _ = box_least_norm(matrix, target, np.zeros(8), np.ones(8), np.zeros(2), Cost(weight=10.0))
    assert found.max() < hard.max()


@pytest.fixture(scope="module")
def enriched(clip: Motion):
    pytest.importorskip("myo_sim", reason="extra 'biomech' is not installed")
    from flexmotion.biomechanics.dynamics import dynamics
    from flexmotion.biomechanics.static_optimisation import static_optimisation

    found = dynamics(clip[:330])
    return found, static_optimisation(found.motion)


def test_activations_keep_their_limits(enriched) -> None:
    from flexmotion.biomechanics.muscle_geometry import muscle_models

    _, state = enriched
    assert state.activations.shape[1] == 290
    assert state.activations.min() >= 0 and state.activations.max() <= 1
    column = 0
    for muscles in muscle_models():
        limits = activation_limits(1 / 30, *muscles.time_constants)
        mine = state.activations[:, column : column + muscles.model.nu]
        for before, after in zip(mine, mine[1:], strict=False):
            lower, upper = limits.bounds(before)
            assert (after >= lower - 1e-9).all() and (after <= upper + 1e-9).all()
        column += muscles.model.nu


def test_round_trip_through_mujocos_muscles(enriched) -> None:
    """MuJoCo's forward dynamics with these activations give the requested torque, of each leg and of the trunk."""
    from benchmarks.biomechanics.muscles import forward_torques

    found, state = enriched
    made = forward_torques(found.motion, state, every=5)
    wanted = found.motion.torques[::5, [6 + JOINTS.index(joint) for joint in state.joints]]
    close = []
    for part in (slice(0, 5), slice(5, 10), slice(10, 13)):
        error = np.linalg.norm((made - wanted)[:, part], axis=1)
        close.append(error <= 0.02 * np.linalg.norm(wanted[:, part], axis=1) + 0.1)
    assert np.mean(close) >= 0.9


def test_infeasible_joints_are_named(enriched, clip: Motion) -> None:
    from dataclasses import replace

    from flexmotion.biomechanics.static_optimisation import infeasible, static_optimisation

    found, _ = enriched
    torques = found.motion.torques[:20].copy()
    torques[:, 6 + JOINTS.index("knee_flexion_l")] = -3000.0
    motion = replace(found.motion[:20], torques=torques)
    state = static_optimisation(motion)
    bad = infeasible(state, motion)
    assert bad[:, state.joints.index("knee_flexion_l")].all()


def test_contact_forces_are_compressive(enriched) -> None:
    from flexmotion.biomechanics.joint_contact import joint_contact_forces

    found, state = enriched
    weight = found.motion.body.mass * 9.81
    force = joint_contact_forces(found, state)
    standing = force[:30, :, 2].mean(axis=0) / weight
    for crossing, value in zip(state.crossings, standing, strict=True):
        # In standing the joints of a leg carry a third of body weight plus muscle forces; the torso compresses the
        # lumbar joint. (Passive forces of MyoTorso alone exceed body weight.)
        assert 0.2 < (value if crossing == "lumbar" else -value) < 4.5, crossing


def test_cost_of_compression_relieves_hip_and_knee(enriched, monkeypatch: pytest.MonkeyPatch) -> None:
    """Σ a² alone loaded hip and knee by up to twice what instrumented implants measure."""
    from flexmotion.biomechanics import static_optimisation

    found, state = enriched
    motion = found.motion[:120]
    monkeypatch.setattr(static_optimisation, "COMPRESSION_COST", 0.0)
    without = static_optimisation.static_optimisation(motion)
    relieved = [state.crossings.index(name) for name in ("hip_l", "hip_r", "knee_l", "knee_r")]
    # Squared pull along the segments, which the cost adds up: one joint may carry more for another to carry less.
    # Of the first frames, in which both start from free activations.
    with_cost, free = (np.square(item.muscle_pull[:120, relieved, 1]).sum(axis=1) for item in (state, without))
    assert with_cost.mean() < free.mean()
