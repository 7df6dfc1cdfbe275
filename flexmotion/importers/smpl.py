"""Readers of motion on the joints of SMPL: positions of HumanML3D, rotations of AMASS."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.body import Segments
from flexmotion.importers import kit
from flexmotion.importers.body_fit import BALL_HEIGHT
from flexmotion.importers.capture import Capture

Float = NDArray[np.float64]

PARENTS: dict[str, str] = {
    "pelvis": "",
    "left_hip": "pelvis",
    "right_hip": "pelvis",
    "spine1": "pelvis",
    "left_knee": "left_hip",
    "right_knee": "right_hip",
    "spine2": "spine1",
    "left_ankle": "left_knee",
    "right_ankle": "right_knee",
    "spine3": "spine2",
    "left_foot": "left_ankle",
    "right_foot": "right_ankle",
    "neck": "spine3",
    "left_collar": "spine3",
    "right_collar": "spine3",
    "head": "neck",
    "left_shoulder": "left_collar",
    "right_shoulder": "right_collar",
    "left_elbow": "left_shoulder",
    "right_elbow": "right_shoulder",
    "left_wrist": "left_elbow",
    "right_wrist": "right_elbow",
}
"""Joints in order, with their parents."""

NAMES = tuple(PARENTS)

HUMANML3D_FPS = 20.0
"""Frame rate of HumanML3D's joint files."""

HEIGHT = 1.70
"""Stature of the generic skeleton of AMASS rotations [m]: a mean adult."""

FRAME_RATES = ("mocap_framerate", "mocap_frame_rate")


def read_joints(path: Path) -> Capture:
    """A file of the folder `new_joints` of HumanML3D or KIT-ML: `.npy`, y up.

    HumanML3D: (T, 22, 3) [m], 20 frames per second; KIT-ML: (T, 21, 3), see `kit.joints21`.

    Raises:
        MotionFormatError: the file has another content.
    """
    try:
        array = np.load(path, allow_pickle=False)
    except OSError as error:
        raise MotionFormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ValueError, EOFError) as error:
        raise MotionFormatError(f"{path}: not a NumPy array, or a damaged one") from error
    if array.ndim == 3 and array.shape[1:] == (len(kit.NAMES), 3):
        return kit.joints21(array, str(path))
    return joints22(array, HUMANML3D_FPS, str(path))


def joints22(array: NDArray[np.generic], fps: float, path: str) -> Capture:
    """A capture of positions of the 22 joints in any unit; `path` is for messages.

    Raises:
        MotionFormatError: the array is not (T, 22, 3), or has values that are not finite numbers.
    """
    if array.ndim == 2 and array.shape[1] in (263, kit.VECTORS):
        name = "KIT-ML" if array.shape[1] == kit.VECTORS else "HumanML3D"
        raise MotionFormatError(f"{path}: {name}'s feature vectors; give the joints of its folder 'new_joints'")
    if array.ndim != 3 or array.shape[1:] != (len(NAMES), 3):
        raise MotionFormatError(f"{path}: shape {array.shape}, expected (frames, {len(NAMES)}, 3)")
    if not len(array):
        raise MotionFormatError(f"{path}: no frames")
    if not np.issubdtype(array.dtype, np.number):
        raise MotionFormatError(f"{path}: values of type {array.dtype}, expected numbers")
    positions = array.astype(np.float64)
    bad = np.argwhere(~np.isfinite(positions))
    if len(bad):
        raise MotionFormatError(f"{path}: joint {NAMES[bad[0][1]]!r} is not finite in frame {bad[0][0]}")
    return Capture(path, fps, NAMES, positions)


def is_amass(content: Mapping[str, NDArray]) -> bool:
    """Whether the names of an archive's arrays are those of an AMASS file."""
    return "poses" in content and "trans" in content


def read_amass(path: str, content: Mapping[str, NDArray]) -> Capture:
    """Rotations of an AMASS archive on a generic skeleton; the body shape is not used.

    Args:
        path: of the file, for messages.
        content: arrays of the archive: `poses` (T, >= 66) axis-angle, `trans` (T, 3) [m], `mocap_framerate`; z up.

    Raises:
        MotionFormatError: an array is missing or has the wrong shape.
    """
    poses, root = np.asarray(content["poses"], np.float64), np.asarray(content["trans"], np.float64)
    rate = next((content[name] for name in FRAME_RATES if name in content), None)
    if rate is None:
        raise MotionFormatError(f"{path}: lacks {FRAME_RATES[0]}")
    count = len(NAMES)
    if poses.ndim != 2 or poses.shape[1] < 3 * count or not len(poses):
        raise MotionFormatError(f"{path}: poses have shape {poses.shape}, expected (frames, at least {3 * count})")
    if root.shape != (len(poses), 3):
        raise MotionFormatError(f"{path}: trans has shape {root.shape}, expected ({len(poses)}, 3)")
    if not (np.isfinite(poses).all() and np.isfinite(root).all() and np.isfinite(rate) and float(rate) > 0):
        raise MotionFormatError(f"{path}: poses, trans or {FRAME_RATES[0]} have values that are not finite")
    if np.any(content.get("betas", np.zeros(1))):
        warnings.warn(f"{path}: body shape (betas) is ignored, a generic skeleton is used", stacklevel=2)

    zero, parents = _zero_pose(), tuple(NAMES.index(p) if p else -1 for p in PARENTS.values())
    local = Rotation.from_rotvec(poses[:, : 3 * count].reshape(-1, 3)).as_matrix().reshape(-1, count, 3, 3)
    positions, rotations = np.empty((len(poses), count, 3)), np.empty((len(poses), count, 3, 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            positions[:, joint], rotations[:, joint] = root, local[:, joint]
            continue
        positions[:, joint] = positions[:, parent] + rotations[:, parent] @ (zero[joint] - zero[parent])
        rotations[:, joint] = rotations[:, parent] @ local[:, joint]
    return Capture(path, float(rate), NAMES, positions, rotations, parents, zero)


def _zero_pose() -> Float:
    """Joints of the generic skeleton in a T pose that faces z, y up, x left, (22, 3) [m]."""
    size = Segments.of_height(HEIGHT)
    half_hip, half_shoulder = size.hip_width / 2, size.shoulder_width / 2
    lumbar, neck, shoulder = size.lumbar_height, size.lumbar_height + size.neck_height, size.shoulder_height
    points = {
        "pelvis": (0.0, 0.0, 0.0),
        "spine1": (0.0, lumbar, 0.0),
        "spine2": (0.0, lumbar + 0.3 * size.neck_height, 0.0),
        "spine3": (0.0, lumbar + 0.5 * size.neck_height, 0.0),
        "neck": (0.0, neck, 0.0),
        "head": (0.0, neck + 0.3 * size.head, 0.0),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        reach = sign * half_shoulder
        points |= {
            f"{side}_hip": (sign * half_hip, 0.0, 0.0),
            f"{side}_knee": (sign * half_hip, -size.thigh, 0.0),
            f"{side}_ankle": (sign * half_hip, -size.leg, 0.0),
            f"{side}_foot": (sign * half_hip, BALL_HEIGHT * HEIGHT - size.leg - size.ankle_height, size.ball),
            f"{side}_collar": (0.3 * reach, lumbar + shoulder, 0.0),
            f"{side}_shoulder": (reach, lumbar + shoulder, 0.0),
            f"{side}_elbow": (reach + sign * size.upper_arm, lumbar + shoulder, 0.0),
            f"{side}_wrist": (reach + sign * size.arm, lumbar + shoulder, 0.0),
        }
    return np.array([points[name] for name in NAMES])
