"""What all tests share: real motion data and a trained model, where this machine has them."""

from __future__ import annotations

import os
import signal
import sys
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flexmotion.bundles.shipped import shipped_bundle

# The package `benchmarks` is not installed; at the end, so that an installed `flexmotion` is the one that is tested.
sys.path.append(str(Path(__file__).parents[1]))

SHARED, BUNDLE = "FLEXMOTION_SHARED", "FLEXMOTION_BUNDLE"
ARCHIVES = {"cmu": "cmu_raw.tar.xz", "bandai": "bandai.tar.xz"}


_ATTEMPTS = 3


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run tests of the program, or its processes, on the wall clock again where they fail.

    What the machine itself interrupts tells nothing of the program; pytest counts it. How often the program fails is
    measured by benchmarks/robot/faults.py, without repeats. One in lockstep that fails now and then has found a fault.
    """
    for item in items:
        if item.get_closest_marker("wall_clock") is not None:
            item.add_marker(pytest.mark.flaky(reruns=_ATTEMPTS - 1))


@pytest.fixture
def hears_hangup() -> Iterator[None]:
    """SIGHUP as it is without nohup, also in what is started. Went wrong: under nohup tests waited for it in vain."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the data sets, which are no part of the project: `$FLEXMOTION_SHARED/data` or `../shared/data`."""
    folder = Path(os.environ.get(SHARED) or Path(__file__).parents[1] / ".." / "shared") / "data"
    if not folder.is_dir():
        pytest.skip(f"no motion data: set {SHARED} to the folder that holds them")
    return folder


@pytest.fixture(scope="session")
def shared_clips(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., list[Path]]:
    """Function (set, names ...) -> files; reads the archive only as far as the last of them."""
    folder = tmp_path_factory.mktemp("clips")

    def extract(collection: str, *names: str) -> list[Path]:
        paths = [folder / f"{name}.bvh" for name in names]
        wanted = {path.name: path for path in paths if not path.exists()}
        archive = shared_data / ARCHIVES[collection]
        if wanted and not archive.is_file():
            pytest.skip(f"no {archive.name} in the motion data")
        if wanted:
            with tarfile.open(archive, "r|xz") as stream:
                for member in stream:
                    path = wanted.pop(Path(member.name).name, None)
                    content = stream.extractfile(member) if path else None
                    if path and content:
                        path.write_bytes(content.read())
                    if not wanted:
                        break
        return paths

    return extract


@pytest.fixture(scope="session")
def bundle() -> Path:
    """A trained model: `$FLEXMOTION_BUNDLE`, or the one that comes with the project."""
    folder = os.environ.get(BUNDLE) or shipped_bundle()
    if folder is None:
        pytest.skip(f"no model: set {BUNDLE} to the folder of a bundle")
    return Path(folder)
