"""`Body`: size, sex and mass of a human, and the inertia of its segments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib import resources
from typing import Any, Literal, get_args

from flexmotion.configs.schema import yaml_content

Sex = Literal["male", "female"]


@dataclass(frozen=True)
class Segments:
    """Sizes of the skeleton in upright stance [m]; x forward, z up.

    Attributes:
        hip_width: distance of the two hip joint centres.
        thigh, shank: hip to knee, knee to ankle.
        ankle_height: ankle centre above the sole.
        foot: heel to toe tip along the sole.
        heel: ankle centre to the back of the heel, along the sole.
        ball: ankle centre to the toe joint, along the sole.
        lumbar_height, lumbar_forward: lumbar joint relative to the midpoint of the hips.
        neck_height, neck_forward: neck joint relative to the lumbar joint.
        head: neck joint to vertex.
        shoulder_width: distance of the two shoulder joint centres.
        shoulder_height, shoulder_forward: their midpoint relative to the lumbar joint.
        upper_arm, forearm: shoulder to elbow, elbow to wrist.
        hand: wrist to the centre of the closed fist.
        toe_out: angle from the knee's plane out to the foot's length [rad] (tibial torsion).
    """

    hip_width: float
    thigh: float
    shank: float
    ankle_height: float
    foot: float
    heel: float
    ball: float
    lumbar_height: float
    lumbar_forward: float
    neck_height: float
    neck_forward: float
    head: float
    shoulder_width: float
    shoulder_height: float
    shoulder_forward: float
    upper_arm: float
    forearm: float
    hand: float
    toe_out: float = 0.0

    @classmethod
    def of_height(cls, height: float) -> Segments:
        """Mean proportions of an adult `height` metres tall."""
        return cls(**{name: share * height for name, share in _data("proportions.yaml").items()})

    @property
    def leg(self) -> float:
        """Hip to ankle with a straight knee [m]."""
        return self.thigh + self.shank

    @property
    def arm(self) -> float:
        """Shoulder to wrist with a straight elbow [m]."""
        return self.upper_arm + self.forearm


@dataclass(frozen=True)
class Inertia:
    """Inertia of one segment, in the segment's upright frame (x forward, y left, z up).

    Attributes:
        mass: [kg].
        com: distance of the centre of mass from the proximal end, as a share of the segment's length.
        gyration: radii of gyration about x, y, z through the centre of mass, as shares of the segment's length.
    """

    mass: float
    com: float
    gyration: tuple[float, float, float]


@dataclass(frozen=True)
class Body:
    """A human; hashable, so that models are cached by it.

    Attributes:
        height: stature [m].
        mass: [kg].
        sex: column of the inertia table.
        fitted: segment sizes fitted to a clip; None for mean proportions of this height.
    """

    height: float = 1.75
    mass: float = 70.0
    sex: Sex = "male"
    fitted: Segments | None = None

    def __post_init__(self) -> None:
        for name in ("height", "mass"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Body.{name} is {value}, expected a positive number")
        if self.sex not in get_args(Sex):
            raise ValueError(f"Body.sex is {self.sex!r}, expected one of {', '.join(get_args(Sex))}")
        if self.fitted is not None:
            signed = ("lumbar_forward", "neck_forward", "shoulder_forward", "toe_out")
            for item in fields(self.fitted):
                value = getattr(self.fitted, item.name)
                if not math.isfinite(value) or (item.name not in signed and value <= 0):
                    raise ValueError(f"Body.fitted.{item.name} is {value}, expected a positive length")

    @property
    def segments(self) -> Segments:
        """Segment sizes: those fitted, else mean proportions of this height."""
        return self.fitted or Segments.of_height(self.height)

    @property
    def leg(self) -> float:
        """Hip to ankle with a straight knee [m]; strides scale with it."""
        return self.segments.leg

    @property
    def standing_height(self) -> float:
        """Height of the pelvis origin above the floor in upright stance [m]."""
        return self.segments.leg + self.segments.ankle_height

    def inertia(self, segment: str) -> Inertia:
        """Inertia of a segment of de Leva's table (`head`, `thigh`, ...) or of `torso` (upper and mid trunk as one).

        Raises:
            KeyError: the segment is unknown.
        """
        if segment == "torso":
            return self._torso()
        row = _data("de_leva_1996.yaml")[self.sex][segment]
        x, y, z = (radius / 100 for radius in row["gyration"])
        return Inertia(self.mass * row["mass"] / 100, row["com"] / 100, (x, y, z))

    def _torso(self) -> Inertia:
        """Upper and mid trunk as one rigid body (parallel axes); its proximal end is the omphalion."""
        table = _data("de_leva_1996.yaml")[self.sex]
        upper, middle = table["upper_trunk"], table["mid_trunk"]
        length = upper["length"] + middle["length"]
        mass = upper["mass"] + middle["mass"]
        centres = (
            length - upper["length"] * upper["com"] / 100,
            middle["length"] * (1 - middle["com"] / 100),
        )
        com = (upper["mass"] * centres[0] + middle["mass"] * centres[1]) / mass

        def radius(axis: int) -> float:
            square = 0.0
            for part, centre in zip((upper, middle), centres, strict=True):
                own = part["gyration"][axis] / 100 * part["length"]
                offset = centre - com if axis < 2 else 0.0
                square += part["mass"] * (own**2 + offset**2)
            return math.sqrt(square / mass) / length

        return Inertia(self.mass * mass / 100, com / length, (radius(0), radius(1), radius(2)))


@lru_cache
def _data(name: str) -> Mapping[str, Any]:
    text = resources.files("flexmotion").joinpath("data", name).read_text(encoding="utf-8")
    table: Mapping[str, Any] = yaml_content(text)
    return table
