"""Labels of simulated variants satisfy the equations of motion that training evaluates."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.biomechanics.simulation.perturbation import Perturbation  # noqa: E402
from flexmotion.biomechanics.simulation.variant import perturbed  # noqa: E402
from flexmotion.features.encode import encode  # noqa: E402
from flexmotion.features.joint_groups import BALL_COLUMNS  # noqa: E402
from flexmotion.features.layout import Layout  # noqa: E402
from flexmotion.human.motion import Motion  # noqa: E402
from flexmotion.training.human_tensors import HumanTensors  # noqa: E402
from flexmotion.training.physics import EDGE, euler_residual  # noqa: E402


def test_a_slope_needs_no_load_in_the_residual_of_training(clip: Motion) -> None:
    """The floor is inclined, gravity is vertical: what is left is the assistance at the root."""
    answer = perturbed(clip[:40], 0, perturbation=Perturbation(slope=(0.05, 0.02)))
    found = answer.dynamics
    layout = Layout(found.motion.fps)
    features = torch.tensor(encode(found.motion, layout, found.centres), dtype=torch.float32)[None]
    branches = torch.tensor(np.sign(np.cos(found.motion.joints[None, :, BALL_COLUMNS[:, 1]])), dtype=torch.float32)
    residual = euler_residual(features, layout, HumanTensors.of([found.motion.body]), branches)
    force = residual.root[0, :, :3].norm(dim=-1).numpy()
    assert (force <= answer.assistance[EDGE:-EDGE, 0] + 0.01).all()
    assert residual.joints.abs().max() < 0.02
