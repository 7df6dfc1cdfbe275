"""A robot folder that a test may edit."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from flexmotion.configs.robot import ROBOTS, Robot, load_robot


@pytest.fixture(scope="session")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def spoiled(tmp_path: Path) -> Callable[..., Path]:
    """Call with a function that edits OP3's robot file; returns the folder of the edited copy."""

    def make(edit: Callable[[dict[str, Any]], None]) -> Path:
        folder = tmp_path / "mine"
        shutil.copytree(ROBOTS / "op3", folder)
        file = folder / "op3.yaml"
        content = yaml.safe_load(file.read_text())
        edit(content)
        file.unlink()
        (folder / "robot.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
        return folder

    return make
