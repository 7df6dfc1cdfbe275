"""Gaps and exchanged sides in files of joint centres."""

from __future__ import annotations

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.skeleton import SIDES
from flexmotion.importers.capture import Capture
from flexmotion.importers.gaps import rough_scale, without_gaps
from flexmotion.importers.mapping import REQUIRED_POINTS, SIDED_POINTS, SkeletonMapping, markers
from flexmotion.importers.rigid import visible
from flexmotion.importers.swapped_sides import without_swaps

PELVIS = ("hip_l", "hip_r", "lumbar")
BONES = (("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"), ("shoulder", "elbow"), ("elbow", "wrist"))
"""Points at a constant distance."""

TORSO = ("lumbar", "neck", "shoulder_l", "shoulder_r")
"""Points that move nearly as one rigid body."""


def _with_sides(capture: Capture, mapping: SkeletonMapping) -> Capture:
    """A capture whose left and right points are not exchanged."""
    single = {point: names[0] for point, text in mapping.joints.items() if len(names := markers(text)) == 1}
    pairs = [
        (single[f"{point}_l"], single[f"{point}_r"])
        for point in SIDED_POINTS
        if {f"{point}_l", f"{point}_r"} <= single.keys()
    ]
    mates: dict[str, list[str]] = {}
    for bone in BONES:
        for side in SIDES:
            ends = [single.get(f"{end}_{side}") for end in bone]
            for own, other in (ends, ends[::-1]):
                if own is not None and other is not None:
                    mates.setdefault(own, []).append(other)
    used = capture.select([name for pair in pairs for name in pair])
    return without_swaps(capture, pairs, mates, rough_scale(capture.positions[:, used]))


def complete_joints(capture: Capture, mapping: SkeletonMapping) -> tuple[Capture, SkeletonMapping]:
    """A capture without gaps and exchanged sides in the points of a mapping, and the mapping without lost points.

    Raises:
        MotionFormatError: a joint of the legs is missing for too long; names it and the time.
    """
    if capture.rotations is not None:
        return capture, mapping
    capture = _with_sides(capture, mapping)
    if np.isfinite(capture.positions).all():
        return capture, mapping
    needed = {name for point in REQUIRED_POINTS for name in markers(mapping.joints[point])}
    seen = visible(capture.positions)
    empty = [name for name in sorted(needed) if not seen[:, capture.names.index(name)].any()]
    if empty:
        raise MotionFormatError(f"{capture.path}: {', '.join(empty)}: missing in every frame")
    optional = {name for joint in mapping.joints.values() for name in markers(joint)} - needed
    torso = [name for point in TORSO if point in mapping.joints for name in markers(mapping.joints[point])]
    pelvis = [name for point in PELVIS if point in mapping.joints for name in markers(mapping.joints[point])]
    complete, lost = without_gaps(capture, needed, optional, [torso, pelvis], anchor=pelvis)
    kept = {point: joint for point, joint in mapping.joints.items() if lost.isdisjoint(markers(joint))}
    return complete, mapping.model_copy(update={"joints": kept})
