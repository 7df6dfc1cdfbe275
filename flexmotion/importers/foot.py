"""Frames in which a foot is flat, toe-out angle, and ankle angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.signals import fill
from flexmotion.human.skeleton import JOINTS
from flexmotion.human.vectors import in_frame, unit
from flexmotion.importers.landmarks import Landmarks
from flexmotion.spatial.transitions import smoothstep

Float = NDArray[np.float64]

STANCE_HEIGHT, STANCE_SPEED = 0.03, 0.15
"""Greatest height of ankle and toe joint above their lowest [m], and greatest speed [m/s], of a flat foot."""

CORRECTED, LEFT_ALONE = 0.2, 0.5
"""The ankle is corrected fully up to the first angle, so that the sole has the file's pitch in the world, and not at
all from the second on, where the foot is far out of the shank's plane [rad]."""


@dataclass(frozen=True)
class FlatFoot:
    """Line from the ankle to the toe joint while a foot is flat; medians over those frames.

    Attributes:
        elevation: above the horizontal (negative: it slopes down to the toes) [rad].
        frames: whether the foot is flat, (T,) bool.
    """

    elevation: float
    frames: NDArray[np.bool_]


def flat_foot(found: Landmarks, side: str) -> FlatFoot:
    """Frames in which a foot is flat, and the slope of its ankle-to-toe line in them.

    A foot is flat in low and slow frames; in a clip without any (running only) in the lowest tenth.
    """
    ankle, toe = found.points[f"ankle_{side}"], found.points[f"toe_{side}"]
    height = np.maximum(_above_lowest(ankle), _above_lowest(toe))
    speed = np.maximum(_speed(ankle, found.fps), _speed(toe, found.fps))
    frames = (height < STANCE_HEIGHT) & (speed < STANCE_SPEED)
    if frames.sum() < 3:
        frames = height <= np.quantile(height, 0.1)
    line = toe - ankle
    elevation = np.arctan2(line[:, 2], np.linalg.norm(line[:, :2], axis=-1))
    return FlatFoot(float(np.median(elevation[frames])), frames)


def toe_out(tibia: Float, line: Float, frames: NDArray[np.bool_]) -> float:
    """Angle about the shank's axis from the knee's plane to the foot, to the left [rad]; median of the given frames.

    Args:
        tibia: rotation of the shank, (T, 3, 3).
        line: from the ankle to the toe joint, (T, 3).
        frames: in which the foot is flat, (T,) bool.
    """
    local = in_frame(tibia[frames], line[frames])
    return float(np.median(np.arctan2(local[:, 1], local[:, 0])))


def dorsiflexion(tibia: Float, line: Float, elevation: float, yaw: float) -> Float:
    """Ankle angle that gives the foot the direction of the file, (T,) [rad].

    First in the shank's sagittal plane; then, unless the foot points steeply up or down, corrected so that the sole has
    the file's pitch in the world: a planted sole stays level although the model's ankle has one axis.

    Args:
        tibia: rotation of the shank, (T, 3, 3).
        line: from the ankle to the toe joint, (T, 3).
        elevation: of that line while the sole is flat [rad].
        yaw: of the foot about the shank's axis, to the left [rad].
    """
    direction = unit(line)
    local = in_frame(tibia, direction)
    angle = _in_plane(local) - elevation
    # Height of the model's line in the world as a function of the angle d: a cos d + b sin d + c.
    x, y, z = np.cos(elevation) * np.cos(yaw), np.cos(elevation) * np.sin(yaw), np.sin(elevation)
    row = tibia[:, 2]
    a, b, c = row[:, 0] * x + row[:, 2] * z, row[:, 2] * x - row[:, 0] * z, row[:, 1] * y
    amplitude = np.maximum(np.hypot(a, b), 1e-9)
    cosine = np.clip((direction[:, 2] - c) / amplitude, -1.0, 1.0)
    half = np.arccos(cosine)
    best = np.stack([np.arctan2(b, a) + half, np.arctan2(b, a) - half]) - angle
    best = (best + np.pi) % (2 * np.pi) - np.pi
    nearest = np.where(np.abs(best[0]) < np.abs(best[1]), best[0], best[1])
    # Where the line is steep both solutions coincide and are inaccurate.
    trust = smoothstep(np.sqrt(1 - cosine**2), 0.3, 0.6) * (1 - smoothstep(np.abs(nearest), CORRECTED, LEFT_ALONE))
    return angle + trust * nearest


def _in_plane(local: Float) -> Float:
    """Angle of the foot above the shank's forward axis, (T,) [rad]; interpolated where the foot is out of that plane.

    Within half a turn of the middle of the ankle's range: unwrapped over time, one outlier would shift the rest of the
    clip by a turn.
    """
    direction = local[:, [0, 2]]
    weight = smoothstep(np.linalg.norm(direction, axis=-1), 0.2, 0.5)
    direction = unit(direction)
    if weight.min() < 1 and weight.any():
        direction = weight[:, None] * direction + (1 - weight)[:, None] * fill(direction, weight, sigma=5.0)
    middle = joint_limits()[JOINTS.index("ankle_dorsiflexion_l")].mean()
    angle: Float = middle + np.arctan2(
        direction[:, 1] * np.cos(middle) - direction[:, 0] * np.sin(middle),
        direction[:, 0] * np.cos(middle) + direction[:, 1] * np.sin(middle),
    )
    return angle


def _above_lowest(point: Float) -> Float:
    return point[:, 2] - np.quantile(point[:, 2], 0.05)


def _speed(point: Float, fps: float) -> Float:
    if len(point) < 2:
        return np.zeros(len(point))
    speed: Float = np.linalg.norm(np.gradient(point, axis=0), axis=-1) * fps
    return speed
