"""Frames as JSON: joints by name, or the 33 world landmarks of MediaPipe's pose landmarker (docs/live.md).

{"t": 12.345, "joints": {"left_hip": [0.1, 0.9, 0.0], …}, "up": "y", "units": "m"}
{"t": 12.345, "landmarks": [[0.1, -0.3, 0.0, 0.99], …]}
"""

from __future__ import annotations

import math
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import FrameError
from flexmotion.importers.frame import Frame, Skeleton
from flexmotion.importers.mapping import Units, Up

Float = NDArray[np.float64]

MOST_JOINTS = 256
LONGEST_NAME = 64
LEAST_VISIBLE = 0.5
"""MediaPipe's visibility from which a landmark counts as seen."""

LANDMARKS = (
    "nose",
    *("left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer"),
    *("left_ear", "right_ear", "mouth_left", "mouth_right"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb"),
    *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
    *("left_heel", "right_heel", "left_foot_index", "right_foot_index"),
)
"""In MediaPipe's order (https://ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker)."""

MEDIAPIPE = Skeleton("mediapipe", LANDMARKS, up="y", units="m", hip_centred=True)


def named_joints(content: dict[str, Any]) -> Frame:
    """The frame of a message with `joints`. Raises `FrameError`, which names the field."""
    joints = content["joints"]
    if not isinstance(joints, dict) or not 0 < len(joints) <= MOST_JOINTS:
        raise FrameError(f"joints: expected 1 to {MOST_JOINTS} of {{name: [x, y, z]}}")
    up, units = content.get("up", "y"), content.get("units", "m")
    for field, value, valid in (("up", up, get_args(Up)), ("units", units, get_args(Units))):
        if value not in valid:
            raise FrameError(f"{field}: {str(value)[:40]!r}, expected one of: {', '.join(valid)}")
    wrong = next((name for name in joints if len(name) > LONGEST_NAME), None)
    if wrong is not None:
        raise FrameError(f"joints: {wrong[:LONGEST_NAME]!r}…: a name of more than {LONGEST_NAME} characters")
    names = tuple(sorted(joints))
    positions = np.array([_position(f"joints: {name}", joints[name]) for name in names])
    return Frame(Skeleton("joints", names, up, units), positions, _time(content))


def mediapipe(content: dict[str, Any]) -> Frame:
    """The frame of a message with `landmarks`. Raises `FrameError`, which names the field.

    MediaPipe has x to the right of the picture, y down and z away from the camera; so a person who faces the camera
    looks along -z with the left hand at +x. The frame has y up, z forward, x left.
    """
    landmarks = content["landmarks"]
    if not isinstance(landmarks, list) or len(landmarks) != len(LANDMARKS):
        found = len(landmarks) if isinstance(landmarks, list) else type(landmarks).__name__
        raise FrameError(f"landmarks: expected {len(LANDMARKS)} of [x, y, z, visibility], found {found}")
    positions = np.empty((len(LANDMARKS), 3))
    for index, (name, one) in enumerate(zip(LANDMARKS, landmarks, strict=True)):
        if isinstance(one, dict):
            one = [one.get(key) for key in ("x", "y", "z")] + [one.get("visibility", 1.0)]
        seen = one[3] if isinstance(one, list) and len(one) == 4 else 1.0
        if not isinstance(seen, int | float):
            raise FrameError(f"landmarks: {name}: visibility: expected a number")
        x, y, z = _position(f"landmarks: {name}", one[:3] if isinstance(one, list) else one)
        positions[index] = (x, -y, -z) if seen >= LEAST_VISIBLE else math.nan
    return Frame(MEDIAPIPE, positions, _time(content))


def _position(field: str, value: Any) -> tuple[float, float, float]:
    """Three numbers; NaN for those that are null. Raises `FrameError`."""
    if value is None:
        return (math.nan,) * 3
    if not isinstance(value, list) or len(value) != 3:
        raise FrameError(f"{field}: expected [x, y, z]")
    x, y, z = (math.nan if one is None else _number(one, f"{field}: expected three numbers") for one in value)
    return x, y, z


def _time(content: dict[str, Any]) -> float | None:
    stamp = content.get("t")
    if stamp is None:
        return None
    wrong = "t: expected seconds on the sender's clock"
    time_s = _number(stamp, wrong)
    if not math.isfinite(time_s):
        raise FrameError(wrong)
    return time_s


def _number(value: Any, wrong: str) -> float:
    """A number of JSON. Raises `FrameError` (`wrong`) for other values, and for integers that no float holds."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise FrameError(wrong)
    try:
        return float(value)
    except OverflowError as error:
        raise FrameError(wrong) from error
