"""Ground reaction forces from kinematics: the required force, distributed over the points of the soles.

A quadratic programme per frame over the edges of friction pyramids, λ >= 0, in units of body weight and metres:

    min  |G λ - w|²  +  ridge Σ λ² / nearness  +  pivot Σ_feet (sagittal moment of the foot's force about the pivot)²

The first term fits the forces to the motion's wrench w about the centre of mass. The second prefers points that are low
and still. The third determines what kinematics do not: in double support any pair of opposed forces could be added. In
walking the force on each foot passes, in the sagittal plane, near a point above the centre of mass (the virtual pivot
point: Maus et al., Nature Communications 1:70, 2010), so the forces are drawn to such a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.inverse_dynamics import Effort
from flexmotion.biomechanics.segment_motion import SegmentMotion
from flexmotion.biomechanics.sole import POINTS, SolePoints
from flexmotion.human.vectors import unit
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

EDGES = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Horizontal directions of the edges of a friction pyramid."""

NO_FORCE = 1e-3
"""A foot with less vertical force is in the air [N]."""

NEAR = 1e-3
"""Least nearness of a point within reach of the floor."""


@dataclass(frozen=True)
class GroundSettings:
    """Weights of the quadratic programme; lengths in metres, forces in body weights.

    Attributes:
        friction: coefficient of friction of shoe on floor.
        pivot_height: of the virtual pivot point above the centre of mass [m].
        pivot: weight of the moments of the feet's forces about it, around the body's left axis.
        ridge: weight of the squared forces.
        moment: weight of the total moment relative to the total force.
    """

    friction: float = 0.8
    pivot_height: float = 0.25
    pivot: float = 0.03
    ridge: float = 1e-3
    moment: float = 1.0


GROUND = GroundSettings()


@dataclass(frozen=True)
class GroundReaction:
    """Forces of the ground on left and right foot.

    Attributes:
        wrenches: force, and moment about `centres`, (T, 2, 6) [N, N·m].
        centres: of pressure, on the floor; below the middle of the sole of a foot in the air, (T, 2, 3) [m].
        point_forces: at every point of the soles, (T, 2, 12, 3) [N].
        residual: force and moment about the centre of mass that the ground did not provide, (T, 6) [N, N·m].
    """

    wrenches: Float
    centres: Float
    point_forces: Float
    residual: Float


def ground_reaction(
    segments: SegmentMotion,
    needed: Effort,
    sole: SolePoints,
    left: Float,
    settings: GroundSettings = GROUND,
) -> GroundReaction:
    """Ground forces on both feet that fit best the wrench of the motion.

    Args:
        segments: motion of the masses.
        needed: forces and moments that move them.
        sole: points at which the ground may act.
        left: the body's left axis, of which the horizontal part is used, (T, 3).
        settings: weights.
    """
    frames = len(segments)
    weight = float(segments.mass.sum()) * GRAVITY
    centre = segments.centre
    wanted = needed.about(centre) / weight
    pyramid = np.concatenate([settings.friction * EDGES, np.ones((len(EDGES), 1))], axis=1)
    wrenches = _edge_wrenches(sole.position - centre[:, None, None], pyramid)
    below = np.cross([0.0, 0.0, settings.pivot_height], pyramid)
    lateral = unit(left * [1.0, 1.0, 0.0])
    about_pivot = np.einsum("tpei,ti->tpe", wrenches[..., 3:] - below, lateral)
    near = sole.nearness.reshape(frames, -1)

    forces = np.zeros((frames, 2 * POINTS, 3))
    for frame in range(frames):
        used = np.flatnonzero(near[frame] > 0)
        if len(used):
            edges = _share(
                wanted[frame],
                wrenches[frame, used],
                about_pivot[frame, used],
                near[frame, used],
                used // POINTS,
                settings,
            )
            forces[frame, used] = weight * edges @ pyramid
    return _collect(forces.reshape(frames, 2, POINTS, 3), sole, centre, wanted * weight)


def _edge_wrenches(arms: Float, pyramid: Float) -> Float:
    """Force and moment about the centre of mass of every edge of every pyramid, (T, 24, 4, 6)."""
    frames = len(arms)
    moments = np.cross(arms.reshape(frames, -1, 1, 3), pyramid)
    return np.concatenate([np.broadcast_to(pyramid, moments.shape), moments], axis=-1)


def _share(
    wanted: Float,
    wrenches: Float,
    about_pivot: Float,
    near: Float,
    foot: NDArray[np.intp],
    settings: GroundSettings,
) -> Float:
    """Shares of the edges at N points in one frame, (N, 4) [body weights]."""
    count, edges = about_pivot.shape
    whole, pivot, owner = wrenches.reshape(-1, 6), about_pivot.ravel(), np.repeat(foot, edges)
    weighted = whole * [1.0, 1.0, 1.0, *3 * [settings.moment]]
    same_foot = owner[:, None] == owner
    hessian = weighted @ whole.T + settings.pivot * same_foot * np.outer(pivot, pivot)
    linear = -weighted @ wanted
    hessian[np.diag_indices(len(hessian))] += settings.ridge * np.repeat(1 / np.maximum(near, NEAR), edges)
    size = count * edges
    solution, _, status, _ = daqp.solve(
        hessian, linear, np.empty((0, size)), np.full(size, 1e30), np.zeros(size), np.zeros(size, np.int32)
    )
    if status < 1:
        raise ArithmeticError(f"ground force: daqp failed with status {status}")
    shares: Float = solution.reshape(count, edges)
    return shares


def _collect(forces: Float, sole: SolePoints, centre: Float, wanted: Float) -> GroundReaction:
    total = forces.sum(axis=2)
    vertical = forces[..., 2]
    # What a solver leaves of a foot in the air has no centre of pressure.
    share = np.where(total[..., 2:] > NO_FORCE, vertical / np.maximum(total[..., 2:], NO_FORCE), 1 / POINTS)
    centres = np.einsum("tsp,tspi->tsi", share, sole.position)
    moment = np.cross(sole.position - centres[:, :, None], forces).sum(axis=2)
    about_com = np.concatenate([total, np.cross(centres - centre[:, None], total) + moment], axis=-1)
    return GroundReaction(
        wrenches=np.concatenate([total, moment], axis=-1),
        centres=centres,
        point_forces=forces,
        residual=wanted - about_com.sum(axis=1),
    )
