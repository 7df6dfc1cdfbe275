"""From a capture of surface markers to one of joint centres, in metres, z up."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.skeleton import SIDES
from flexmotion.importers.capture import Capture
from flexmotion.importers.gaps import KEPT_SHARE, rough_scale, without_gaps
from flexmotion.importers.mapping import SkeletonMapping, Units, Up, markers, plain
from flexmotion.importers.marker_joints import marker_joints
from flexmotion.importers.marker_landmarks import CARRIERS, MissingLandmarkError
from flexmotion.importers.marker_names import named
from flexmotion.importers.swapped_sides import without_swaps
from flexmotion.importers.units import PELVIS_WIDTH, TO_Z_UP, metres_per_unit

Float = NDArray[np.float64]

LINKED = (
    ("asis", "psis"),
    ("thigh", "knee_lateral", "knee_medial"),
    ("shank", "ankle_lateral", "ankle_medial"),
    ("knee_lateral", "ankle_lateral"),
    ("heel", "foot", "metatarsal_1", "metatarsal_5", "toe", "toe_tip"),
    ("ankle_lateral", "heel"),
    ("ankle_lateral", "toe"),
    ("ankle_lateral", "metatarsal_5"),
    ("acromion", "elbow_lateral"),
    ("elbow_lateral", "elbow_medial", "wrist_radial"),
    ("wrist_radial", "wrist_ulnar"),
)
"""Landmarks of one side at nearly constant distances from each other."""

LISTED = 40
"""Most names of a file's markers in a message."""

OPTIONAL = ("elbow", "wrist", "head", "vertex", "acromion", "c7", "clavicle")
"""Landmarks of arms, head and shoulders, without which a clip can be read."""


def joint_capture(
    capture: Capture, mapping: SkeletonMapping, *, units: Units | None = None, up: Up | None = None
) -> Capture:
    """Joint centres, named as `mapping.POINTS`, of a capture of surface markers; see `marker_joints`.

    Raises:
        MotionFormatError: the file has fewer than two frames; markers of a joint are missing from it, or for too long;
            or the distance between both ASIS is not a human's in any unit.
    """
    if len(capture) < 2:
        raise MotionFormatError(
            f"{capture.path}: has {len(capture)} frame(s) of surface markers, expected at least 2, since joint "
            "centres are found from their motion"
        )
    present = mapping.landmarks(capture.names)
    absent = tuple(name for name in ("asis_l", "asis_r") if name not in present)
    if absent:
        raise _told(
            MissingLandmarkError(f"{capture.path}: no marker for {', '.join(absent)}", absent),
            mapping,
            capture,
            present,
        )
    capture = _with_sides(capture, present)
    optional = {n for landmark in present if landmark.startswith(OPTIONAL) for n in _names(present, landmark)}
    used = {n for landmark in present for n in _names(present, landmark)} - optional
    spines = {n for landmark in ("asis_l", "asis_r") for n in _names(present, landmark)}
    used, notes = _without_rare(capture, used, spines)
    spare = {n for landmark in _spare(present) for n in _names(present, landmark)} & used
    used -= spare
    segments = [[n for own in carried for n in _names(present, own)] for carried in CARRIERS.values()]
    capture = replace(capture, warnings=(*capture.warnings, *notes))
    complete, lost = without_gaps(capture, used, optional, segments, spare, spines)
    known = (used | optional | spare) - lost
    column = {name: index for index, name in enumerate(complete.names)}

    def mean(names: list[str]) -> Float:
        return complete.positions[:, [column[name] for name in names]].mean(axis=1)

    present = {own: [m for m in members if known.issuperset(m)] for own, members in present.items()}
    at = {own: np.mean([mean(names) for names in members], axis=0) for own, members in present.items() if members}
    up = up or mapping.up or _guess_up(at)
    width = float(np.median(np.linalg.norm(at["asis_l"] - at["asis_r"], axis=-1)))
    scale, wrong = metres_per_unit(PELVIS_WIDTH, width, capture, units, mapping.units)
    turn = TO_Z_UP[up] * scale
    at = {name: value @ turn.T for name, value in at.items()}
    clusters = {
        segment: np.stack([mean(names) @ turn.T for own in carried for names in present.get(own, ())], axis=1)
        for segment, carried in CARRIERS.items()
        if any(present.get(own) for own in carried)
    }
    try:
        found = marker_joints(at, clusters, complete.fps, capture.path)
    except MissingLandmarkError as error:
        raise _told(error, mapping, complete, present) from None
    return Capture(
        path=complete.path,
        fps=complete.fps,
        names=tuple(found.points),
        positions=np.stack(list(found.points.values()), axis=1),
        pelvis=found.pelvis,
        start=complete.start,
        warnings=(*complete.warnings, *wrong, *found.warnings),
        up=up,
    )


def _with_sides(capture: Capture, present: Mapping[str, list[list[str]]]) -> Capture:
    """A capture whose left and right markers are not exchanged."""
    pairs: list[tuple[str, str]] = []
    mates: dict[str, list[str]] = {}
    for landmark in present:
        if landmark.endswith("_l"):
            others = {plain(name): name for name in _names(present, f"{landmark[:-2]}_r")}
            for name in _names(present, landmark):
                partner = next((others[own] for own in _mirrored(plain(name)) if own in others), None)
                if partner is not None:
                    pairs.append((name, partner))
    for linked in LINKED:
        for side in SIDES:
            members = [name for own in linked for name in _names(present, f"{own}_{side}")]
            mates |= {name: [*mates.get(name, ()), *(own for own in members if own != name)] for name in members}
    used = capture.select([name for pair in pairs for name in pair])
    return without_swaps(capture, pairs, mates, rough_scale(capture.positions[:, used]))


def _mirrored(name: str) -> list[str]:
    """Names that the right marker may have beside a left one, without case and dots."""
    one = [name[:at] + "r" + name[at + 1 :] for at, letter in enumerate(name) if letter == "l"]
    return [name.replace("left", "right"), *one]


def _told(
    error: MissingLandmarkError, mapping: SkeletonMapping, capture: Capture, present: Mapping[str, list[list[str]]]
) -> MotionFormatError:
    """An error with the names that the missing markers could have, why some are not used, and what the file has."""
    could = "; ".join(
        f"{landmark}: {mapping.said(landmark)}" for landmark in error.landmarks if not present.get(landmark)
    )
    names = {plain(name) for landmark in error.landmarks for name in _choices(mapping, landmark)}
    why = [note for note in capture.warnings if plain(note.partition(": ")[0]) in names]
    has = named(capture.names)
    listed = ", ".join(has[:LISTED]) + (f" and {len(has) - LISTED} more" if len(has) > LISTED else "")
    return MotionFormatError(
        "; ".join([f"{error}; mapping {mapping.name!r} takes {could}", *why, f"the file has {listed}"])
    )


def _choices(mapping: SkeletonMapping, landmark: str) -> list[str]:
    """Names that markers of a landmark may have."""
    members = mapping.markers.get(landmark, "").split(",")
    return [name for member in members for choice in member.split(" | ") for name in markers(choice)]


def _spare(present: Collection[str]) -> list[str]:
    """Landmarks that others of the file can stand for."""
    found = ["t10", "sternum"]
    for side in "lr":
        found += [f"thigh_{side}", f"foot_{side}", f"toe_tip_{side}"]
        if f"knee_lateral_{side}" in present:
            found += [f"shank_{side}", f"knee_medial_{side}"]
        if f"ankle_lateral_{side}" in present:
            found.append(f"ankle_medial_{side}")
        if f"toe_{side}" in present:
            found += [f"metatarsal_1_{side}", f"metatarsal_5_{side}"]
    return found


def _names(present: Mapping[str, list[list[str]]], landmark: str) -> list[str]:
    return [name for members in present.get(landmark, ()) for name in members]


def _without_rare(capture: Capture, used: set[str], kept: set[str]) -> tuple[set[str], list[str]]:
    """Markers without those in less than half of the frames, as medial ones of a static trial, but with `kept`."""
    share = dict(zip(capture.names, np.isfinite(capture.positions).all(axis=-1).mean(axis=0), strict=True))
    rare = sorted(name for name in used - kept if share[name] < KEPT_SHARE)
    return used - set(rare), [
        f"{name}: missing in {100 - 100 * share[name]:.0f} % of the clip, is not used" for name in rare
    ]


def _guess_up(at: Mapping[str, Float]) -> Up:
    """The axis along which the pelvis is above the feet for most of the time."""
    feet = [value for name, value in at.items() if name.startswith(("heel", "toe", "ankle", "metatarsal"))]
    rise = (at["asis_l"] + at["asis_r"]) / 2 - np.mean(feet or [0 * at["asis_l"]], axis=0)
    return "y" if np.median(rise[:, 1]) >= np.median(rise[:, 2]) else "z"
