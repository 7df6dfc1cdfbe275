"""Inverse dynamics by the Newton-Euler equations of the segments that a joint carries, for a whole clip.

For a hinge through o with axis a that carries the segments S, with ground forces on the feet F in S:

    τ = a · ( Σ_S [ (c - o) x m (c̈ - g) + L̇ ] - Σ_F [ (p - o) x f + n ] )

The same sum over the whole body about the pelvis origin is the generalised force of the root: the residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.segment_motion import SegmentMotion, carried
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import DOF_COUNT, SIDES
from flexmotion.human.vectors import cross
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Effort:
    """Forces and moments that move the masses, whatever their origin.

    Attributes:
        force: m (c̈ - g) of each segment, (T, B, 3) [N].
        moment: c x m (c̈ - g) + L̇ of each segment about the world's origin, (T, B, 3) [N·m].
    """

    force: Float
    moment: Float

    def about(self, point: Float) -> Float:
        """Total force, and moment about a point per frame, (T, 3) -> (T, 6) [N, N·m]."""
        force, moment = _summed(self.force), _summed(self.moment)
        return np.concatenate([force, moment - cross(point, force)], axis=-1)


def effort(segments: SegmentMotion, body: Body, loads: Sequence[ExternalLoad] = ()) -> Effort:
    """Forces and moments of the motion of every segment, less those of external loads."""
    force = _forces(segments)
    for load in loads:
        force[:, human_model(body).body_index[load.segment]] -= load.force
    return Effort(force, cross(segments.com, force) + segments.angular_momentum_rate)


def whole_effort(segments: SegmentMotion) -> Float:
    """Total force, and moment about the world's origin, that move all masses, (T, 6) [N, N·m]; less than `effort`."""
    force = _forces(segments)
    found, about = np.empty((len(segments), 6)), segments.com.swapaxes(1, 2) @ force  # sums of c fᵀ, (T, 3, 3)
    found[:, :3], found[:, 3:] = _summed(force), _summed(segments.angular_momentum_rate)
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        found[:, 3 + axis] += about[:, one, other] - about[:, other, one]
    return found


def _forces(segments: SegmentMotion) -> Float:
    """Forces m (c̈ - g) of each segment, (T, B, 3) [N]."""
    force = segments.acceleration.copy()
    force[..., 2] += GRAVITY
    force *= segments.mass[:, None]
    return force


def _summed(values: Float) -> Float:
    """Sum over the segments, (T, B, 3) -> (T, 3); a product takes a fifth of the time of `values.sum(axis=1)`."""
    return np.asarray(np.ones(values.shape[1]) @ values)


def joint_torques(
    body: Body, segments: SegmentMotion, wrenches: Float, points: Float, loads: Sequence[ExternalLoad] = ()
) -> Float:
    """Generalised forces of root and joints, (T, 32) [N, N·m], in the order of `Motion.torques`.

    Those of the root are forces in the world and moments about the axes of the pelvis, as of MuJoCo's free joint.

    Args:
        body: the human.
        segments: motion of the masses.
        wrenches: ground reaction on left and right foot, (T, 2, 6): force, and moment about `points` [N, N·m].
        points: reference points of those moments, (T, 2, 3) [m].
        loads: external forces.
    """
    needed = effort(segments, body, loads)
    force, moment = needed.force.copy(), needed.moment.copy()
    index = human_model(body).body_index
    for side, name in enumerate(SIDES):
        ground = wrenches[:, side]
        foot = index[f"calcaneus_{name}"]
        force[:, foot] -= ground[:, :3]
        moment[:, foot] -= cross(points[:, side], ground[:, :3]) + ground[:, 3:]

    carries = carried(body)
    both = carries @ np.concatenate([force, moment], axis=-1)
    joint_force = both[..., :3]
    joint_moment = both[..., 3:] - cross(segments.anchor, joint_force)

    torques = np.empty((len(segments), DOF_COUNT))
    pelvis = index["pelvis"]
    total = _summed(force)
    torques[:, :3] = total
    about_pelvis = _summed(moment) - cross(segments.position[:, pelvis], total)
    torques[:, 3:6] = np.einsum("tji,tj->ti", segments.rotation[:, pelvis], about_pelvis)
    torques[:, 6:] = np.einsum("tji,tji->tj", segments.axis, joint_moment)
    return torques
