"""Commands that train, without the libraries of training."""

from __future__ import annotations

import importlib.util
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from flexmotion.streamer.cli import execute


@pytest.mark.parametrize("absent", ["torch", "sklearn", "onnx", "onnxscript"])
@pytest.mark.parametrize(
    "command",
    [
        "train autoencoder -o OUT --set SET --config stream",
        *(f"train {stage} -o OUT" for stage in ("text", "diffusion", "distill", "forces", "evaluator")),
        "train listener BUNDLE -o OUT",
        "personalize TRAINING --set SET --manner Ada -o OUT",
        "evaluate TRAINING --bundle BUNDLE",
        "export TRAINING -o OUT",
    ],
)
def test_one_line_says_how_to_install_them(
    command: str, absent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find = importlib.util.find_spec

    def find_spec(name: str, package: str | None = None) -> ModuleSpec | None:
        return None if name == absent else find(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", find_spec)
    monkeypatch.chdir(tmp_path)
    assert execute(command.split()) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error and "pip install '.[train]'" in error
    assert not list(tmp_path.iterdir())
