"""What all tests share: settings of hypothesis, and motion data and a model where this machine has them."""

from __future__ import annotations

import gc
import os
import signal
import sys
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from flexmotion.bundles.shipped import shipped_bundle

# The package `benchmarks` is not installed; at the end, so that an installed `flexmotion` is the one that is tested.
sys.path.append(str(Path(__file__).parents[1]))

SHARED, BUNDLE = "FLEXMOTION_SHARED", "FLEXMOTION_BUNDLE"
ARCHIVES = {"cmu": "cmu_raw.tar.xz", "bandai": "bandai.tar.xz"}

settings.register_profile(
    "flexmotion",
    deadline=None,  # the time of one example depends on the machine
    suppress_health_check=[HealthCheck.too_slow],  # likewise
    derandomize=True,  # the same examples in every run
)
settings.load_profile("flexmotion")


def pytest_collection_finish() -> None:
    """Leave what is loaded by now out of garbage collection.

    Processes of a run are forked from this one, and each collects garbage when it begins: it took a second in every one
    to walk through torch and six thousand tests, which copied their memory.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture
def hears_hangup() -> Iterator[None]:
    """SIGHUP with its default action, also in child processes; under `nohup` it is ignored, and tests of it hung."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def hears_interrupt() -> Iterator[None]:
    """SIGINT as in the foreground of a shell, also in child processes; ignored in its background, where a test hung."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


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
