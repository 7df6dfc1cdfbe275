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
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import Stage
from flexmotion.training.checkpoints import BEST, LAST, is_trained, read_checkpoint, write_checkpoint
from flexmotion.training.format import FORMAT
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
) -> Progress:
    """Train until the stage's steps are done or the time is over, and save the state.

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

    Returns:
        State at the end; after no step at all the folder has no `best.pt`.

    Raises:
        ConfigError: the folder holds a training with another configuration or format.
    """
    group = processes or Processes()
    folder.mkdir(parents=True, exist_ok=True)
    network = task.network
    optimiser = torch.optim.AdamW(network.parameters(), lr=stage.learning_rate, weight_decay=stage.decay, fused=True)
    average = AveragedModel(network, multi_avg_fn=_moving_average(stage.average))
    step, least, figures = 0, math.inf, {}
    last = folder / LAST
    if last.is_file():
        state = read_checkpoint(last, oldest=FORMAT, device=group.device)
        if state["fingerprint"] != fingerprint:
            raise ConfigError(f"{folder}: holds a training with other settings; use those, or another folder")
        try:
            network.load_state_dict(state["network"])
            average.load_state_dict(state["average"])
            optimiser.load_state_dict(state["optimiser"])
        except (RuntimeError, ValueError) as error:
            problem = str(error).splitlines()[0]
            raise ConfigError(f"{last}: of another version, start in an empty folder ({problem})") from error
        step, least, figures = state["step"], state["least"], state["figures"]
        log.info("%s: resumes at step %d", folder, step)
    losses = group.synchronised(network, task.losses)

    def save() -> None:
        if group.first:
            state = {"network": network.state_dict(), "average": average.state_dict()}
            state["optimiser"] = optimiser.state_dict()
            where = {"fingerprint": fingerprint, "step": step, "least": least, "figures": figures}
            write_checkpoint(state | where, last)

    def validate() -> None:
        nonlocal least, figures
        with _averaged_weights(network, average):
            figures = task.validate()
        if not group.first:
            return
        with (folder / HISTORY).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"step": step, "losses": parts, "validation": figures}) + "\n")
        if board is not None:
            for name, value in figures.items():
                board.add_scalar(f"validation/{name}", value, step)
            for name, value in parts.items():
                board.add_scalar(f"training/{name}", value, step)
        if figures["loss"] < least:
            least = figures["loss"]
            made = {"steps": step, "processes": group.count, "batch": stage.batch}
            best = {"network": average.module.state_dict(), "step": step, "figures": figures}
            write_checkpoint(best | made, folder / BEST)

    board = _board(folder) if group.first else None
    parts: dict[str, float] = {}
    begin = saved = time.monotonic()
    if pretrained and not step:
        validate()
    network.train()
    while step < stage.steps and not group.any(seconds is not None and time.monotonic() - begin >= seconds):
        for entry in optimiser.param_groups:
            entry["lr"] = _rate(stage, step)
        optimiser.zero_grad(set_to_none=True)
        loss, terms = losses(step)
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), CLIP_NORM)
        optimiser.step()
        step += 1
        average.update_parameters(network)
        parts = {name: float(value.detach()) for name, value in terms.items()}
        if step % stage.validate_every == 0 or step == stage.steps:
            validate()
        if time.monotonic() - saved > save_every:
            save()
            saved = time.monotonic()
        progress(Progress(step, stage.steps, parts, figures))
    if step and not is_trained(folder):
        validate()
    save()
    if group.first and is_trained(folder):  # the stage may have ended early, or long after its best weights
        write_checkpoint(read_checkpoint(folder / BEST) | {"steps": step}, folder / BEST)
    if board is not None:
        board.close()
    return Progress(step, stage.steps, parts, figures)


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


def _rate(stage: Stage, step: int) -> float:
    """Learning rate at a step."""
    rise = min(1.0, (step + 1) / max(stage.warm_up, 1))
    left = (stage.steps - step) / max(stage.cool_down * stage.steps, 1.0)
    return stage.learning_rate * rise * min(1.0, left)


def _board(folder: Path) -> Any:
    """A TensorBoard writer where TensorBoard is installed, else None."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder / "board"))
