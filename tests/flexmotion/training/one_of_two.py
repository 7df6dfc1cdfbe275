"""What each process of `test_processes.py` does; started by `torchrun`: one_of_two.py TRAINING OUT."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch

from flexmotion.training.autoencoder_task import AutoencoderTask, load_autoencoder
from flexmotion.training.checkpoints import digest
from flexmotion.training.diffusion_task import DiffusionTask
from flexmotion.training.distillation_task import DistillationTask
from flexmotion.training.evaluator_task import EvaluatorTask
from flexmotion.training.personal import PersonalTask
from flexmotion.training.processes import Losses, Processes
from flexmotion.training.run import Run
from flexmotion.training.stage import Task, train_stage

STEP = 2
"""Step whose gradients are compared; the diffusion rolls out from there on."""


def all_tasks(run: Run, processes: Processes) -> dict[str, Task]:
    """Every stage's task."""
    store = run.store()

    def encode(sentence: str) -> np.ndarray:
        return np.random.default_rng(len(sentence)).normal(size=run.config.diffusion.text)

    def diffusion(*manner: str) -> DiffusionTask:
        return DiffusionTask(run.config, store, load_autoencoder(run), encode, run.seed, processes, *manner)

    return {
        "autoencoder": AutoencoderTask(run.config, store, run.seed, processes),
        "forces": AutoencoderTask(run.config, store, run.seed, processes, trained=run.stage("autoencoder")),
        "diffusion": diffusion(),
        "distill": DistillationTask(run.config, diffusion(), run.seed),
        "personalize": PersonalTask(diffusion(), diffusion("like Ada", "train")),
        "evaluator": EvaluatorTask(run.config, store, encode, run.seed, processes),
    }


def gradients(task: Task, losses: Losses) -> dict[str, torch.Tensor]:
    """Gradients of a task's network by the losses of `STEP`."""
    task.network.zero_grad()
    losses(STEP)[0].backward()
    return {name: value.grad for name, value in task.network.named_parameters() if value.grad is not None}


def main(training: Path, out: Path) -> None:
    """Write this process' gradients of every task and the digest of its weights after a training."""
    run, processes = Run(training), Processes()
    tasks = all_tasks(run, processes)
    found = {name: gradients(task, processes.synchronised(task.network, task.losses)) for name, task in tasks.items()}
    task = tasks["autoencoder"]
    train_stage(task, run.config.stages.autoencoder, out / "stage", fingerprint="", processes=processes)
    weights = digest(dict(task.network.named_parameters()))
    torch.save({"gradients": found, "weights": weights}, out / f"rank{processes.rank}.pt")
    processes.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
