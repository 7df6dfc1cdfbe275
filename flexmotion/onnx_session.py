"""Exported networks as the live system runs them: one thread, no spinning."""

from __future__ import annotations

from pathlib import Path

import onnxruntime

from configs.errors import ConfigError


def open_session(path: Path) -> onnxruntime.InferenceSession:
    """An exported network, ready to run on one thread of the CPU.

    Raises:
        ConfigError: the file is missing or no network.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: not there")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    # Other processes share the cores: a waiting thread must sleep.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises several types that share no base but this one
        raise ConfigError(f"{path}: cannot be run ({str(error).splitlines()[0]})") from error
