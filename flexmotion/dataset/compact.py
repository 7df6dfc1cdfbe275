"""Compact form of a set, for transfer to a training machine: half precision, no activations, no mirror images.

Mirror images are exact (`biomechanics.mirror`) and computed where the set is used. Paths keep single precision: half
precision is too coarse ten metres from the origin.
"""

from __future__ import annotations

import io
import json
import lzma
import struct
from pathlib import Path

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.training_set import TrainingSet

MAGIC = b"FMSET1\n\0"
FULL = ("root_position",)
LEFT_OUT = ("activations", "infeasible")
"""Fields left out: activations are twice as many numbers as all other fields together."""

COMPUTED = ("mirror",)
"""Variants that are computed where the set is used."""

RELATIVE = ("centres",)
"""Positions written relative to the root, where half precision suffices."""


def export_compact(source: TrainingSet, path: Path) -> int:
    """Write the originals and the augmented clips of a set; return the size of the file [bytes]."""
    clips = [clip for clip in source.clips if clip.variant not in COMPUTED]
    fields = {name: field for name, field in source.manifest["fields"].items() if name not in LEFT_OUT}
    start, table = 0, []
    for clip in clips:
        table.append(clip.info | {"start": start})
        start += clip.frames
    keep = ("schema", "revision", "versions", "settings", "joints")
    header = {key: source.manifest[key] for key in keep} | {"frames": start, "clips": table, "fields": fields}
    buffer = io.BytesIO()
    text = json.dumps(header, sort_keys=True).encode()
    buffer.write(struct.pack("<q", len(text)) + text)
    for name in sorted(fields):
        dtype = _dtype(name, fields[name]["dtype"])
        values = np.concatenate([np.asarray(source[name][clip.rows]) for clip in clips])
        if name in RELATIVE:
            values = values - np.concatenate([source["root_position"][clip.rows, None] for clip in clips])
        values = values.astype(dtype)
        columns = values.reshape(len(values), -1).T
        # By column, with high and low bytes apart: neighbours in time are similar and compress well.
        planes = np.ascontiguousarray(columns).view(np.uint8).reshape(*columns.shape, dtype.itemsize)
        buffer.write(np.ascontiguousarray(np.moveaxis(planes, -1, 1)).tobytes())
    path.write_bytes(MAGIC + lzma.compress(buffer.getvalue(), preset=6))
    return path.stat().st_size


def read_compact(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Header (like a manifest) and arrays of a compact set. Raises `MotionFormatError`."""
    try:
        content = path.read_bytes()
        if not content.startswith(MAGIC):
            raise MotionFormatError(f"{path}: not a compact set")
        raw = lzma.decompress(content[len(MAGIC) :])
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror})") from error
    except lzma.LZMAError as error:
        raise MotionFormatError(f"{path}: damaged ({error})") from error
    (length,) = struct.unpack_from("<q", raw)
    header = json.loads(raw[8 : 8 + length])
    at, frames = 8 + length, header["frames"]
    arrays = {}
    for name, field in sorted(header["fields"].items()):
        dtype, shape = _dtype(name, field["dtype"]), tuple(field["shape"])
        columns = int(np.prod(shape, dtype=int))
        size = columns * frames * dtype.itemsize
        planes = np.frombuffer(raw, np.uint8, size, at).reshape(columns, dtype.itemsize, frames)
        values = np.ascontiguousarray(np.moveaxis(planes, 1, -1)).view(dtype).reshape(columns, frames)
        arrays[name] = np.ascontiguousarray(values.T).reshape(frames, *shape)
        at += size
    for name in RELATIVE:
        if name in arrays:
            arrays[name] = arrays[name] + arrays["root_position"][:, None]
    return header, arrays


def _dtype(name: str, dtype: str) -> np.dtype:
    return np.dtype(dtype if name in FULL or dtype == "bool" else "float16")
