"""Checkpoints of a stage: `last.pt`, from which training resumes, and `best.pt`, the weights that are used."""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from flexmotion.bundles.card import Trained
from flexmotion.configs.errors import ConfigError
from flexmotion.training.format import CHECKPOINT_VERSIONS, FORMAT, UNVERSIONED

LAST, BEST = "last.pt", "best.pt"

BEGUN = "begun"
"""Key of `BEST` with the hash of the release that the weights are from; a training that has none trained them."""


def write_checkpoint(content: dict[str, Any], path: Path) -> None:
    """Write a checkpoint in one step: a training killed meanwhile resumes from the previous one."""
    temporary = path.with_suffix(".tmp")
    torch.save(content | {"format": FORMAT}, temporary)
    os.replace(temporary, path)


def read_checkpoint(path: Path, *, device: torch.device | None = None) -> dict[str, Any]:
    """Read a checkpoint.

    Args:
        path: of the file.
        device: of the tensors; None for the CPU.

    Raises:
        ConfigError: the file is damaged, too old or too new.
    """
    try:
        content: dict[str, Any] = torch.load(path, map_location=device or torch.device("cpu"), weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError) as error:
        problem = str(error).partition("\n")[0] or "ends too early"
        raise ConfigError(f"{path}: damaged ({problem})") from error
    CHECKPOINT_VERSIONS.check(content.get("format", UNVERSIONED), path)
    return content


def read_state(path: Path, *, device: torch.device | None = None) -> dict[str, Any]:
    """Read the checkpoint that a training resumes from, as one of `FORMAT`; see `read_checkpoint`."""
    state = read_checkpoint(path, device=device)
    if state.get("format", UNVERSIONED) < 2:
        # Every step averaged the weights once.
        average = {f"module.{name}": value for name, value in state["average"].items()}
        state["average"] = {"n_averaged": torch.tensor(state["step"])} | average
    return state


def is_trained(folder: Path) -> bool:
    """Whether a stage has weights."""
    return (folder / BEST).is_file()


def begun_from(folder: Path) -> str | None:
    """Hash of the release that a stage begins from; None once it has been trained further, or where it is new."""
    if not is_trained(folder) or (folder / LAST).is_file():
        return None
    found: str | None = read_checkpoint(folder / BEST).get(BEGUN)
    return found


def load_weights(network: nn.Module, folder: Path) -> int:
    """Load the best weights of a stage into a network; returns their step.

    Raises:
        ConfigError: the stage has not been trained, or has weights of another network.
    """
    path = folder / BEST
    if not is_trained(folder):
        raise ConfigError(f"{path}: not found; run 'flexmotion train {folder.name}' first")
    state = read_checkpoint(path)
    fill(network, state["network"], path)
    return int(state["step"])


def fill(network: nn.Module, weights: dict[str, Tensor], origin: Path | str) -> None:
    """Load weights into a network.

    Args:
        network: gets them.
        weights: by parameter.
        origin: of the weights, for messages.

    Raises:
        ConfigError: they are of another network; the message names the first parameter that does not fit.
    """
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise ConfigError(f"{origin}: weights of another network ({_misfit(network, weights)})") from error


def _misfit(network: nn.Module, weights: dict[str, Tensor]) -> str:
    expected = network.state_dict()
    for name, value in expected.items():
        if name not in weights:
            return f"{name}: missing"
        if value.shape != weights[name].shape:
            return f"{name}: {tuple(weights[name].shape)}, expected {tuple(value.shape)}"
    return f"{next(name for name in weights if name not in expected)}: not a parameter of this network"


def training_record(folder: Path) -> Trained:
    """How a stage was trained, and its validation figures.

    Raises:
        ConfigError: the checkpoint does not contain this; an older version wrote it.
    """
    best = read_checkpoint(folder / BEST)
    if "processes" not in best:
        raise ConfigError(f"{folder / BEST}: of an older version; run 'flexmotion train {folder.name}' again")
    return Trained(best["steps"], best["processes"], best["batch"], best["step"], best["figures"])


def digest(weights: Mapping[str, Tensor]) -> str:
    """SHA-256 of weights, to tell them apart; the sign of a zero does not count."""
    content = hashlib.sha256()
    for name in sorted(weights):
        # Half precision has negative zeros (underflows); an average of them is a positive one.
        content.update(name.encode() + (weights[name].detach().cpu().numpy() + 0.0).tobytes())
    return content.hexdigest()
