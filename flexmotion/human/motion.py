"""`Motion`: human motion at a fixed frame rate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.body import Body
from flexmotion.human.skeleton import CONTACT_JOINTS, DOF_COUNT, JOINTS

Float = NDArray[np.float64]

DYNAMIC = ("torques", "wrenches", "pressure_centres", "activations", "joint_contact", "contacts")
"""Optional fields of a `Motion`: what moves it, and where it touches the ground."""

_KINEMATIC = ("root_position", "root_quaternion", "joints")

_SHAPES: dict[str, tuple[int, ...]] = {
    "root_position": (3,),
    "root_quaternion": (4,),
    "joints": (len(JOINTS),),
    "torques": (DOF_COUNT,),
    "wrenches": (2, 6),
    "pressure_centres": (2, 3),
    "joint_contact": (len(CONTACT_JOINTS), 3),
    "contacts": (2,),
}
"""Shapes of the fields of a frame."""


@dataclass(frozen=True)
class Motion:
    """Human motion at a fixed frame rate; world frame x forward, y left, z up, SI units.

    Attributes:
        fps: frames per second.
        root_position: pelvis origin (midpoint of the hip joints) in the world, (T, 3) [m].
        root_quaternion: pelvis orientation in the world, (T, 4), w x y z, unit norm, continuous in sign.
        joints: joint coordinates in the order of `skeleton.JOINTS`, (T, 26) [rad].
        body: size, sex and mass of the human.
        torques: generalised forces of root and joints, (T, 32) [N, N·m]; None where not computed.
        wrenches: ground reaction on the left and right foot in the world, (T, 2, 6) [N, N·m]: force, then moment
            about the centre of pressure; None where not computed.
        pressure_centres: those centres of pressure, on the floor, below the ankle of a foot in the air, (T, 2, 3) [m];
            None where not known.
        activations: muscle activations, (T, M) in [0, 1]; None where not computed.
        joint_contact: force on the segment beyond each of `skeleton.CONTACT_JOINTS`, in that segment's axes,
            (T, 7, 3) [N]; None where not computed.
        contacts: whether the left and right foot carry load, (T, 2) bool; None where not computed.
        source: a file name or `model:NAME`.
        mass_given: whether the mass of `body` is known (True) or a guess (False); None where nothing says it.
    """

    fps: float
    root_position: Float
    root_quaternion: Float
    joints: Float
    body: Body = field(default_factory=Body)
    torques: Float | None = None
    wrenches: Float | None = None
    activations: Float | None = None
    contacts: NDArray[np.bool_] | None = None
    source: str = ""
    joint_contact: Float | None = None
    mass_given: bool | None = None
    pressure_centres: Float | None = None

    def __post_init__(self) -> None:
        self._check(self.__dict__, len(self))

    def _check(self, names: Iterable[str], frames: int) -> None:
        """Raise `ValueError` where a field of these is not of so many frames or of another shape, or not finite."""
        for name in names:
            value, shape = getattr(self, name), _SHAPES.get(name)
            if shape is None or (value is None and name in DYNAMIC):
                continue
            if np.shape(value) != (frames, *shape):
                raise ValueError(f"Motion.{name} has shape {np.shape(value)}, expected {(frames, *shape)}")
            if value.dtype != np.bool_ and not _finite(value):
                raise ValueError(f"Motion.{name} has NaN or infinite values")
        if self.activations is not None and len(self.activations) != frames:
            raise ValueError(f"Motion.activations has {len(self.activations)} frames, expected {frames}")
        if not self.fps > 0:
            raise ValueError(f"Motion.fps is {self.fps}, expected a positive number")

    def changed(self, **fields: Any) -> Motion:
        """The motion with other values of some fields; what is left was checked when it was made.

        `dataclasses.replace` takes five times as long.

        Raises:
            TypeError: there is no such field.
            ValueError: see `Motion`.
        """
        unknown = fields.keys() - self.__dict__.keys()
        if unknown:
            raise TypeError(f"Motion has no {', '.join(sorted(unknown))}, expected some of {', '.join(self.__dict__)}")
        found = object.__new__(Motion)
        found.__dict__.update(self.__dict__ | fields)
        position = fields.get("root_position")
        frames = len(self) if position is None else len(position)
        # Of another number of frames, every field must be.
        found._check(fields if frames == len(self) else found.__dict__, frames)
        return found

    def trusted(self, **fields: Any) -> Motion:
        """`changed` without a check: of fields that are made of those of checked motions."""
        found = object.__new__(Motion)
        found.__dict__.update(self.__dict__ | fields)
        return found

    def __len__(self) -> int:
        return len(self.root_position)

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return max(len(self) - 1, 0) / self.fps

    @property
    def net_speed(self) -> float:
        """Speed of the root along the floor, straight from the first to the last frame [m/s]; 0 of a single frame."""
        way = self.root_position[-1, :2] - self.root_position[0, :2]
        return float(np.hypot(*way)) * self.fps / max(len(self) - 1, 1)

    def __getitem__(self, frames: slice) -> Motion:
        """The frames of a slice (views, not copies)."""
        # Made without `__init__`: what is finite and of the right shape is so in every slice of frames.
        found = object.__new__(Motion)
        found.__dict__.update(self.__dict__)
        for name in (*_KINEMATIC, *DYNAMIC):
            value = getattr(self, name)
            if value is not None:
                found.__dict__[name] = value[frames]
        return found

    @property
    def kinematics(self) -> Motion:
        """The motion without torques, forces, contacts and activations."""
        # Made without `__init__`: what is left was checked when this motion was made.
        found = object.__new__(Motion)
        found.__dict__.update(self.__dict__ | dict.fromkeys(DYNAMIC))
        return found


def _finite(values: NDArray[Any]) -> bool:
    """Whether all values are finite."""
    flat = values.ravel()
    # Their squares are, unless one of them is huge, too; it takes a third of the time.
    return math.isfinite(np.dot(flat, flat)) or bool(np.isfinite(values).all())
