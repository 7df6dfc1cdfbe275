"""Clips in a folder of motion data: single files, archives, packed files, and their index tables.

*.bvh *.amc *.npy *.npz *.trc *.c3d clips
*.tar.xz, *.tar.gz, *.zip …        unpacked beside the set, then searched
*_index.csv                        `file` or `trial` -> split, content and style, or action
*_captions.csv                     see `captions`
texts/*.txt, train.txt, val.txt …  see `motion_language`
"""

from __future__ import annotations

import csv
import hashlib
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.captions import Caption, read_captions
from flexmotion.dataset.motion_language import is_mirror_image, is_split, is_text, read_split, read_texts
from flexmotion.dataset.splits import split_of
from flexmotion.importers.acclaim import find_skeleton
from flexmotion.importers.packed import is_packed
from flexmotion.importers.smpl import is_amass

LOOSE = (".bvh", ".amc", ".npy", ".trc", ".c3d")
"""Suffixes of files with one clip, the most informative first: rotations before joint centres."""

ARCHIVES = (".tar.xz", ".tar.gz", ".tgz", ".tar", ".zip")

DESCRIBING = ("content", "style", "action", "subject", "start_s", "left_s", "end_s", "around")
"""Columns of an index that describe a clip: its kind of motion (`content` or `action`), manner and subject; from when
to when it shows that kind, when it begins to leave it [s], and the kind that it shows before and after, where it does
not show it all the time."""

LICENCES = {
    "bandai": "CC BY-NC 4.0, Bandai Namco Research Inc.",
    "cmu": "CMU Graphics Lab Motion Capture Database, free for research and inside commercial products, not to be"
    " resold, mocap.cs.cmu.edu, NSF EIA-0196217",
}
"""Licences of known collections, by the name of their folder, archive or index."""


@dataclass(frozen=True)
class Clip:
    """One clip of a build.

    Attributes:
        name: unique name in the set, without suffix.
        path: of its file.
        member: name in a packed file; empty for a file of one clip.
        collection: `bandai`, `cmu` or the name of a folder.
        licence: of the collection; empty if unknown.
        split: `train`, `validation` or `test`.
        labels: columns of the index that describe its content.
        captions: sentences about it.
    """

    name: str
    path: Path
    member: str = ""
    collection: str = ""
    licence: str = ""
    split: str = "train"
    labels: dict[str, str] = field(default_factory=dict)
    captions: tuple[Caption, ...] = ()


def find_clips(folders: Iterable[Path], work: Path) -> list[Clip]:
    """Every clip in the folders, sorted by name; of several files of one name the most informative (see `LOOSE`).

    Args:
        folders: searched recursively.
        work: folder for unpacked archives.

    Raises:
        MotionFormatError: a folder is missing or has no clip, or an archive or table is damaged.
    """
    found: dict[str, tuple[int, Clip]] = {}
    index: dict[str, dict[str, str]] = {}
    captions: dict[str, list[Caption]] = {}
    files: list[tuple[str, Path]] = []
    for folder in folders:
        if not folder.is_dir():
            raise MotionFormatError(f"{folder}: no such folder of motion data")
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                files.append((_collection(path, folder), path))
    for collection, path in files.copy():
        if path.name.endswith("_index.csv"):
            index |= _read_index(path)
        elif path.name.endswith("_captions.csv"):
            captions |= read_captions(path)
        elif is_text(path):
            captions[path.stem] = read_texts(path)
        elif is_split(path):
            index |= read_split(path)
        elif path.name.lower().endswith(ARCHIVES):
            files += [(collection, member) for member in _unpacked(path, work)]
    for collection, path in files:
        for rank, name, member in _clips_in(path):
            if name in found and found[name][0] <= rank:
                continue
            labels = index.get(path.name) or index.get(name) or {}
            found[name] = (
                rank,
                Clip(
                    name=name,
                    path=path,
                    member=member,
                    collection=collection,
                    licence=LICENCES.get(collection, ""),
                    split=split_of(collection, f"{name}{path.suffix}", labels),
                    labels={key: labels[key] for key in DESCRIBING if key in labels},
                    captions=tuple(captions.get(name, ())),
                ),
            )
    if not found:
        raise MotionFormatError(f"{', '.join(str(folder) for folder in folders)}: no motion files there")
    return [clip for _, (_, clip) in sorted(found.items())]


def _collection(path: Path, folder: Path) -> str:
    """Known collection with which the name of a file or folder begins, else the name of the innermost folder."""
    for part in (path.name, *reversed(path.relative_to(folder).parts[:-1]), folder.name):
        known = next((name for name in LICENCES if part.lower().startswith(name)), None)
        if known:
            return known
    return path.parent.name


def _clips_in(path: Path) -> list[tuple[int, str, str]]:
    """Rank, name and member of every clip in a file; none if it is not a motion file."""
    suffix = path.suffix.lower()
    if suffix == ".amc" and find_skeleton(path) is None:
        # An unreadable file ranks behind every other of its name.
        return [(len(LOOSE) + 1, path.stem, "")]
    if suffix in LOOSE:
        return [] if suffix == ".npy" and is_mirror_image(path) else [(LOOSE.index(suffix), path.stem, "")]
    if suffix != ".npz":
        return []
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = archive.files
            if "header" in names or is_amass(dict.fromkeys(names, np.empty(0))):
                return [(0, path.stem, "")]
            if names and is_packed({names[0]: archive[names[0]]}):
                return [(len(LOOSE), name, name) for name in names]
    except (OSError, ValueError) as error:
        raise MotionFormatError(f"{path}: cannot be read ({error})") from error
    return []


def _unpacked(path: Path, work: Path) -> list[Path]:
    """Files of an archive, unpacked once; a marker file records completion."""
    folder = work / hashlib.sha256(f"{path.name} {path.stat().st_size}".encode()).hexdigest()[:12]
    done = folder.with_suffix(".done")
    if not done.exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        try:
            # Links, and paths out of the folder, are refused.
            shutil.unpack_archive(path, folder, filter=None if path.suffix == ".zip" else "data")
        except (shutil.ReadError, OSError, ValueError) as error:
            raise MotionFormatError(f"{path}: cannot be unpacked ({error})") from error
        done.touch()
    return sorted(member for member in folder.rglob("*") if member.is_file())


def _read_index(path: Path) -> dict[str, dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        key = next((name for name in ("file", "trial") if name in (reader.fieldnames or ())), None)
        if key is None:
            raise MotionFormatError(f"{path}: lacks a column 'file' or 'trial'")
        found = {}
        for number, row in enumerate(reader, 2):
            _check_times(f"{path}, line {number}", row)
            found[row[key]] = row
        return found


def _check_times(where: str, row: Mapping[str, str]) -> None:
    """Raise `MotionFormatError` where a row does not tell when its clip shows its kind as `meaning.shown` reads it."""
    if not row.get("end_s"):
        return
    missing = [name for name in ("start_s", "around") if not row.get(name)]
    if missing:
        raise MotionFormatError(f"{where}: has end_s and lacks {' and '.join(missing)}")
    try:
        times = [float(row[name]) for name in ("start_s", "left_s", "end_s") if row.get(name)]
    except ValueError as error:
        raise MotionFormatError(f"{where}: {error}") from error
    if not all(before <= after for before, after in pairwise(times)):
        raise MotionFormatError(f"{where}: expected start_s <= left_s <= end_s")
