"""`sequence`: clips joined to one motion, each placed at the human's position and heading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.motion import Motion
from flexmotion.spatial.heading import heading
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]


def sequence(clips: Sequence[tuple[float, Motion]], end: float | None, blend_frames: int) -> Motion:
    """One motion from clips and the times at which they start.

    A clip that ends before the next one starts holds its last pose.

    Args:
        clips: times [s] and clips, ascending from 0, all at one frame rate; the result has the body of the first.
        end: end of the result [s]; None: end of the last clip.
        blend_frames: frames over which a clip is blended in.
    """
    whole = poses_only(clips[0][1])
    for at, clip in clips[1:]:
        start = round(at * whole.fps)
        held = _held(whole, start + blend_frames + 1)
        # Scaled by height, so that the feet of a taller human are on the floor with the legs of the first.
        scale = whole.body.standing_height / clip.body.standing_height
        follower = placed(poses_only(clip), held[start : start + 1], scale)
        whole = _blended(held, follower, start, blend_frames)
    return whole if end is None else _held(whole, round(end * whole.fps) + 1)


def poses_only(motion: Motion) -> Motion:
    """The motion without forces, contacts and activations, which are invalid after a change of place and body."""
    return motion.kinematics


def _held(motion: Motion, frames: int) -> Motion:
    """The first `frames` frames; a shorter motion holds its last pose."""
    index = np.minimum(np.arange(frames), len(motion) - 1)
    return replace(
        motion,
        root_position=motion.root_position[index],
        root_quaternion=motion.root_quaternion[index],
        joints=motion.joints[index],
    )


def placed(motion: Motion, at: Motion, scale: float) -> Motion:
    """A motion scaled, turned about z and moved so that its first frame has position and heading of `at`.

    Args:
        at: one frame; the result has its body.
        scale: of the path, so that the feet are on the floor with the legs of that body.
    """
    turn = Rotation.from_euler("z", heading(at.root_quaternion[0]) - heading(motion.root_quaternion[0]))
    path = scale * motion.root_position
    path = turn.apply(path - path[0] * [1.0, 1.0, 0.0]) + at.root_position[0] * [1.0, 1.0, 0.0]
    turned = (turn * Rotation.from_quat(motion.root_quaternion, scalar_first=True)).as_quat(scalar_first=True)
    return replace(motion, root_position=path, root_quaternion=continuous_quaternions(turned), body=at.body)


def turned_to(standing: Motion, yaw: float) -> Motion:
    """A human that stands, turned on the spot to a heading [rad]."""
    turn = Rotation.from_euler("z", yaw - heading(standing.root_quaternion[-1]))
    place = standing.root_position[-1]
    turned = turn * Rotation.from_quat(standing.root_quaternion, scalar_first=True)
    return replace(
        poses_only(standing),
        root_position=place + turn.apply(standing.root_position - place),
        root_quaternion=continuous_quaternions(turned.as_quat(scalar_first=True)),
    )


def _blended(before: Motion, after: Motion, start: int, frames: int) -> Motion:
    """`before` up to frame `start`, then a transition over `frames` frames, then `after`."""
    overlap = min(frames, len(after))
    weight = (np.arange(1, overlap + 1) / (overlap + 1))[:, None]
    old, new = before[start : start + overlap], after[:overlap]
    sign = np.sign(np.sum(old.root_quaternion * new.root_quaternion, axis=1, keepdims=True))
    mixed = (1 - weight) * old.root_quaternion + weight * sign * new.root_quaternion

    def joined(first: Float, middle: Float, last: Float) -> Float:
        return np.concatenate([first[:start], middle, last[overlap:]])

    quaternion = joined(
        before.root_quaternion, mixed / np.linalg.norm(mixed, axis=1, keepdims=True), after.root_quaternion
    )
    return replace(
        before,
        root_position=joined(
            before.root_position,
            (1 - weight) * old.root_position + weight * new.root_position,
            after.root_position,
        ),
        root_quaternion=continuous_quaternions(quaternion),
        joints=joined(before.joints, (1 - weight) * old.joints + weight * new.joints, after.joints),
    )
