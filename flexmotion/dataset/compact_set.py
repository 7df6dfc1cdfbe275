"""`CompactSet`: the compact form of a set as a set without activations, with computed mirror images."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from flexmotion.biomechanics.mirror import POLAR, mirror, mirrored_loads
from flexmotion.dataset.compact import read_compact
from flexmotion.dataset.fields import LOAD_SEGMENTS
from flexmotion.dataset.training_set import SetClip, TrainingSet
from flexmotion.human.motion import Motion

ORIGINAL, MIRROR = "original", "mirror"


class MotionSet(Protocol):
    """Interface of a set of either form."""

    @property
    def clips(self) -> tuple[SetClip, ...]:
        """Every clip."""
        ...

    @property
    def name(self) -> str:
        """Folder or file, and what is selected of it, for messages."""
        ...

    @property
    def hashes(self) -> dict[str, str]:
        """Hashes that identify its motion, whatever the clips' splits, labels and captions."""
        ...

    def select(self, split: str | None = None, variant: str | None = None) -> Iterator[SetClip]:
        """Clips of a split and of a variant; None for all."""
        ...

    def motion(self, clip: SetClip) -> Motion:
        """One clip with all its fields."""
        ...

    def centres(self, clip: SetClip) -> np.ndarray:
        """Reference points of the moments of its wrenches, (T, 2, 3) [m]."""
        ...

    def good(self, clip: SetClip) -> np.ndarray:
        """Whether ground forces explain its frames, (T,)."""
        ...

    def loads(self, clip: SetClip) -> np.ndarray:
        """External forces on torso, left hand and right hand, world axes, (T, 3, 3) [N]."""
        ...

    def force_error(self, clip: SetClip) -> np.ndarray:
        """Estimated standard error of the ground force on left and right foot, (T, 2) [body weights]."""
        ...


def open_set(path: Path) -> MotionSet:
    """A set from the folder of `data build` or the file of `data export`. Raises `MotionFormatError`."""
    return CompactSet(path) if path.is_file() else TrainingSet(path)


class CompactSet:
    """A set from its compact form, in memory; see `MotionSet`.

    Args:
        path: file of `export_compact`.

    Raises:
        MotionFormatError: the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._header, self._arrays = read_compact(path)
        self.name = str(path)

    @cached_property
    def clips(self) -> tuple[SetClip, ...]:
        """Every clip; originals are followed by their mirror images if the set was built with them."""
        keys = ("name", "start", "frames", "fps", "split", "variant")
        clips = []
        for item in self._header["clips"]:
            clip = SetClip(**{key: item[key] for key in keys}, info=item)
            clips.append(clip)
            if self._header["settings"]["mirrored"] and clip.variant == ORIGINAL:
                clips.append(replace(clip, name=f"{clip.name}~{MIRROR}", variant=MIRROR))
        return tuple(clips)

    @cached_property
    def hashes(self) -> dict[str, str]:
        """See `MotionSet`; of the arrays, not of the file: its header has the descriptions."""
        found = hashlib.sha256()
        for name, values in sorted(self._arrays.items()):
            found.update(f"{name} {values.dtype} {values.shape}".encode() + values.tobytes())
        return {"arrays": found.hexdigest()}

    def select(self, split: str | None = None, variant: str | None = None) -> Iterator[SetClip]:
        """See `MotionSet`."""
        for clip in self.clips:
            if split in (None, clip.split) and variant in (None, clip.variant):
                yield clip

    def motion(self, clip: SetClip) -> Motion:
        """See `MotionSet`."""

        def rows(name: str) -> np.ndarray:
            return np.asarray(self._arrays[name][clip.rows], np.float64)

        quaternion = rows("root_quaternion")
        motion = Motion(
            fps=clip.fps,
            body=clip.body,
            source=clip.info["source"],
            root_position=rows("root_position"),
            root_quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
            joints=rows("joints"),
            torques=rows("torques"),
            wrenches=rows("wrenches"),
            joint_contact=rows("joint_contact") if "joint_contact" in self._arrays else None,
            contacts=np.array(self._arrays["contacts"][clip.rows]),
        )
        return mirror(motion) if clip.variant == MIRROR else motion

    def centres(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        centres = np.asarray(self._arrays["centres"][clip.rows], np.float64)
        return centres[:, ::-1] * POLAR if clip.variant == MIRROR else centres

    def good(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        if "good" in self._arrays:
            return np.array(self._arrays["good"][clip.rows])
        # Files of 0.1.0 have residuals alone.
        settings, residual = self._header["settings"], self._arrays["residual"][clip.rows]
        return (residual[:, 0] <= settings["residual_force"]) & (residual[:, 1] <= settings["residual_moment"])

    def loads(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        loads = self._optional("loads", clip, (LOAD_SEGMENTS, 3))
        return mirrored_loads(loads) if clip.variant == MIRROR else loads

    def force_error(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        error = self._optional("force_error", clip, (2,))
        return error[:, ::-1] if clip.variant == MIRROR else error

    def _optional(self, field: str, clip: SetClip, shape: tuple[int, ...]) -> np.ndarray:
        if field not in self._arrays:
            return np.zeros((clip.frames, *shape))
        return np.asarray(self._arrays[field][clip.rows], np.float64)
