"""Inverse dynamics by the Newton-Euler equations of the segments that a joint carries, for a whole clip.

For a hinge through o with axis a that carries the segments S, with ground forces on the feet F in S:

    τ = a · ( Σ_S [ (c - o) x m (c̈ - g) + L̇ ] - Σ_F [ (p - o) x f + n ] )

The same sum over the whole body about the pelvis origin is the generalised force of the root: the residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.motion_loops import torques, whole_efforts
from flexmotion.biomechanics.segment_motion import SegmentMotion, hinge_index
from flexmotion.compiled import doubles
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import SIDES
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


def whole_effort(segments: SegmentMotion) -> tuple[Float, Float, Float]:
    """Total force, and moment about the world's origin, that move all masses, over their mass; and their centre.

    Returns:
        (T, 3) each [m/s², m²/s², m].
    """
    own = doubles
    rate = own(segments.angular_momentum_rate)
    return whole_efforts(segments.mass, own(segments.com), own(segments.acceleration), rate, GRAVITY)


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
    human, force, own = human_model(body), _forces(segments), doubles
    for load in loads:
        force[:, human.body_index[load.segment]] -= load.force
    return torques(
        human.segments.parent,
        own(force),
        own(segments.com),
        own(segments.angular_momentum_rate),
        own(segments.anchor),
        own(segments.axis),
        own(segments.position),
        own(segments.rotation),
        *_loaded(body),
        human.body_index["pelvis"],
        own(wrenches),
        own(points),
    )


@lru_cache(maxsize=32)
def _loaded(body: Body) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Segments that the hinges move, (26,), and those of left and right foot, (2,)."""
    human = human_model(body)
    bearers = human.model.jnt_bodyid[hinge_index(body)].astype(np.int64)
    return bearers, np.array([human.body_index[f"calcaneus_{side}"] for side in SIDES], np.int64)
