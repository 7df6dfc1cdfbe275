"""Fields of a set, with a row per frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmotion.human.skeleton import DOF_COUNT, JOINTS

MUSCLES, MUSCLE_JOINTS, CROSSINGS, LOAD_SEGMENTS = 290, 13, 7, 3


@dataclass(frozen=True)
class Field:
    """An array with a row per frame.

    Attributes:
        shape: of a row.
        dtype: name of the NumPy type.
        unit: of the values, for people.
        muscles: whether it depends on muscles.
    """

    shape: tuple[int, ...]
    dtype: str
    unit: str
    muscles: bool = False

    def empty(self, frames: int) -> np.ndarray:
        """An array of zeros for a number of frames."""
        return np.zeros((frames, *self.shape), self.dtype)


FIELDS: dict[str, Field] = {
    "root_position": Field((3,), "float32", "m"),
    "root_quaternion": Field((4,), "float32", "w x y z"),
    "joints": Field((len(JOINTS),), "float32", "rad"),
    "torques": Field((DOF_COUNT,), "float32", "N, N·m"),
    "wrenches": Field((2, 6), "float32", "N, N·m about `centres`"),
    "centres": Field((2, 3), "float32", "m"),
    "contacts": Field((2,), "bool", "foot carries load"),
    "loads": Field((LOAD_SEGMENTS, 3), "float32", "N on torso, left hand, right hand"),
    "residual": Field((2,), "float32", "body weights, body weights x m"),
    "force_error": Field((2,), "float32", "body weights, standard error of the ground force on each foot"),
    "good": Field((), "bool", "residual and joints within limits"),
    "activations": Field((MUSCLES,), "float16", "0 to 1", muscles=True),
    "joint_contact": Field((CROSSINGS, 3), "float32", "N", muscles=True),
    "infeasible": Field((MUSCLE_JOINTS,), "bool", "muscles cannot make the torque", muscles=True),
}
