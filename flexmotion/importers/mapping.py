"""Mappings from the joints of a file's skeleton to those of the human: shipped, of a user, or guessed by name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from flexmotion.configs.errors import ConfigError, MotionFormatError
from flexmotion.configs.schema import Strict, load, yaml_content
from flexmotion.human.skeleton import SIDES
from flexmotion.importers.marker_landmarks import LANDMARKS

Units = Literal["m", "cm", "mm", "inch"]
Up = Literal["y", "z"]

LEG_POINTS, ARM_POINTS = ("hip", "knee", "ankle", "toe"), ("shoulder", "elbow", "wrist")
SIDED_POINTS = LEG_POINTS + ARM_POINTS
REQUIRED_POINTS: tuple[str, ...] = tuple(f"{point}_{side}" for side in SIDES for point in LEG_POINTS)
OPTIONAL_POINTS = ("neck", "lumbar", "head", *(f"{point}_{side}" for side in SIDES for point in ARM_POINTS))
POINTS = REQUIRED_POINTS + OPTIONAL_POINTS
"""Points of a mapping: joint centres. `toe` is the toe joint, or the end of a foot without toes, `lumbar` the lowest
joint of the spine above the pelvis, `neck` its uppermost joint below the head."""

SEGMENTS = ("pelvis", "chest", "head", "hand_l", "hand_r")
"""Segments whose orientation a mapping may declare."""

AXES = {
    f"{sign}{axis}": value * np.eye(3)["xyz".index(axis)] for axis in "xyz" for sign, value in (("+", 1), ("-", -1))
}


class Orientation(Strict):
    """Axes of a joint's own frame that point forward and up while the human stands with hanging arms.

    For a hand, forward is out of the palm and up is towards the elbow.
    """

    joint: str
    forward: str
    up: str

    @field_validator("forward", "up")
    @classmethod
    def _is_axis(cls, value: str) -> str:
        if value not in AXES:
            raise ValueError(f"{value!r} is not an axis, expected one of {', '.join(AXES)}")
        return value

    def matrix(self) -> NDArray[np.float64]:
        """Columns: the segment's x (forward), y (left), z (up) in the joint's frame, (3, 3)."""
        forward, up = AXES[self.forward], AXES[self.up]
        return np.stack([forward, np.cross(up, forward), up], axis=1)


def _check_known(kind: str, names: Iterable[str], known: Iterable[str]) -> None:
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ValueError(f"unknown {kind} {unknown[0]!r}, expected one of {', '.join(known)}")


class SkeletonMapping(Strict):
    """A named mapping: either `joints`, point -> joint of the file, or `markers`, landmark -> surface markers.

    A joint is a name, or the mean of several, `A + B`. A landmark is the same, or the first of several in the file,
    `A | B`, or a cluster of any of them, `A, B`. Names are compared without case, `.`, `_`, `-` and spaces. A file may
    lack optional points and any landmark that `marker_joints` can do without.
    `up` and `units` are guessed from the motion if left out.
    """

    name: str
    up: Up | None = None
    units: Units | None = None
    joints: dict[str, str] = Field(default_factory=dict)
    markers: dict[str, str] = Field(default_factory=dict)
    orientations: dict[str, Orientation] = Field(default_factory=dict)

    @field_validator("joints")
    @classmethod
    def _has_points(cls, value: dict[str, str]) -> dict[str, str]:
        _check_known("point", value, POINTS)
        missing = [point for point in REQUIRED_POINTS if point not in value] if value else []
        if missing:
            raise ValueError(f"missing {', '.join(missing)}")
        return value

    @field_validator("markers")
    @classmethod
    def _has_landmarks(cls, value: dict[str, str]) -> dict[str, str]:
        _check_known("landmark", value, LANDMARKS)
        return value

    @field_validator("orientations")
    @classmethod
    def _has_segments(cls, value: dict[str, Orientation]) -> dict[str, Orientation]:
        _check_known("segment", value, SEGMENTS)
        return value

    @model_validator(mode="after")
    def _is_one_kind(self) -> SkeletonMapping:
        if bool(self.joints) == bool(self.markers):
            raise ValueError("expected either 'joints' or 'markers'")
        return self

    def missing(self, names: Iterable[str]) -> list[str]:
        """Joints of required points and orientations of this mapping that are not among the names."""
        used = {name for point in REQUIRED_POINTS for name in markers(self.joints.get(point, point))}
        used |= {item.joint for item in self.orientations.values()}
        return sorted(used - set(names))

    def present(self, names: Iterable[str]) -> SkeletonMapping:
        """The mapping without the optional points that need a joint the file lacks."""
        known = set(names)
        kept = {point: joint for point, joint in self.joints.items() if known.issuperset(markers(joint))}
        return self.model_copy(update={"joints": kept})

    def landmarks(self, names: Iterable[str]) -> dict[str, list[list[str]]]:
        """Landmark -> its markers in the file: a list of clusters' members, each the markers whose mean it is."""
        own = {plain(name): name for name in reversed(list(names))}
        found = {}
        for landmark, text in self.markers.items():
            members = []
            for member in text.split(","):
                choices = ([plain(name) for name in markers(choice)] for choice in member.split(" | "))
                chosen = next((choice for choice in choices if own.keys() >= set(choice)), None)
                if chosen:
                    members.append([own[name] for name in chosen])
            if members:
                found[landmark] = members
        return found

    def said(self, landmark: str) -> str:
        """Names of the markers of a landmark, for messages: `LKNE or LKNL`; that of the landmark if it has none."""
        text = self.markers.get(landmark)
        return landmark if text is None else text.replace(" | ", " or ").replace(" + ", " with ")


def markers(joint: str) -> list[str]:
    """Points whose mean is the joint: two for `LKneeLateral + LKneeMedial`, one for a plain name."""
    return [name.strip() for name in joint.split(" + ")]


def plain(name: str) -> str:
    """A name of a marker without case, `.`, `_`, `-` and spaces, as names are compared."""
    return re.sub(r"[\s._-]", "", name).lower()


def shipped_mappings() -> dict[str, SkeletonMapping]:
    """Shipped mappings by name."""
    folder = resources.files("flexmotion.configs").joinpath("skeletons")
    with resources.as_file(folder) as path:
        mappings = [load(SkeletonMapping, file) for file in sorted(path.glob("*.yaml"))]
    return {mapping.name: mapping for mapping in mappings}


def find_mapping(names: tuple[str, ...], path: str, wanted: str | Path | None = None) -> SkeletonMapping:
    """The mapping of a skeleton with joints of these names.

    Args:
        names: joints of the skeleton.
        path: of the motion file, for messages.
        wanted: name of a shipped mapping, or path of a YAML file; None for a shipped one that fits, else a guess.

    Raises:
        ConfigError: the mapping does not exist, or its file is wrong.
        MotionFormatError: the skeleton lacks joints of the mapping, or some could not be guessed.
    """
    shipped = shipped_mappings()
    if wanted is None:
        return _fitting(list(shipped.values()), names, path)
    if str(wanted) in shipped:
        mapping = shipped[str(wanted)]
    elif Path(wanted).suffix in (".yaml", ".yml"):
        mapping = load(SkeletonMapping, Path(wanted))
    else:
        raise ConfigError(f"skeleton mapping {str(wanted)!r}: expected {', '.join(shipped)} or the path of a YAML file")
    if mapping.markers:
        return mapping
    missing = mapping.missing(names)
    if missing:
        raise MotionFormatError(
            f"{path}: mapping {mapping.name!r} needs joints that the file lacks: {', '.join(missing)}"
        )
    return mapping.present(names)


def _fitting(shipped: Sequence[SkeletonMapping], names: tuple[str, ...], path: str) -> SkeletonMapping:
    """The mapping of joints with most points in a file, a shipped one before a guess, else a set of markers."""
    skeletons = [mapping.present(names) for mapping in shipped if mapping.joints and not mapping.missing(names)]
    chosen = max(skeletons, key=lambda mapping: len(mapping.joints), default=None)
    if chosen is not None and set(POINTS) - {"lumbar", "head"} <= chosen.joints.keys():
        return chosen
    markers_of = _marker_set(shipped, names)
    if chosen is None and markers_of is not None:
        return markers_of
    try:
        guess = guess_mapping(names, path)
    except MotionFormatError:
        markers_of = chosen or _marker_set(shipped, names, FEW)
        if markers_of is None:
            raise
        return markers_of
    return guess if chosen is None or len(guess.joints) > len(chosen.joints) else chosen


FEW = 6
"""Landmarks that tell a set of surface markers which lacks an anterior iliac spine."""


def _marker_set(
    shipped: Sequence[SkeletonMapping], names: tuple[str, ...], least: int | None = None
) -> SkeletonMapping | None:
    """The set with most landmarks in a file that has both anterior iliac spines, or at least `least` landmarks."""
    counts = {}
    for mapping in shipped:
        found = mapping.landmarks(names)
        if {"asis_l", "asis_r"} <= found.keys() or (least is not None and len(found) >= least):
            counts[len(found)] = mapping
    return counts[max(counts)] if counts else None


def guess_mapping(names: tuple[str, ...], path: str) -> SkeletonMapping:
    """A mapping guessed from the names of the joints.

    Raises:
        MotionFormatError: lists the points without a joint, and the joints of the file.
    """
    stems: dict[tuple[str, str], str] = {}
    for name in names:
        stems.setdefault(_stem(name), name)
    joints: dict[str, str] = {}
    for point, synonyms in _synonyms().items():
        for side in SIDES if point in SIDED_POINTS else ("",):
            found = next((stems[side, word] for word in synonyms if (side, word) in stems), None)
            if found:
                joints[f"{point}_{side}" if side else point] = found
    unmapped = [point for point in REQUIRED_POINTS if point not in joints]
    if unmapped:
        legs = "no legs found: " if all(f"{p}_{s}" in unmapped for p in ("knee", "ankle") for s in SIDES) else ""
        present = ", ".join(name for name in names if not name.endswith("/end"))
        such = ", ".join(_usual_name(point) for point in unmapped)
        raise MotionFormatError(
            f"{path}: {legs}no joint found for {', '.join(unmapped)} (names such as {such}); joints are {present}; "
            "give a mapping"
        )
    return SkeletonMapping(name="guess", joints=joints)


@lru_cache
def _synonyms() -> dict[str, list[str]]:
    text = resources.files("flexmotion").joinpath("data", "joint_names.yaml").read_text(encoding="utf-8")
    synonyms: dict[str, list[str]] = yaml_content(text)
    return synonyms


def _usual_name(point: str) -> str:
    """A name that a joint may have, `LeftKnee` for `knee_l`."""
    base, _, side = point.rpartition("_")
    return {"l": "Left", "r": "Right"}[side] + base.capitalize()


def _stem(name: str) -> tuple[str, str]:
    """Side ('l', 'r' or '') and plain lower-case name: `mixamorig:LeftUpLeg` and `upleg.L` are both ('l', 'upleg')."""
    base, slash, end = name.rsplit(":", 1)[-1].partition("/")
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", base)
    words = [word.lower() for word in words]
    if words and words[0] in ("bip", "bip01", "character1", "mixamorig"):
        words = words[1:]
    side = ""
    for index in (0, -1, *range(1, len(words) - 1)):
        if len(words) > 1 and -len(words) <= index < len(words) and words[index] in ("left", "l", "right", "r"):
            side = words.pop(index)[0]
            break
    if not side and words:
        for long in ("left", "right"):
            if words[0].startswith(long) and words[0] != long:
                side, words[0] = long[0], words[0].removeprefix(long)
    while len(words) > 1 and words[0].isdigit():
        words = words[1:]
    return side, "".join(words) + slash + end
