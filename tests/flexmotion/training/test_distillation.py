"""Which student of a distillation is the best."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("torch", reason="the extra 'train' is not installed")

from flexmotion.training.checkpoints import load_weights
from flexmotion.training.distillation_task import DistillationTask
from flexmotion.training.run import Run


def test_a_student_is_judged_by_its_samples(trained: Run, stages: Any) -> None:
    """Regression: students of a consistency loss were judged by it, and the best one was the one that had learnt least.

    A student begins as its teacher without guidance. With as many steps it makes the same samples where the scale is 1;
    not in one step, and not where the teacher is guided.
    """
    teacher = stages.diffusion(trained)
    load_weights(teacher.network, trained.stage("diffusion"))

    def judged(steps: int, scale: float) -> float:
        changed = {"sampling_steps": steps, "guidance_low": scale, "guidance_high": scale}
        distillation = trained.config.distillation.model_copy(update=changed)
        config = trained.config.model_copy(update={"distillation": distillation})
        return DistillationTask(config, teacher, trained.seed).validate()["loss"]

    steps = trained.config.diffusion.sampling_steps
    same = judged(steps, 1.0)
    assert same < 1e-6 and judged(1, 1.0) > 10 * same + 1e-6 and judged(steps, 4.0) > 10 * same + 1e-6
