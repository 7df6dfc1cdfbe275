"""The wheel carries code and data: what runs from a checkout runs once installed."""

from __future__ import annotations

import configparser
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.drivers.imu import registry as imus
from flexmotion.drivers.registry import BUILT_IN, GROUP

ROOT = Path(__file__).parents[1]
BUNDLE_BYTES = 30_000_000
"""The shipped model may be so large."""
ROOMS = ("configs", "drivers", "flexmotion", "retarget", "streamer")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    pytest.importorskip("hatchling", reason="the wheel is built with hatchling (extra dev)")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (file,) = folder.glob("*.whl")
    return zipfile.ZipFile(file)


def test_every_file_of_every_room_is_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    carried = set(wheel.namelist())
    for room in ROOMS:
        files = {path for path in (ROOT / room).rglob("*") if path.is_file() and "__pycache__" not in path.parts}
        assert {path.relative_to(ROOT).as_posix() for path in files} <= carried
        assert f"{room}/py.typed" in carried


def test_data_of_each_kind_is_there(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    for suffix in (".yaml", ".xml", ".npz", ".html"):
        assert any(name.endswith(suffix) for name in names), suffix
    if shipped_bundle() is not None:
        assert "flexmotion/data/bundle/manifest.json" in names
        assert sum(wheel.getinfo(name).file_size for name in names if "/data/bundle/" in name) <= BUNDLE_BYTES


def test_nothing_else_is_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(ROOMS)


def test_script_and_driver_entry_points(wheel: zipfile.ZipFile) -> None:
    (file,) = (name for name in wheel.namelist() if name.endswith("entry_points.txt"))
    points = configparser.ConfigParser()
    points.read_string(wheel.read(file).decode())
    assert points["console_scripts"]["flexmotion"] == "flexmotion.streamer.__main__:main"
    assert dict(points[GROUP]) == BUILT_IN
    assert dict(points[imus.GROUP]) == imus.BUILT_IN


def test_runtime_asks_for_no_torch(wheel: zipfile.ZipFile) -> None:
    (file,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
    required = [line for line in wheel.read(file).decode().splitlines() if line.startswith("Requires-Dist")]
    runtime = [line for line in required if "extra ==" not in line]
    assert runtime
    assert not any("torch" in line for line in runtime)
    assert any("torch" in line and "train" in line for line in required)
