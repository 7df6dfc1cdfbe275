"""Exported networks in onnxruntime: one thread, no spinning."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError


def open_session(path: Path) -> onnxruntime.InferenceSession:
    """A session of an exported network on one thread of the CPU.

    Raises:
        ConfigError: the file is missing or not a network.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: not there")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    # A waiting thread must sleep, since other processes share the cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises several types without a common base
        raise _cannot_run(path, error) from error


def run(session: onnxruntime.InferenceSession, path: Path, inputs: Mapping[str, NDArray]) -> NDArray[np.float32]:
    """The single output of a network opened from `path`.

    Raises:
        ConfigError: the network fails on these inputs.
    """
    try:
        (found,) = session.run(None, inputs)
    except Exception as error:  # see `open_session`
        raise _cannot_run(path, error) from error
    return found


def _cannot_run(path: Path, error: Exception) -> ConfigError:
    reason = next(iter(str(error).splitlines()), type(error).__name__)
    return ConfigError(f"{path}: cannot be run ({reason})")
