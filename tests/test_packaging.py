"""The wheel: one import name, all code and data, and no conflict with packages and folders of the same names."""

from __future__ import annotations

import configparser
import os
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.drivers.imu import registry as imus
from flexmotion.drivers.registry import BUILT_IN, GROUP

ROOT = Path(__file__).parents[1]
BUNDLE_BYTES = 30_000_000
"""Upper bound on the size of the shipped model."""
LINKED = ("configs", "drivers", "retarget", "streamer")
"""Folders of the repository that are subpackages of `flexmotion` through a symbolic link."""

pytest.importorskip("hatchling", reason="hatchling builds the wheel (extra dev)")
pytest.importorskip("pip", reason="pip installs the wheel")


def build(target: str, project: Path, folder: Path) -> Path:
    """Build a project; the one file that results."""
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", folder],
        cwd=project,
        check=True,
        capture_output=True,
    )
    (file,) = (path for path in folder.iterdir() if path.is_file())
    return file


@pytest.fixture(scope="module")
def wheel_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", ROOT, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def wheel(wheel_file: Path) -> zipfile.ZipFile:
    return zipfile.ZipFile(wheel_file)


# ---------------------------------------------------------------- what is in the wheel


def test_every_file_of_every_package_is_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    for folder in (ROOT / "flexmotion", *(ROOT / "flexmotion" / name for name in LINKED)):  # rglob follows no links
        found = [path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
        assert found and {path.relative_to(ROOT).as_posix() for path in found} <= names
    assert "flexmotion/py.typed" in names


def test_data_of_each_kind_is_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    for suffix in (".yaml", ".xml", ".npz", ".html"):
        assert any(name.endswith(suffix) for name in names), suffix
    if shipped_bundle() is not None:
        assert "flexmotion/data/bundle/manifest.json" in names
        assert sum(wheel.getinfo(name).file_size for name in names if "/data/bundle/" in name) <= BUNDLE_BYTES


def test_script_and_driver_entry_points(wheel: zipfile.ZipFile) -> None:
    (file,) = (name for name in wheel.namelist() if name.endswith("entry_points.txt"))
    points = configparser.ConfigParser()
    points.read_string(wheel.read(file).decode())
    assert points["console_scripts"]["flexmotion"] == "flexmotion.streamer.__main__:main"
    assert dict(points[GROUP]) == BUILT_IN
    assert dict(points[imus.GROUP]) == imus.BUILT_IN


def test_torch_is_required_for_training_only(wheel: zipfile.ZipFile) -> None:
    (file,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
    required = [line for line in wheel.read(file).decode().splitlines() if line.startswith("Requires-Dist")]
    runtime = [line for line in required if "extra ==" not in line]
    assert runtime
    assert not any("torch" in line for line in runtime)
    assert any("torch" in line and "train" in line for line in required)


def test_the_source_distribution_builds_the_same_wheel(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    """It once lacked `flexmotion/configs` and `flexmotion/drivers`: hatch had already seen the targets of the links."""
    archive = build("sdist", ROOT, tmp_path / "sdist")
    with tarfile.open(archive) as file:
        file.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    other = zipfile.ZipFile(build("wheel", source, tmp_path / "wheel"))
    assert sorted(other.namelist()) == sorted(wheel.namelist())
    for name in wheel.namelist():
        if name.endswith("/RECORD"):  # it lists files in the order in which they were found
            assert sorted(other.read(name).splitlines()) == sorted(wheel.read(name).splitlines())
        else:
            assert other.read(name) == wheel.read(name), name


# ---------------------------------------------------------------- the wheel as it is installed


@dataclass
class Environment:
    """A virtual environment with the dependencies of this one, but without its `flexmotion`."""

    folder: Path

    @property
    def site(self) -> Path:
        """Where packages are installed."""
        return Path(sysconfig.get_path("purelib", "venv", {"base": str(self.folder)}))

    @property
    def names(self) -> set[str]:
        """Top-level import names that packages have installed."""
        return {path.stem for path in self.site.iterdir() if path.suffix not in (".dist-info", ".pth")} - {
            "__pycache__"
        }

    def pip(self, *arguments: str | Path) -> None:
        """Run pip for this environment, without an index."""
        command = [sys.executable, "-m", "pip", "--python", self.folder, "--quiet", "--disable-pip-version-check"]
        subprocess.run([*command, *arguments], check=True, capture_output=True, env=_plain_environment())

    def install(self, wheel: Path) -> None:
        self.pip("install", "--no-deps", "--no-index", "--no-compile", wheel)

    def run(self, program: str, *arguments: str, folder: Path) -> str:
        """Standard output of one of this environment's programs, with `folder` current and first on the import path."""
        environment = _plain_environment() | {"PYTHONPATH": str(folder)}
        command = [self.folder / "bin" / program, *arguments]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def dry_run(self, folder: Path) -> None:
        """Run the whole program for a moment: robot file, driver, retargeter, control loop, report."""
        self.run("flexmotion", "dry-run", "--clock", "lockstep", "--seconds", "0.2", "--json", folder=folder)


def _plain_environment() -> dict[str, str]:
    """Environment variables, without those by which Python finds packages elsewhere or compiles them with every run."""
    hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "__PYVENV_LAUNCHER__", "PYTHONDONTWRITEBYTECODE")
    return {name: value for name, value in os.environ.items() if name not in hidden}


@pytest.fixture(scope="module")
def dependencies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with links to the packages of this environment, except flexmotion."""
    folder = tmp_path_factory.mktemp("dependencies")
    for site in {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}:
        for path in Path(site).iterdir():
            if "flexmotion" not in path.name and path.suffix != ".pth":
                (folder / path.name).symlink_to(path)
    return folder


@pytest.fixture(scope="module")
def environment(dependencies: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Environment]:
    """Function (name) -> a fresh environment, nothing installed in it."""

    def make(name: str) -> Environment:
        folder = tmp_path_factory.mktemp(name)
        venv.create(folder, symlinks=True, with_pip=False)
        made = Environment(folder)
        (made.site / "dependencies.pth").write_text(f"{dependencies}\n", encoding="utf-8")
        return made

    return make


@pytest.fixture(scope="module")
def installed(environment: Callable[[str], Environment], wheel_file: Path) -> Environment:
    """An environment with the wheel installed; treat as read-only."""
    made = environment("installed")
    assert made.names == set()
    made.install(wheel_file)
    return made


def test_one_import_name_is_installed(installed: Environment) -> None:
    assert installed.names == {"flexmotion"}
    (record,) = installed.site.glob("flexmotion-*.dist-info/RECORD")
    files = [line.split(",")[0] for line in record.read_text(encoding="utf-8").splitlines()]
    tops = {name.split("/")[0] for name in files if not name.startswith("..")}
    assert tops == {"flexmotion", record.parent.name}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A user's project whose own packages have the names of our folders; none of them may be imported by us."""
    folder = tmp_path / "project"
    for name in (*LINKED, "tests", "benchmarks", "examples"):
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text(f"raise ImportError('{name} of the user')\n", encoding="utf-8")
    return folder


def test_it_runs_in_a_project_with_packages_of_the_same_names(installed: Environment, project: Path) -> None:
    """In such a folder the program once failed with `No module named 'configs.errors'`."""
    where = installed.run("python", "-c", "import flexmotion; print(flexmotion.__file__)", folder=project)
    assert Path(where.strip()) == installed.site / "flexmotion" / "__init__.py"
    installed.dry_run(project)


def test_a_package_with_a_folder_of_the_same_name_is_installed_and_removed_beside_it(
    environment: Callable[[str], Environment], wheel_file: Path, tmp_path: Path
) -> None:
    """Installing one once overwrote the other, and uninstalling it deleted files of the other."""
    toy = tmp_path / "toy"
    (toy / "streamer").mkdir(parents=True)
    (toy / "streamer" / "__init__.py").write_text("NAME = 'toy'\n", encoding="utf-8")
    (toy / "pyproject.toml").write_text(
        """
        [build-system]
        requires = ["hatchling"]
        build-backend = "hatchling.build"
        [project]
        name = "toy"
        version = "1"
        [tool.hatch.build.targets.wheel]
        packages = ["streamer"]
        """,
        encoding="utf-8",
    )
    empty = tmp_path / "empty"
    empty.mkdir()
    beside = environment("beside")
    beside.install(wheel_file)
    ours = {path: path.read_bytes() for path in (beside.site / "flexmotion").rglob("*") if path.is_file()}
    assert "op3" in beside.run("flexmotion", "robots", folder=empty)
    beside.install(build("wheel", toy, tmp_path / "wheel"))
    assert beside.names == {"flexmotion", "streamer"}
    assert beside.run("python", "-c", "import streamer; print(streamer.NAME)", folder=empty) == "toy\n"
    beside.dry_run(empty)
    beside.pip("uninstall", "--yes", "toy")
    assert beside.names == {"flexmotion"}
    assert {path: path.read_bytes() for path in ours} == ours
    beside.dry_run(empty)


LOADED = "print(*sorted(name for name in sys.modules if name.partition('.')[0] == 'flexmotion'))"
"""Program text: print the modules of ours that are loaded."""


def test_importing_the_package_imports_nothing_else(installed: Environment, tmp_path: Path) -> None:
    assert installed.run("python", "-c", f"import sys, flexmotion; {LOADED}", folder=tmp_path) == "flexmotion\n"


def test_drivers_load_configs_alone(installed: Environment, tmp_path: Path) -> None:
    """Every module of the drivers, imported: a servo bus needs neither the streamer nor human motion."""
    code = f"""
import importlib, pkgutil, sys
import flexmotion.drivers
for module in pkgutil.walk_packages(flexmotion.drivers.__path__, "flexmotion.drivers."):
    importlib.import_module(module.name)
{LOADED}
"""
    loaded = installed.run("python", "-c", code, folder=tmp_path).split()
    assert len(loaded) > 50
    rooms = {name.split(".")[1] for name in loaded if "." in name}
    assert {"drivers", "configs"} <= rooms <= {"drivers", "configs", "records", "spatial"}
