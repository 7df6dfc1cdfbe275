"""Parts: results of one clip, in one file each, from which a stopped build resumes."""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np

from flexmotion.dataset.clips import Clip
from flexmotion.dataset.enrich import Entry, enrich
from flexmotion.dataset.settings import BuildSettings


def part_path(folder: Path, clip: Clip, settings: BuildSettings) -> Path:
    """Path of a clip's part; it depends on file, labels and settings."""
    stat = clip.path.stat()
    key = [clip.name, clip.member, clip.path.name, stat.st_size, clip.split, clip.labels, settings.fingerprint()]
    key.append([[caption.start, caption.end, caption.text] for caption in clip.captions])
    return folder / (hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:24] + ".npz")


def compute(clip: Clip, settings: BuildSettings) -> bytes:
    """Content of the file of one clip's part."""
    arrays: dict[str, np.ndarray] = {}
    header = []
    for number, entry in enumerate(enrich(clip, settings)):
        header.append({"name": entry.name, "info": entry.info, "dropped": entry.dropped})
        arrays |= {f"{number}/{field}": value for field, value in entry.arrays.items()}
    buffer = io.BytesIO()
    np.savez(buffer, header=np.array(json.dumps(header, sort_keys=True)), **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def write(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    temporary.write_bytes(content)
    os.replace(temporary, path)


def read(path: Path) -> list[Entry]:
    """Entries of a part."""
    with np.load(path, allow_pickle=False) as archive:
        header = json.loads(str(archive["header"]))
        arrays: list[dict[str, np.ndarray]] = [{} for _ in header]
        for name in archive.files:
            number, slash, field = name.partition("/")
            if slash:
                arrays[int(number)][field] = archive[name]
    return [Entry(item["name"], item["info"], arrays[at], item["dropped"]) for at, item in enumerate(header)]


def is_whole(path: Path) -> bool:
    """Whether a part exists and can be read."""
    return path.is_file() and zipfile.is_zipfile(path)
