"""Reader of packed clips: one `.npz` with an array of 22 joint positions per clip, in millimetres."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.smpl import NAMES, joints22

FPS = 30.0
"""Frame rate of packed clips [1/s]; files do not contain it."""


def is_packed(content: Mapping[str, NDArray]) -> bool:
    """Whether every array of an archive is a clip of 22 joints."""
    return bool(content) and all(value.ndim == 3 and value.shape[1:] == (len(NAMES), 3) for value in content.values())


def read_packed(path: str, content: Mapping[str, NDArray], clip: str | None) -> Capture:
    """One clip of a packed file; `clip` may be None if it has only one.

    Raises:
        MotionFormatError: the clip does not exist, or none of several is named.
    """
    if clip is None and len(content) == 1:
        clip = next(iter(content))
    if clip is None or clip not in content:
        few = ", ".join(list(content)[:4])
        wanted = "name one of" if clip is None else f"no clip {clip!r} among"
        raise MotionFormatError(f"{path}: {wanted} its {len(content)} clips ({few}, …)")
    return joints22(content[clip], FPS, f"{path}:{clip}")
