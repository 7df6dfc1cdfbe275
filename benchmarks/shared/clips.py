"""Motion capture beside the project: where it lies, its archives, and lists of clips to run.

The data are no part of the project. They lie in the folder `data` of the folder that `FLEXMOTION_SHARED` names; by
default of `shared` beside the project.
"""

from __future__ import annotations

import os
import tarfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from flexmotion.configs.errors import ConfigError

VARIABLE = "FLEXMOTION_SHARED"
PROJECT = Path(__file__).resolve().parents[2]
ARCHIVES = {"bandai": "bandai.tar.xz", "cmu": "cmu_raw.tar.xz"}
"""Collections of BVH clips and their files."""


@dataclass(frozen=True)
class ListedClip:
    """A clip of a list.

    Attributes:
        kind: of motion, such as `walking`.
        name: of the clip in its collection.
        place: among the clips of its kind, from 0.
    """

    kind: str
    name: str
    place: int

    @property
    def perturbed(self) -> bool:
        """Whether it runs with the standard perturbations: every second clip of a kind does."""
        return self.place % 2 == 1


def data_folder() -> Path:
    """Folder of the motion data.

    Raises:
        ConfigError: there is none.
    """
    folder = Path(os.environ.get(VARIABLE) or PROJECT / ".." / "shared") / "data"
    if not folder.is_dir():
        raise ConfigError(f"no motion data: set {VARIABLE} to the folder that holds their folder `data`")
    return folder


def extract(collection: str, names: Collection[str], into: Path) -> None:
    """Unpack the named clips of a collection as `NAME.bvh`; reads the archive as far as the last of them.

    Raises:
        ConfigError: there are no motion data, or they have no such clip.
    """
    wanted = {f"{name}.bvh" for name in names}
    if not wanted:
        return
    archive = data_folder() / ARCHIVES[collection]
    if not archive.is_file():
        raise ConfigError(f"{VARIABLE}: no file {archive.name} among the motion data")
    with tarfile.open(archive, "r|xz") as stream:
        for member in stream:
            name = Path(member.name).name
            content = stream.extractfile(member) if name in wanted else None
            if content is not None:
                (into / name).write_bytes(content.read())
                wanted.discard(name)
            if not wanted:
                return
    raise ConfigError(f"{collection}: no clip {', '.join(sorted(wanted))}")


@contextmanager
def extracted(clips: Mapping[str, Collection[str]]) -> Iterator[Path]:
    """A folder with the named clips of each collection, for as long as the context lasts."""
    with TemporaryDirectory() as name:
        for collection, names in clips.items():
            extract(collection, names, Path(name))
        yield Path(name)


class ClipList:
    """Clips by kind of motion and collection, as a YAML file lists them.

    Args:
        file: kind -> collection -> names of clips.
        kinds: those to take; None for all.

    Raises:
        ConfigError: the file cannot be read, or names an unknown collection.
    """

    def __init__(self, file: Path, kinds: Sequence[str] | None = None) -> None:
        try:
            content: dict[str, dict[str, list[str]]] = yaml.safe_load(file.read_text(encoding="utf-8"))
        except (OSError, yaml.YAMLError) as error:
            raise ConfigError(f"{file}: cannot be read as a list of clips: {error}") from error
        if unknown := {name for own in content.values() for name in own} - set(ARCHIVES):
            known = ", ".join(ARCHIVES)
            raise ConfigError(f"{file}: unknown collections {', '.join(sorted(unknown))}, expected some of {known}")
        self._content = {kind: own for kind, own in content.items() if kinds is None or kind in kinds}

    @property
    def clips(self) -> list[ListedClip]:
        """Every clip, kind by kind."""
        return [
            ListedClip(kind, name, place)
            for kind, own in self._content.items()
            for place, name in enumerate(name for names in own.values() for name in names)
        ]

    @property
    def by_collection(self) -> dict[str, list[str]]:
        """Names of the clips of each collection."""
        found: dict[str, list[str]] = {}
        for own in self._content.values():
            for collection, names in own.items():
                found.setdefault(collection, []).extend(names)
        return found
