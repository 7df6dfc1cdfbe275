"""`Landmarks`: a capture in FlexMotion's names, axes and metres, the input of the fit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.signals import resample_rotations, resample_signal
from flexmotion.importers.capture import Capture
from flexmotion.importers.mapping import SkeletonMapping, Units, Up, markers
from flexmotion.importers.trunk import with_trunk
from flexmotion.importers.units import LEG, TO_Z_UP, metres_per_unit
from flexmotion.importers.zero_pose import zero_pose_orientations

Float = NDArray[np.float64]

ATTACHED = frozenset({"hip_l", "hip_r", "shoulder_l", "shoulder_r"})
"""Points whose joint moves rigidly with the thigh or upper arm."""

ZERO = 1e-6
"""Greatest difference of equal rotation matrices."""

SETTLE_S = 0.25
"""Length of the beginning in which jumps are searched [s]."""

JUMP_SPEED = 8.0
"""A joint faster than this relative to the pelvis [m/s] in the first frames is a jump: conversions begin with a T pose,
and filters settle. (A boxer's fist reaches 9 m/s, but not in the first quarter second.)"""

JUMP_RATIO = 2.0
"""A jump is also faster than the median of the clip by this factor."""

RINGING_S = 0.03
"""Time for which such a filter rings after a jump [s]."""


@dataclass(frozen=True)
class Landmarks:
    """Joint centres of a human over time, z up, metres.

    Attributes:
        path: of the file, for messages.
        fps: frames per second.
        points: positions of the `mapping.POINTS` in the file, (T, 3) [m].
        orientations: of the `mapping.SEGMENTS` in the file (x forward, y left, z up in upright stance;
            hand: x out of the palm, z towards the elbow), (T, 3, 3).
        attached: a frame that moves rigidly with the thigh (`hip_l`, `hip_r`) or upper arm (`shoulder_l`,
            `shoulder_r`), (T, 3, 3); empty for formats without rotations.
        start: time of the first frame in the file [s].
        warnings: what a user should know about how the file was read.
        up: upward axis of the file.
    """

    path: str
    fps: float
    points: dict[str, Float]
    orientations: dict[str, Float] = field(default_factory=dict)
    attached: dict[str, Float] = field(default_factory=dict)
    start: float = 0.0
    warnings: tuple[str, ...] = ()
    up: Up = "z"

    def __len__(self) -> int:
        return len(self.points["hip_l"])

    def has_arm(self, side: str) -> bool:
        """Whether the file has elbow and wrist of a side."""
        return all(f"{point}_{side}" in self.points for point in ("elbow", "wrist"))

    def __getitem__(self, frames: slice) -> Landmarks:
        return replace(
            self,
            points={name: value[frames] for name, value in self.points.items()},
            orientations={name: value[frames] for name, value in self.orientations.items()},
            attached={name: value[frames] for name, value in self.attached.items()},
            start=self.start + (frames.start or 0) / self.fps,
        )

    def resampled(self, fps: float) -> Landmarks:
        """The same at another frame rate, low-passed for a lower one."""
        return replace(
            self,
            fps=fps,
            points={n: resample_signal(v, self.fps, fps) for n, v in self.points.items()},
            orientations={n: resample_rotations(v, self.fps, fps) for n, v in self.orientations.items()},
            attached={n: resample_rotations(v, self.fps, fps) for n, v in self.attached.items()},
        )


def landmarks(
    capture: Capture, mapping: SkeletonMapping, *, units: Units | None = None, up: Up | None = None
) -> Landmarks:
    """A capture in FlexMotion's names, axes and metres, without initial frames that are not motion.

    Args and errors: see `all_landmarks`; also `MotionFormatError` where the file has only a T pose.
    """
    found = all_landmarks(capture, mapping, units=units, up=up)[_zero_frames(capture) :]
    return found[_settled(found) :]


def all_landmarks(
    capture: Capture, mapping: SkeletonMapping, *, units: Units | None = None, up: Up | None = None
) -> Landmarks:
    """A capture in FlexMotion's names, axes and metres.

    Args:
        capture: as read from the file.
        mapping: from names of points to its joints.
        units, up: of the file; None for those of the mapping, or a guess from leg length and position of the head.

    Raises:
        MotionFormatError: no units or upward axis give a human.
    """
    columns = {point: capture.select(markers(joint)) for point, joint in mapping.joints.items()}
    raw = {point: capture.positions[:, column].mean(axis=1) for point, column in columns.items()}
    up = up or mapping.up or _guess_up(raw)
    length = leg_length(raw)
    if not length > 0:
        raise MotionFormatError(f"{capture.path}: the legs have no length, hips, knees and ankles coincide")
    scale, wrong = metres_per_unit(LEG, length, capture, units, mapping.units)
    turn = TO_Z_UP[up]
    if not LEG.holds(scale * length):
        raise MotionFormatError(
            f"{capture.path}: a leg of {scale * length:.3g} m, expected {LEG.low} to {LEG.high} m; other units?"
        )
    points = {point: scale * value @ turn.T for point, value in raw.items()}
    points, guessed = with_trunk(points, scale * length)
    notes = [*wrong, *guessed]
    for side, name in (("l", "left"), ("r", "right")):
        absent = [joint for joint in ("elbow", "wrist") if f"{joint}_{side}" not in points]
        if absent:
            notes.append(f"no point for the {name} {' and '.join(absent)}: that arm hangs")

    orientations: dict[str, Float] = {}
    attached: dict[str, Float] = {}
    if capture.pelvis is not None:
        orientations["pelvis"] = turn @ capture.pelvis
    if capture.rotations is not None:
        aligned = {name: (item.joint, item.matrix()) for name, item in mapping.orientations.items()}
        if not aligned:
            aligned = zero_pose_orientations(capture, mapping.joints, turn)
        for segment, (joint, axes) in aligned.items():
            orientations[segment] = turn @ capture.rotations[:, capture.names.index(joint)] @ axes
        for point in ATTACHED & columns.keys():
            attached[point] = turn @ capture.rotations[:, columns[point][0]]
    return Landmarks(
        capture.path,
        capture.fps,
        points,
        orientations,
        attached,
        capture.start,
        (*capture.warnings, *notes),
        capture.up or up,
    )


def _guess_up(raw: dict[str, Float]) -> Up:
    """The axis along which neck, else hips, are above the feet for most of the time."""
    rise = raw.get("neck", (raw["hip_l"] + raw["hip_r"]) / 2) - (raw["ankle_l"] + raw["ankle_r"]) / 2
    return "y" if np.median(rise[:, 1]) >= np.median(rise[:, 2]) else "z"


def leg_length(points: dict[str, Float]) -> float:
    """Hip to ankle over the knee, median over frames, mean of both sides."""
    bones = [
        points[f"{b}_{side}"] - points[f"{a}_{side}"] for a, b in (("hip", "knee"), ("knee", "ankle")) for side in "lr"
    ]
    return float(np.median(np.linalg.norm(bones, axis=-1), axis=-1).sum()) / 2


def _zero_frames(capture: Capture) -> int:
    """Number of initial frames with every rotation at zero: a calibration pose."""
    if capture.rotations is None:
        return 0
    against_root = np.abs(capture.rotations - capture.rotations[:, :1]).max(axis=(1, 2, 3))
    moving = np.flatnonzero(against_root > ZERO)
    return int(moving[0]) if len(moving) else 0


def _settled(found: Landmarks) -> int:
    """First frame after any jump at the beginning."""
    beginning = min(len(found) - 1, max(2, round(SETTLE_S * found.fps)))
    if beginning < 1:
        return 0
    middle = (found.points["hip_l"] + found.points["hip_r"]) / 2
    joints = np.stack([value - middle for value in found.points.values()], axis=1)
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max(axis=-1) * found.fps
    usual = float(np.median(speed[beginning:])) if len(speed) > beginning else 0.0
    # Motion that is fast throughout is not a jump.
    jumps = np.flatnonzero(speed[:beginning] > max(JUMP_SPEED, JUMP_RATIO * usual))
    if not len(jumps):
        return 0
    first = int(jumps[-1]) + 1 + int(np.ceil(RINGING_S * found.fps))
    if first >= len(found) - 1:
        raise MotionFormatError(f"{found.path}: nothing but a T pose and a jump in {len(found)} frames")
    return first
