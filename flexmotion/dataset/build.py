"""`build`: folders of motion data to a training set; can be stopped at any time and resumed."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from flexmotion.dataset.clips import Clip, find_clips
from flexmotion.dataset.engines import ENGINES
from flexmotion.dataset.fields import FIELDS
from flexmotion.dataset.parts import is_whole, part_path, read, write
from flexmotion.dataset.report import Ranges, summary
from flexmotion.dataset.settings import REVISION, BuildSettings
from flexmotion.human.skeleton import JOINTS

SCHEMA = "flexmotion.set/1"
MANIFEST = "manifest.json"
WORK = "work"
LIBRARIES = ("flexmotion", "mujoco", "myo-sim", "numpy", "scipy")


def build(
    folders: Sequence[Path],
    out: Path,
    settings: BuildSettings,
    *,
    engine: str = "process",
    workers: int = 1,
    limit: int | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, Any]:
    """Build a set and return its manifest.

    Args:
        folders: of motion data (see `clips`).
        out: folder of the set; its folder `work` holds the parts of an unfinished build.
        settings: of the build.
        engine: one of `engines.ENGINES`.
        workers: number of processes.
        limit: greatest number of clips, spread over all.
        progress: called with the share done.

    Raises:
        MotionFormatError: a folder or an archive cannot be read (single unreadable clips are dropped and reported).
        ConfigError: the engine or the muscle models are not installed.
    """
    work = out / WORK
    parts = work / "parts"
    parts.mkdir(parents=True, exist_ok=True)
    clips = find_clips(folders, work)
    if limit is not None and limit < len(clips):
        clips = [clips[number * len(clips) // limit] for number in range(limit)]
    paths = [part_path(parts, clip, settings) for clip in clips]
    todo = [number for number, path in enumerate(paths) if not is_whole(path)]
    sizes = [_cost(clips[number]) for number in todo]
    done, total = 0.0, max(sum(sizes), 1e-9)
    # Long clips first, so that no core is left with one at the end.
    order = sorted(range(len(todo)), key=lambda at: -sizes[at])
    asked = [clips[todo[at]] for at in order]
    for number, content in ENGINES[engine](asked, settings, workers):
        write(paths[todo[order[number]]], content)
        done += sizes[order[number]]
        progress(done / total)
    return _assemble(clips, paths, out, settings)


def _cost(clip: Clip) -> float:
    """Approximate cost of a clip: the size of its file; members of packed files count as small."""
    return 1e5 if clip.member else float(clip.path.stat().st_size)


def _assemble(clips: list[Clip], paths: list[Path], out: Path, settings: BuildSettings) -> dict[str, Any]:
    """Combine the parts to one set, in the order of the clips' names."""
    fields = {name: field for name, field in FIELDS.items() if settings.muscles or not field.muscles}
    frames = 0
    kept: list[dict[str, Any]] = []
    dropped: list[dict[str, Any]] = []
    for path in paths:
        for entry in read(path):
            if entry.dropped:
                dropped.append({"name": entry.name, "reason": entry.dropped, **_brief(entry.info)})
                continue
            count = entry.info["frames"] = len(entry.arrays["joints"])
            kept.append({"name": entry.name, "start": frames, **entry.info})
            frames += count
    temporary = out / WORK / "arrays"
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    arrays = {
        name: np.lib.format.open_memmap(
            temporary / f"{name}.npy", mode="w+", dtype=np.dtype(field.dtype), shape=(frames, *field.shape)
        )
        for name, field in fields.items()
        if frames
    }
    ranges = Ranges(fields)
    start = 0
    for path in paths:
        for entry in read(path):
            if entry.dropped:
                continue
            count = len(entry.arrays["joints"])
            for name, array in arrays.items():
                array[start : start + count] = entry.arrays[name]
                ranges.add(name, entry.arrays[name])
            start += count
    for array in arrays.values():
        array.flush()
    arrays.clear()
    hashes = {}
    for path in sorted(temporary.glob("*.npy")):
        with path.open("rb") as file:
            hashes[path.name] = hashlib.file_digest(file, "sha256").hexdigest()
        path.replace(out / path.name)
    manifest = {
        "schema": SCHEMA,
        "revision": REVISION,
        "versions": {name: _version(name) for name in LIBRARIES},
        "settings": asdict(settings),
        "frames": frames,
        "joints": list(JOINTS),
        "muscles": _muscles() if settings.muscles else [],
        "fields": {name: asdict(field) for name, field in fields.items()},
        "sha256": hashes,
        "ranges": ranges.table(),
        "summary": summary(kept, dropped, settings),
        "clips": kept,
        "dropped": dropped,
    }
    write(out / MANIFEST, json.dumps(manifest, indent=1, sort_keys=True, ensure_ascii=False).encode())
    return manifest


def _brief(info: dict[str, Any]) -> dict[str, Any]:
    wanted = ("source", "collection", "split", "frames", "fps", "good_share", "labels")
    return {name: info[name] for name in wanted if name in info}


def _muscles() -> list[str]:
    from flexmotion.biomechanics.muscle_geometry import muscle_names

    return list(muscle_names())


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
