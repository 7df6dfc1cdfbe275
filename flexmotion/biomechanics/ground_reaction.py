"""Ground reaction forces from kinematics: the required force, distributed over the points of the soles.

A quadratic programme per frame over the edges of friction pyramids, λ >= 0, in units of body weight and metres:

    min  |G λ - w|²  +  ridge Σ λ² / nearness  +  Σ_feet (pivot M_p² + side_pivot M_s²)
                     +  steady e (f_l - s (f_l + f_r))²

The first term fits the forces to the motion's wrench w about the centre of mass. The second prefers points that are low
and still. The others determine what kinematics do not: in double support any pair of opposed forces could be added.

- In walking the force on each foot passes, in the sagittal plane, near a point above the centre of mass (the virtual
  pivot point: Maus et al., Nature Communications 1:70, 2010): M_p is its moment about that point. In the frontal plane
  the feet push outwards, the more the wider the stance: their forces pass near a higher point (M_s).
- Where both feet do the same (e near 1: standing, squats, jumps with both legs) their vertical forces f follow the
  body's sway from side to side, of which accelerations tell less than their noise. Their share s changes slowly there
  (`slow_share`). In walking, where one foot stands on its heel and the other on its toes, e is near 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

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

NEAR = 5e-4
"""Least nearness of a point within reach of the floor."""


@dataclass(frozen=True)
class GroundSettings:
    """Weights of the quadratic programme; lengths in metres, forces in body weights.

    Attributes:
        friction: coefficient of friction of shoe on floor.
        pivot_height: of the virtual pivot point above the centre of mass [m].
        pivot: weight of the moments of the feet's forces about it, around the body's left axis.
        side_pivot_height, side_pivot: the same in the frontal plane, around the body's forward axis. The weight
            comes from one drop jump with force plates.
        steady: weight of the deviation from the slow share where both feet do the same.
        steady_s: standard deviation of the average over time that is the slow share [s]; it comes
            from the same jump.
        ridge: weight of the squared forces.
        moment: weight of the total moment relative to the total force.
    """

    friction: float = 0.8
    pivot_height: float = 0.25
    pivot: float = 0.06
    side_pivot_height: float = 1.0
    side_pivot: float = 0.003
    steady: float = 1.0
    steady_s: float = 0.1
    ridge: float = 2e-3
    moment: float = 1.0


GROUND = GroundSettings()

ALIKE = 4
"""Exponent of the feet's overlap: the nearness that they have in common at equal points of the sole."""


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


@dataclass(frozen=True)
class SlowShare:
    """Slow share of the feet in the vertical force.

    Attributes:
        share: of the left foot, averaged over time, (T,).
        alike: how much both feet do the same, 0 to 1, (T,).
    """

    share: Float
    alike: Float


def slow_share(ground: GroundReaction, sole: SolePoints, fps: float, settings: GroundSettings = GROUND) -> SlowShare:
    """Average of the share of earlier ground forces over the time in which both feet do the same."""
    near = sole.nearness
    overlap = near.min(axis=1).sum(axis=-1) / np.maximum(near.max(axis=1).sum(axis=-1), NEAR)
    alike = overlap**ALIKE
    vertical = ground.wrenches[..., 2] * alike[:, None] + np.finfo(np.float64).tiny
    average = gaussian_filter1d(vertical, settings.steady_s * fps, axis=0, mode="nearest")
    return SlowShare(average[:, 0] / average.sum(axis=1), alike)


def ground_reaction(
    segments: SegmentMotion,
    needed: Effort,
    sole: SolePoints,
    left: Float,
    settings: GroundSettings = GROUND,
    slow: SlowShare | None = None,
) -> GroundReaction:
    """Ground forces on both feet that fit best the wrench of the motion.

    Args:
        segments: motion of the masses.
        needed: forces and moments that move them.
        sole: points at which the ground may act.
        left: the body's left axis, of which the horizontal part is used, (T, 3).
        settings: weights.
        slow: share of the feet in an earlier solution; None: nothing is known of it.
    """
    frames = len(segments)
    weight = float(segments.mass.sum()) * GRAVITY
    centre = segments.centre
    wanted = needed.about(centre) / weight
    pyramid = np.concatenate([settings.friction * EDGES, np.ones((len(EDGES), 1))], axis=1)
    wrenches = _edge_wrenches(sole.position - centre[:, None, None], pyramid)
    lateral = unit(left * [1.0, 1.0, 0.0])
    ahead = np.cross(lateral, [0.0, 0.0, 1.0])
    pivots = np.stack(
        [
            np.sqrt(factor) * _about_pivot(wrenches, pyramid, height, axis)
            for factor, height, axis in (
                (settings.pivot, settings.pivot_height, lateral),
                (settings.side_pivot, settings.side_pivot_height, ahead),
            )
        ],
        axis=-1,
    )
    near = sole.nearness.reshape(frames, -1)

    forces = np.zeros((frames, 2 * POINTS, 3))
    for frame in range(frames):
        used = np.flatnonzero(near[frame] > 0)
        if len(used):
            edges = _share(
                wanted[frame],
                wrenches[frame, used],
                pivots[frame, used],
                near[frame, used],
                used // POINTS,
                settings,
                (0.0, 0.0) if slow is None else (slow.share[frame], slow.alike[frame]),
            )
            forces[frame, used] = weight * edges @ pyramid
    return _collect(forces.reshape(frames, 2, POINTS, 3), sole, centre, wanted * weight)


def _edge_wrenches(arms: Float, pyramid: Float) -> Float:
    """Force and moment about the centre of mass of every edge of every pyramid, (T, 24, 4, 6)."""
    frames = len(arms)
    moments = np.cross(arms.reshape(frames, -1, 1, 3), pyramid)
    return np.concatenate([np.broadcast_to(pyramid, moments.shape), moments], axis=-1)


def _about_pivot(wrenches: Float, pyramid: Float, height: float, axis: Float) -> Float:
    """Moment of every edge about a point above the centre of mass, around an axis per frame, (T, 24, 4)."""
    moments = wrenches[..., 3:] - np.cross([0.0, 0.0, height], pyramid)
    found: Float = np.einsum("tpei,ti->tpe", moments, axis)
    return found


def _share(
    wanted: Float,
    wrenches: Float,
    pivots: Float,
    near: Float,
    foot: NDArray[np.intp],
    settings: GroundSettings,
    slow: tuple[float, float],
) -> Float:
    """Shares of the edges at N points in one frame, (N, 4) [body weights].

    `pivots` are the weighted moments about both pivots, (N, 4, 2); `slow` is the slow share and the feet's likeness.
    """
    count, edges, _ = pivots.shape
    whole, about, owner = wrenches.reshape(-1, 6), pivots.reshape(-1, 2), np.repeat(foot, edges)
    weighted = whole * [1.0, 1.0, 1.0, *3 * [settings.moment]]
    hessian = weighted @ whole.T + (owner[:, None] == owner) * (about @ about.T)
    share, alike = slow
    if settings.steady * alike > 0:
        # Every edge carries a vertical force of 1: this is (1 - s) f_l - s f_r.
        departure = np.where(owner == 0, 1 - share, -share)
        hessian += settings.steady * alike * np.outer(departure, departure)
    linear = -weighted @ wanted
    hessian[np.diag_indices(len(hessian))] += settings.ridge * np.repeat(1 / np.maximum(near, NEAR), edges)
    size = count * edges
    solution, _, status, _ = daqp.solve(
        hessian, linear, np.empty((0, size)), np.full(size, 1e30), np.zeros(size), np.zeros(size, np.int32)
    )
    if status < 1:
        raise ArithmeticError(f"ground force: daqp failed with status {status}")
    # The solver's tolerance lets shares be below zero by millionths.
    shares: Float = np.maximum(solution, 0.0).reshape(count, edges)
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
