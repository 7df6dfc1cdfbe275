"""`TrainingSet`: a built set with memory-mapped arrays."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.dataset.build import MANIFEST, SCHEMA
from flexmotion.dataset.fields import LOAD_SEGMENTS
from flexmotion.human.body import Body, Segments
from flexmotion.human.motion import Motion


@dataclass(frozen=True)
class SetClip:
    """A clip in a set: `frames` rows from `start` on, and its entry in the manifest."""

    name: str
    start: int
    frames: int
    fps: float
    split: str
    variant: str
    info: dict[str, Any]

    @property
    def rows(self) -> slice:
        """Rows in every array."""
        return slice(self.start, self.start + self.frames)

    @property
    def body(self) -> Body:
        """The human of the clip."""
        row = dict(self.info["body"])
        fitted = row.pop("fitted")
        return Body(**row, fitted=Segments(**fitted) if fitted else None)


class TrainingSet:
    """A set in a folder; arrays are read on access.

    Args:
        folder: written by `build`.

    Raises:
        MotionFormatError: the folder is not a set, or has another version.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        path = self.folder / MANIFEST
        try:
            self.manifest: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise MotionFormatError(f"{path}: no set there ({error.strerror}); 'data build' makes one") from error
        except ValueError as error:
            raise MotionFormatError(f"{path}: damaged ({error})") from error
        if self.manifest.get("schema") != SCHEMA:
            raise MotionFormatError(f"{path}: schema is {self.manifest.get('schema')!r}, expected {SCHEMA!r}")

    def __len__(self) -> int:
        return int(self.manifest["frames"])

    def __getitem__(self, field: str) -> np.ndarray:
        """The memory-mapped array of a field, with a row per frame of all clips.

        Raises:
            MotionFormatError: the set lacks the field or its file.
        """
        if field not in self.manifest["fields"]:
            raise MotionFormatError(f"{self.folder}: no field {field!r}, expected {', '.join(self.manifest['fields'])}")
        try:
            array: np.ndarray = np.load(self.folder / f"{field}.npy", mmap_mode="r")
        except (OSError, ValueError) as error:
            raise MotionFormatError(f"{self.folder / field}.npy: cannot be mapped ({error})") from error
        return array

    @cached_property
    def clips(self) -> tuple[SetClip, ...]:
        """Every clip in the set."""
        keys = ("name", "start", "frames", "fps", "split", "variant")
        return tuple(SetClip(**{key: item[key] for key in keys}, info=item) for item in self.manifest["clips"])

    def select(self, split: str | None = None, variant: str | None = None) -> Iterator[SetClip]:
        """Clips of a split and of a variant (`original`, `mirror`, `varied`); None for all."""
        for clip in self.clips:
            if split in (None, clip.split) and variant in (None, clip.variant):
                yield clip

    @property
    def name(self) -> str:
        """See `MotionSet`."""
        return str(self.folder)

    @property
    def hashes(self) -> dict[str, str]:
        """Hash of all arrays, which identifies the set's motion."""
        found: dict[str, str] = self.manifest["sha256"]
        return found

    def centres(self, clip: SetClip) -> np.ndarray:
        """Reference points of the moments of a clip's wrenches, (T, 2, 3) [m]."""
        return np.asarray(self["centres"][clip.rows], np.float64)

    def good(self, clip: SetClip) -> np.ndarray:
        """Whether ground forces explain a clip's frames, (T,)."""
        return np.asarray(self["good"][clip.rows])

    def loads(self, clip: SetClip) -> np.ndarray:
        """External forces on torso, left hand and right hand, world axes, (T, 3, 3) [N]; zero where there are none."""
        return self._optional("loads", clip, (LOAD_SEGMENTS, 3))

    def force_error(self, clip: SetClip) -> np.ndarray:
        """Estimated standard error of the ground force on left and right foot, (T, 2) [body weights].

        Zero in sets that were built without it.
        """
        return self._optional("force_error", clip, (2,))

    def _optional(self, field: str, clip: SetClip, shape: tuple[int, ...]) -> np.ndarray:
        if field not in self.manifest["fields"]:
            return np.zeros((clip.frames, *shape))
        return np.asarray(self[field][clip.rows], np.float64)

    def motion(self, clip: SetClip) -> Motion:
        """One clip with all its fields."""
        names = ("root_position", "root_quaternion", "joints", "torques", "wrenches", "activations", "joint_contact")
        present = [name for name in names if name in self.manifest["fields"]]
        arrays: dict[str, Any] = {name: np.asarray(self[name][clip.rows], np.float64) for name in present}
        return Motion(
            fps=clip.fps,
            body=clip.body,
            contacts=np.array(self["contacts"][clip.rows]),
            source=clip.info["source"],
            mass_given=clip.info.get("mass_given"),
            **arrays,
        )

    def damaged(self) -> list[str]:
        """Files whose hash differs from the manifest."""
        wrong = []
        for name, expected in self.manifest["sha256"].items():
            path = self.folder / name
            if not path.is_file():
                wrong.append(name)
                continue
            with path.open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != expected:
                    wrong.append(name)
        return wrong
