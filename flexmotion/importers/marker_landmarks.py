"""Names of anatomical landmarks that surface markers stand for, and the segments that carry them."""

from __future__ import annotations

from flexmotion.configs.errors import MotionFormatError

SIDED_LANDMARKS = (
    "asis",
    "psis",
    "thigh",
    "knee_lateral",
    "knee_medial",
    "shank",
    "ankle_lateral",
    "ankle_medial",
    "heel",
    "foot",
    "metatarsal_1",
    "metatarsal_5",
    "toe",
    "toe_tip",
    "acromion",
    "elbow_lateral",
    "elbow_medial",
    "wrist_radial",
    "wrist_ulnar",
    "head",
)
MIDDLE_LANDMARKS = ("sacrum", "c7", "t10", "clavicle", "sternum", "vertex")
LANDMARKS: tuple[str, ...] = (*MIDDLE_LANDMARKS, *(f"{name}_{side}" for name in SIDED_LANDMARKS for side in "lr"))
"""Landmarks of a marker set. `asis` and `psis` are the anterior and posterior superior iliac spines, `sacrum` the
middle between the latter, `thigh`, `shank` and `foot` any markers that move with that segment, `toe` the top of the
second metatarsal's head, `toe_tip` the end of the foot, `clavicle` the jugular notch, `vertex` the top of the head."""

CARRIERS: dict[str, tuple[str, ...]] = {
    "pelvis": ("asis_l", "asis_r", "psis_l", "psis_r", "sacrum"),
    "torso": ("c7", "t10", "clavicle", "sternum", "acromion_l", "acromion_r"),
    "head": ("head_l", "head_r", "vertex"),
    **{f"thigh_{side}": (f"thigh_{side}", f"knee_lateral_{side}", f"knee_medial_{side}") for side in "lr"},
    **{f"shank_{side}": (f"shank_{side}", f"ankle_lateral_{side}", f"ankle_medial_{side}") for side in "lr"},
    **{
        f"foot_{side}": tuple(
            f"{name}_{side}" for name in ("heel", "foot", "metatarsal_1", "metatarsal_5", "toe", "toe_tip")
        )
        for side in "lr"
    },
}
"""Segment -> landmarks that move with it; a missing marker is reconstructed from the others of its segment."""


class MissingLandmarkError(MotionFormatError):
    """A joint cannot be found: `landmarks` are those that would do."""

    def __init__(self, message: str, landmarks: tuple[str, ...]) -> None:
        super().__init__(message)
        self.landmarks = landmarks
