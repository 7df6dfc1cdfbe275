"""Polynomials of muscle torques against the muscle models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")
pytest.importorskip("myo_sim", reason="muscles need the extra 'biomech'")

from flexmotion.biomechanics.dynamics import dynamics  # noqa: E402
from flexmotion.biomechanics.muscle_arms import LIMBS  # noqa: E402
from flexmotion.biomechanics.static_optimisation import static_optimisation  # noqa: E402
from flexmotion.dataset.fields import MUSCLES  # noqa: E402
from flexmotion.dataset.training_set import TrainingSet  # noqa: E402
from flexmotion.features.encode import encode  # noqa: E402
from flexmotion.features.layout import ACTIVATIONS, Layout  # noqa: E402
from flexmotion.human.motion import Motion  # noqa: E402
from flexmotion.training.human_tensors import HumanTensors  # noqa: E402
from flexmotion.training.muscle_torques import (  # noqa: E402
    fit_muscle_torques,
    joint_angles,
    load_muscle_torques,
)


def test_muscle_torques_are_those_of_the_joints(clip: Motion, small_set: Path, tmp_path: Path) -> None:
    fit_muscle_torques(TrainingSet(small_set), tmp_path / "muscles.npz")
    muscles = load_muscle_torques(tmp_path / "muscles.npz")
    found = dynamics(clip[285:315])
    state = static_optimisation(found.motion)
    motion = replace(found.motion, activations=state.activations)
    layout = Layout(motion.fps, MUSCLES)
    features = torch.from_numpy(encode(motion, layout, found.centres))[None]
    humans = HumanTensors.of([motion.body])

    angles = joint_angles(features, layout, humans)[0].numpy()
    legs = [at for at, name in enumerate(layout.joints) if name.startswith(("hip", "knee", "ankle", "lumbar"))]
    assert angles[:, legs] == pytest.approx(motion.joints[:, legs], abs=1e-3)

    residual = muscles.residual(features, layout, humans)[0].numpy()
    assert residual.shape == (len(motion) - 2, sum(map(len, LIMBS)))
    scale = motion.body.mass * 9.81 * motion.body.leg
    # Where the muscles can produce the torque.
    feasible = np.abs(state.missing[1:-1]) < 0.5
    assert motion.torques is not None
    assert np.median(np.abs(residual[feasible])) < 0.05 * np.abs(motion.torques[:, 6:]).max() / scale

    idle = features.clone()
    idle[..., layout.blocks[ACTIVATIONS]] = 0.0
    without = muscles.residual(idle, layout, humans)[0].numpy()
    assert np.sqrt(np.mean(without**2)) > 2 * np.sqrt(np.mean(residual**2))
