"""Gaps in files of joint centres."""

from __future__ import annotations

import numpy as np

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.gaps import without_gaps
from flexmotion.importers.mapping import REQUIRED_POINTS, SkeletonMapping, markers
from flexmotion.importers.rigid import visible

PELVIS = ("hip_l", "hip_r", "lumbar")
TORSO = ("lumbar", "neck", "shoulder_l", "shoulder_r")
"""Points that move nearly as one rigid body."""


def complete_joints(capture: Capture, mapping: SkeletonMapping) -> tuple[Capture, SkeletonMapping]:
    """A capture without gaps in the points that a mapping uses, and the mapping without those that have long ones.

    Raises:
        MotionFormatError: a joint of the legs is missing for too long; names it and the time.
    """
    if capture.rotations is not None or np.isfinite(capture.positions).all():
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
