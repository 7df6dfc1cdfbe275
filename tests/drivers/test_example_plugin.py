"""The example driver in `examples/` is found by its entry point, and passes its own tests."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers import plugins, registry

pytestmark = pytest.mark.wall_clock

PACKAGE = Path(__file__).parents[2] / "examples" / "udp_driver"


def test_its_entry_point_names_a_driver(op3: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    entries = [
        EntryPoint(name, value, registry.GROUP) for name, value in project["entry-points"][registry.GROUP].items()
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: tuple(entries))
    monkeypatch.syspath_prepend(str(PACKAGE))
    assert registry.create("udp", op3, udp_port=9750).name == "udp"
    with pytest.raises(ConfigError, match="options of driver 'udp': field udp_port"):
        registry.create("udp", op3, udp_port=0)


def test_it_passes_its_own_tests() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=importlib", "tests"]
    done = subprocess.run(
        command, cwd=PACKAGE, env={"PYTHONPATH": f"{PACKAGE}:{PACKAGE.parents[1]}"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-2000:]
