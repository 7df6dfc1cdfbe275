"""Writes networks as ONNX files."""

from __future__ import annotations

import logging
import os
import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

OPSET = 20
"""The first with an operator for the activation of the transformers (GELU), which is nine otherwise."""


def export_network(
    network: nn.Module,
    path: Path,
    inputs: dict[str, Tensor],
    outputs: list[str],
    dynamic: dict[str, dict[int, str]] | None = None,
) -> None:
    """Write a network as one ONNX file.

    Args:
        network: in evaluation mode.
        path: of the file.
        inputs: example of each input, in the order of the network's arguments.
        outputs: names of the results.
        dynamic: input -> axis -> name of the axes of variable length.
    """
    shapes = None
    if dynamic is not None:
        shapes = tuple(
            dict.fromkeys(dynamic[name], torch.export.Dim.DYNAMIC) if name in dynamic else None for name in inputs
        )
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    logging.getLogger("onnxscript").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            tuple(inputs.values()),
            str(path),
            input_names=list(inputs),
            output_names=outputs,
            opset_version=OPSET,
            dynamo=True,
            dynamic_shapes=shapes,
            external_data=False,
            verbose=False,
        )
    os.chmod(path, 0o644)
