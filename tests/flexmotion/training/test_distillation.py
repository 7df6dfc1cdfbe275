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


def test_a_student_learns_what_its_teacher_makes_under_guidance(trained: Run, stages: Any) -> None:
    """One that has not learnt yet is its teacher without guidance: it misses at scale 3 alone."""
    teacher = stages.diffusion(trained)
    load_weights(teacher.network, trained.stage("diffusion"))
    missed = []
    for scale in (1.0, 3.0):
        distillation = trained.config.distillation.model_copy(update={"guidance_low": scale, "guidance_high": scale})
        config = trained.config.model_copy(update={"distillation": distillation})
        missed.append(float(DistillationTask(config, teacher, trained.seed).losses(0)[0].detach()))
    assert missed[0] < 1e-6 < 1e-4 < missed[1]


def test_half_of_the_times_are_those_at_which_samples_are_drawn(trained: Run, stages: Any) -> None:
    """Two of a thousand times decide what a sample of two steps is, and were drawn as seldom as the others."""
    teacher = stages.diffusion(trained)
    changed = {"sampling_steps": 2, "sampled": 0.5}
    diffusion = trained.config.diffusion.model_copy(update=changed)
    teacher.config = trained.config.model_copy(update={"diffusion": diffusion})
    times = teacher.times((1, 2), 2000).numpy()
    steps = teacher.noise.times(2).numpy()
    shares = [(times == step).mean() for step in steps]
    assert all(0.2 < share < 0.3 for share in shares) and len(set(times.tolist())) > 100
    assert times.min() >= 0 and times.max() < trained.config.diffusion.steps
