"""`CompactSet`: the compact form of a set as a set without muscles, with computed mirror images."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from flexmotion.biomechanics.mirror import POLAR, mirror
from flexmotion.dataset.compact import read_compact
from flexmotion.dataset.training_set import SetClip, TrainingSet
from flexmotion.human.motion import Motion

MIRROR = "mirror"


class MotionSet(Protocol):
    """Interface of a set of either form."""

    @property
    def clips(self) -> tuple[SetClip, ...]:
        """Every clip."""
        ...

    @property
    def hashes(self) -> dict[str, str]:
        """Hash that identifies the set."""
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
        self.hashes = {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}

    @cached_property
    def clips(self) -> tuple[SetClip, ...]:
        """Every clip, followed by its mirror image if the set was built with them."""
        keys = ("name", "start", "frames", "fps", "split", "variant")
        clips = []
        for item in self._header["clips"]:
            clip = SetClip(**{key: item[key] for key in keys}, info=item)
            clips.append(clip)
            if self._header["settings"]["mirrored"]:
                clips.append(replace(clip, name=f"{clip.name}~{MIRROR}", variant=MIRROR))
        return tuple(clips)

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
            contacts=np.array(self._arrays["contacts"][clip.rows]),
        )
        return mirror(motion) if clip.variant == MIRROR else motion

    def centres(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        centres = np.asarray(self._arrays["centres"][clip.rows], np.float64)
        return centres[:, ::-1] * POLAR if clip.variant == MIRROR else centres

    def good(self, clip: SetClip) -> np.ndarray:
        """See `MotionSet`."""
        settings, residual = self._header["settings"], self._arrays["residual"][clip.rows]
        return (residual[:, 0] <= settings["residual_force"]) & (residual[:, 1] <= settings["residual_moment"])
