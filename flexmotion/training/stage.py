"""`train_stage`: trains one network; can be stopped at any time and resumes bit for bit."""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import Stage
from flexmotion.training.checkpoints import (
    BEST,
    LAST,
    begun_from,
    fill,
    read_checkpoint,
    read_state,
    write_checkpoint,
)
from flexmotion.training.processes import Processes

log = logging.getLogger(__name__)

HISTORY = "history.jsonl"
CLIP_NORM = 1.0


class Task(Protocol):
    """What a stage trains."""

    @property
    def network(self) -> nn.Module:
        """Network whose parameters are trained."""
        ...

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """Loss of a batch, which depends on the step alone, and its named parts."""
        ...

    def validate(self) -> dict[str, float]:
        """Figures on held-out windows; the weights with the least `loss` are kept as the best."""
        ...


@runtime_checkable
class Closing(Protocol):
    """A task that has begun other processes."""

    def close(self) -> None:
        """End them; it may train again."""
        ...


@dataclass(frozen=True)
class Progress:
    """State of a stage.

    Attributes:
        step, steps: steps done, steps in all.
        parts: latest losses by name.
        figures: latest validation; empty before the first.
    """

    step: int
    steps: int
    parts: dict[str, float]
    figures: dict[str, float]


def train_stage(
    task: Task,
    stage: Stage,
    folder: Path,
    *,
    fingerprint: str,
    seconds: float | None = None,
    save_every: float = 180.0,
    progress: Callable[[Progress], None] = lambda progress: None,
    processes: Processes | None = None,
    pretrained: bool = False,
    stop: Callable[[], bool] = lambda: False,
) -> Progress:
    """Train until the stage's steps are done, the time is over or a stop is asked for, and save the state.

    A stage whose `best.pt` is of a release goes on at the step of those weights. A release has no state of the
    optimiser: its averages begin anew, and the learning rate rises once more over the stage's warm-up.

    `best.pt` holds the moving average of the weights, as of the validation with the least loss.

    Args:
        task: what to train.
        stage: steps, rates and batch.
        folder: of the stage: `last.pt` (state to resume from), `best.pt`, `history.jsonl`.
        fingerprint: of the configuration; a folder with another one is refused.
        seconds: time after which training stops [s]; None for no limit.
        save_every: time between saves [s].
        progress: called after every step.
        processes: that train; None for those of the environment.
        pretrained: the task starts with trained weights, which are kept unless better ones are found.
        stop: asked after every step, whether to save at once and end, in any process. Nothing is validated then.

    Returns:
        State at the end; after no step at all, or a stop before the first validation, the folder has no `best.pt`.

    Raises:
        ConfigError: the folder holds a training with another configuration or format.
    """
    group = processes or Processes()
    training = _Training(task, stage, folder, fingerprint, group)
    begun = training.resume_or_begin()

    def is_over() -> bool:
        return group.any(stop() or (seconds is not None and time.monotonic() - begin >= seconds))

    begin = saved = time.monotonic()
    try:
        if begun or (pretrained and not training.step):
            training.validate()
        while training.step < stage.steps and not is_over():
            training.advance()
            if training.step % stage.validate_every == 0 or training.step == stage.steps:
                training.validate()
            if time.monotonic() - saved > save_every:
                training.save()
                saved = time.monotonic()
            progress(training.progress)
        if training.step < stage.steps and group.any(stop()):
            training.save()
        else:
            training.end()
    finally:
        if isinstance(task, Closing):
            task.close()
    return training.progress


class _Training:
    """A stage's training: the network, its moving average, its optimiser, and how far it is."""

    def __init__(self, task: Task, stage: Stage, folder: Path, fingerprint: str, processes: Processes) -> None:
        self._task, self._stage, self._folder, self._fingerprint = task, stage, folder, fingerprint
        self._processes = processes
        folder.mkdir(parents=True, exist_ok=True)
        network = task.network.train()
        rate, decay = stage.learning_rate, stage.decay
        self._optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=decay, fused=True)
        self._average = AveragedModel(network, multi_avg_fn=_moving_average(stage.average))
        self._losses = processes.synchronised(network, task.losses)
        self._board = _board(folder) if processes.first else None
        self._least = math.inf
        self._parts: dict[str, float] = {}
        self._figures: dict[str, float] = {}
        self.step = 0
        self._first = 0  # step at which the optimiser began

    @property
    def progress(self) -> Progress:
        """How far it is."""
        return Progress(self.step, self._stage.steps, self._parts, self._figures)

    def resume_or_begin(self) -> bool:
        """Read the state in the folder, else the weights of a release, where there are any.

        Returns:
            Whether it begins from a release.

        Raises:
            ConfigError: they do not fit.
        """
        if begun_from(self._folder) is None:
            self._resume()
            return False
        best = read_checkpoint(self._folder / BEST, device=self._processes.device)
        fill(self._task.network, best["network"], self._folder / BEST)
        self._average.module.load_state_dict(self._task.network.state_dict())
        self.step = self._first = best["step"]
        # The average follows as slowly as after that many steps.
        self._average.n_averaged.fill_(self.step)
        self._processes.any(False)  # every process has read the weights before the first one writes
        self.save()
        return True

    def _resume(self) -> None:
        last = self._folder / LAST
        if not last.is_file():
            return
        state = read_state(last, device=self._processes.device)
        if state["fingerprint"] != self._fingerprint:
            raise ConfigError(f"{self._folder}: holds a training with other settings; use those, or another folder")
        try:
            self._task.network.load_state_dict(state["network"])
            self._average.load_state_dict(state["average"])
            self._optimiser.load_state_dict(state["optimiser"])
        except (RuntimeError, ValueError) as error:
            problem = str(error).splitlines()[0]
            raise ConfigError(f"{last}: of another version, start in an empty folder ({problem})") from error
        self.step, self._least, self._figures = state["step"], state["least"], state["figures"]
        self._first = state.get("first", 0)  # older ones began at 0
        log.info("%s: resumes at step %d", self._folder, self.step)

    def save(self) -> None:
        """Write the state to resume from."""
        if not self._processes.first:
            return
        state = {"network": self._task.network.state_dict(), "average": self._average.state_dict()}
        state["optimiser"] = self._optimiser.state_dict()
        where = {"fingerprint": self._fingerprint, "step": self.step, "least": self._least, "figures": self._figures}
        where["first"] = self._first
        write_checkpoint(state | where, self._folder / LAST)

    def advance(self) -> None:
        """Do one step of the optimiser."""
        for entry in self._optimiser.param_groups:
            entry["lr"] = _rate(self._stage, self.step, self._first)
        self._optimiser.zero_grad(set_to_none=True)
        loss, terms = self._losses(self.step)
        loss.backward()
        nn.utils.clip_grad_norm_(self._task.network.parameters(), CLIP_NORM)
        self._optimiser.step()
        self._average.update_parameters(self._task.network)
        self.step += 1
        self._parts = {name: float(value.detach()) for name, value in terms.items()}

    def validate(self) -> None:
        """Validate the averaged weights, and keep them where they are the best."""
        with _averaged_weights(self._task.network, self._average):
            self._figures = self._task.validate()
        if not self._processes.first:
            return
        row = {"step": self.step, "losses": self._parts, "validation": self._figures}
        with (self._folder / HISTORY).open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        if self._board is not None:
            for kind, values in (("validation", self._figures), ("training", self._parts)):
                for name, value in values.items():
                    self._board.add_scalar(f"{kind}/{name}", value, self.step)
        if self._figures["loss"] < self._least:
            self._least = self._figures["loss"]
            made = {"steps": self.step, "processes": self._processes.count, "batch": self._stage.batch}
            best = {"network": self._average.module.state_dict(), "step": self.step, "figures": self._figures}
            write_checkpoint(best | made, self._folder / BEST)

    def end(self) -> None:
        """Save, with best weights even where no validation was due."""
        best = self._folder / BEST
        if self.step and not best.is_file():
            self.validate()
        self.save()
        if self._processes.first and best.is_file():  # the training may go on long after its best weights
            write_checkpoint(read_checkpoint(best) | {"steps": self.step}, best)
        if self._board is not None:
            self._board.close()


def _moving_average(decay: float) -> Callable[..., None]:
    """Exponential moving average that follows fast at first, so that early validations see what has been learnt."""

    def update(averaged: Any, current: Any, count: Tensor) -> None:
        seen = int(count)
        get_ema_multi_avg_fn(min(decay, (1 + seen) / (10 + seen)))(averaged, current, count)

    return update


@contextmanager
def _averaged_weights(network: nn.Module, average: AveragedModel) -> Iterator[None]:
    """Give the network the averaged weights, in evaluation mode and without gradients, and its own back after."""
    trained = {name: value.detach().clone() for name, value in network.state_dict().items()}
    network.load_state_dict(average.module.state_dict())
    network.eval()
    try:
        with torch.no_grad():
            yield
    finally:
        network.train()
        network.load_state_dict(trained)


def _rate(stage: Stage, step: int, first: int) -> float:
    """Learning rate at a step; it rises from the step at which the optimiser began."""
    rise = min(1.0, (step - first + 1) / max(stage.warm_up, 1))
    left = (stage.steps - step) / max(stage.cool_down * stage.steps, 1.0)
    return stage.learning_rate * rise * min(1.0, left)


def _board(folder: Path) -> Any:
    """A TensorBoard writer where TensorBoard is installed, else None."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder / "board"))
