"""`train_stage`: one network's training, which can be stopped at any time and goes on bit for bit where it was."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from flexmotion.bundles.card import Trained
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import Stage
from flexmotion.training.processes import Processes

log = logging.getLogger(__name__)

LAST, BEST, HISTORY = "last.pt", "best.pt", "history.jsonl"
CLIP_NORM = 1.0


class Task(Protocol):
    """What a stage trains."""

    @property
    def network(self) -> nn.Module:
        """Whose parameters are trained."""
        ...

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """Loss of a batch that depends on the step alone, and its parts."""
        ...

    def validate(self) -> dict[str, float]:
        """Figures on held-out windows; `loss` decides which weights are best."""
        ...


@dataclass(frozen=True)
class Progress:
    """Where a stage is.

    Attributes:
        step, steps: done, and wanted.
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
    goes_on: bool = False,
) -> Progress:
    """Train until the stage's steps are done or the time is over; the state is saved at either.

    Weights in `best.pt` are the running average of those trained, at the validation with the least loss.

    Args:
        task: what to train.
        stage: how.
        folder: of the stage: `last.pt` (all that is needed to go on), `best.pt`, `history.jsonl`.
        fingerprint: of the configuration; a folder of another one is refused.
        seconds: stop after so long; None for never.
        save_every: time between saves [s].
        progress: called after every step.
        processes: of a training over several, made by `torchrun`.
        goes_on: the task begins with trained weights, and only better ones take their place.

    Raises:
        ConfigError: the folder holds a training of another configuration or version.
    """
    group = processes or Processes()
    folder.mkdir(parents=True, exist_ok=True)
    network = task.network
    optimiser = torch.optim.AdamW(network.parameters(), lr=stage.learning_rate, weight_decay=stage.decay, fused=True)
    average = {name: value.detach().clone() for name, value in network.state_dict().items()}
    step, least, figures = 0, math.inf, {}
    last = folder / LAST
    if last.is_file():
        state = torch.load(last, map_location=group.device, weights_only=True)
        if state["fingerprint"] != fingerprint:
            raise ConfigError(f"{folder}: holds a training of other settings; use them, or another folder")
        try:
            network.load_state_dict(state["network"])
            optimiser.load_state_dict(state["optimiser"])
        except (RuntimeError, ValueError) as error:
            problem = str(error).splitlines()[0]
            raise ConfigError(f"{last}: of another version, begin in an empty folder ({problem})") from error
        average, step, least, figures = state["average"], state["step"], state["least"], state["figures"]
        log.info("%s: goes on at step %d", folder, step)

    def save() -> None:
        if group.first:
            content = {"fingerprint": fingerprint, "network": network.state_dict(), "average": average, "step": step}
            _save(content | {"optimiser": optimiser.state_dict(), "least": least, "figures": figures}, last)

    def validate() -> None:
        nonlocal least, figures
        trained = {name: value.detach().clone() for name, value in network.state_dict().items()}
        network.load_state_dict(average)
        network.eval()
        with torch.no_grad():
            figures = task.validate()
        network.train()
        network.load_state_dict(trained)
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
            how = {"steps": step, "processes": group.count, "batch": stage.batch}
            _save({"network": average, "step": step, "figures": figures} | how, folder / BEST)

    board = _board(folder) if group.first else None
    parts: dict[str, float] = {}
    begin = saved = time.monotonic()
    if goes_on and not step:
        validate()
    network.train()
    while step < stage.steps and not group.any(seconds is not None and time.monotonic() - begin >= seconds):
        for entry in optimiser.param_groups:
            entry["lr"] = _rate(stage, step)
        optimiser.zero_grad(set_to_none=True)
        loss, terms = task.losses(step)
        loss.backward()
        group.average_gradients(network)
        torch.nn.utils.clip_grad_norm_(network.parameters(), CLIP_NORM)
        optimiser.step()
        step += 1
        # The average follows fast at first, so that early validations see what has been learnt.
        keep = min(stage.average, (1.0 + step) / (10.0 + step))
        for name, value in network.state_dict().items():
            if value.dtype.is_floating_point:
                average[name].lerp_(value, 1.0 - keep)
            else:
                average[name].copy_(value)
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
    if group.first:  # a stage may have ended early, or long after its best weights
        _save(torch.load(folder / BEST, weights_only=True) | {"steps": step}, folder / BEST)
    if board is not None:
        board.close()
    return Progress(step, stage.steps, parts, figures)


def is_trained(folder: Path) -> bool:
    """Whether a stage has weights to be used."""
    return (folder / BEST).is_file()


def digest(weights: dict[str, nn.Parameter]) -> str:
    """Tells weights apart."""
    content = hashlib.sha256()
    for name in sorted(weights):
        content.update(name.encode() + weights[name].detach().cpu().numpy().tobytes())
    return content.hexdigest()


def load_weights(network: nn.Module, folder: Path) -> int:
    """The best weights of a stage into a network; returns the step that they are of.

    Raises:
        ConfigError: the stage has not been trained, or for another network.
    """
    path = folder / BEST
    if not is_trained(folder):
        raise ConfigError(f"{path}: not there; run 'flexmotion train {folder.name}' first")
    state = torch.load(path, map_location="cpu", weights_only=True)
    try:
        network.load_state_dict(state["network"])
    except RuntimeError as error:
        raise ConfigError(f"{path}: weights of another network ({str(error).splitlines()[0]})") from error
    return int(state["step"])


def trained(folder: Path) -> Trained:
    """How a stage was trained, and what it reached.

    Raises:
        ConfigError: it was trained by a version that did not write it down.
    """
    best = torch.load(folder / BEST, map_location="cpu", weights_only=True)
    if "processes" not in best:
        raise ConfigError(f"{folder / BEST}: of an older version; run 'flexmotion train {folder.name}' once more")
    return Trained(best["steps"], best["processes"], best["batch"], best["step"], best["figures"])


def _rate(stage: Stage, step: int) -> float:
    """Learning rate at a step."""
    rise = min(1.0, (step + 1) / max(stage.warm_up, 1))
    left = (stage.steps - step) / max(stage.cool_down * stage.steps, 1.0)
    return stage.learning_rate * rise * min(1.0, left)


def _save(content: dict, path: Path) -> None:
    """Whole or not at all: a training killed while it saves goes on from the save before."""
    temporary = path.with_suffix(".tmp")
    torch.save(content, temporary)
    os.replace(temporary, path)


def _board(folder: Path) -> Any:
    """A TensorBoard writer where TensorBoard is installed, else None."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder / "board"))
