"""`closed`: hands, elbows and feet brought to their places by the limbs alone, after planting and balance.

Planting and balance shift a body by centimetres, and by more the more its legs have changed, so that corrections of the
latent do not converge on a place as it is handed on. Arms hardly move the balance, and the balance is made for feet
that stay where they are asked to be (`staying`). For residuals r of the places and changes c of the angles of a limb,
over smooth functions of time,

    c = argmin |J c - r|² + damping |c|²

is solved a fixed number of times, forward kinematics in between; a step that brings the limb no nearer is not taken.
A foot that is brought to the place of one of its points keeps its direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg.lapack import dposv

from flexmotion.biomechanics.segment_motion import SegmentMotion, segments_at_rest
from flexmotion.features.constraint_layout import PLACES
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor
from flexmotion.features.heading_frame import yaw_matrix
from flexmotion.features.layout import POINTS
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, LEG_JOINTS, SIDES
from flexmotion.sampling.limb_loops import equations
from flexmotion.sampling.limb_pose import LimbPose
from flexmotion.sampling.window_pose import WindowPose, body_points
from flexmotion.spatial.transitions import smoothstep

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Limb:
    """What closes the places of a limb's points.

    Attributes:
        points: of `layout.POINTS` without their side, from the trunk outwards; the first one is moved by none of its
            joints.
        joints: coordinates that move them, without their side.
        carried: how many of the joints move each of the points.
        closes: points whose places it keeps.
        end: point whose distance from the first one is bounded by the limb's length.
        farthest: ways up to half of this are made [m], longer ones less and less, and none that is longer than this.
        rigid: points that move together: those that are not asked follow those that are.
        near: no step is taken where the root mean square of what is missing is smaller than this [m].
    """

    points: tuple[str, ...]
    joints: tuple[str, ...]
    carried: tuple[int, ...]
    closes: tuple[str, ...]
    end: str
    farthest: float = np.inf
    rigid: tuple[str, ...] = ()
    near: float = 1e-3

    def of_points(self, side: str) -> list[int]:
        """Numbers of its points among `layout.POINTS`."""
        return [POINTS.index(f"{point}_{side}") for point in self.points]

    def of_closed(self, side: str) -> list[int]:
        """Numbers of the points that it closes."""
        return [POINTS.index(f"{point}_{side}") for point in self.closes]

    def of_joints(self, side: str) -> list[int]:
        """Numbers of its joints among `skeleton.JOINTS`."""
        return [JOINTS.index(f"{joint}_{side}") for joint in self.joints]


ARM = Limb(("shoulder", "elbow", "hand"), ARM_JOINTS[:4], (0, 3, 4), ("elbow", "hand"), "hand")
"""Pronation does not move the fist."""

LEG = Limb(
    ("hip", "knee", "ankle", "heel", "toe"),
    LEG_JOINTS,
    (0, 3, 4, 5, 5),
    ("ankle", "heel", "toe"),
    "ankle",
    farthest=0.5,
    rigid=("ankle", "heel", "toe"),
    near=1e-4,
)
"""A knee is not closed: the foot would leave its place with it. A foot that is to stand still while its body walks on
is left behind less: reaching for it without a bound left a residual of 66 % of body weight, now 22. The error
of a resting foot stays in all later windows: with errors up to 1 mm, a standing human drifted 22 cm in ten minutes."""

STAYS = 0.03
"""A foot that is so near to where it is asked to be stays there [m]."""

LIMBS = (ARM, LEG)

IN_REACH = 0.98
"""Share of an arm's length within which `within_arms` takes a place to be in reach."""

FOLLOWING = 0.3
"""Weight of points that follow those that are asked, which have 1."""

ROUNDS = 5
"""Steps at most."""

SHORTER = 0.3
"""Share of a step that is tried after one that did not bring the limb nearer."""

SLOWLY = 0.8
"""A step after which more than this share of the squared error is left is the last one: the limb does not reach."""

KNOT_FRAMES = 3.0
"""Distance of the knots of the functions of time: at 30 frames a second they hold what a window below 5 Hz does."""

BEGUN = 4.0
"""Frames within which the change begins: pose and speed of the history are kept."""

FARTHEST = 0.25
"""Distance that one round makes up for [m]: forward kinematics are nearly linear over it."""

TURNED = 0.8
"""Largest change of an angle in one round [rad]: a limb that is nearly straight would swing far for millimetres."""

EVEN = 0.03
"""Weight of the second differences of the knots' values [m²/rad²]: what keyframes ask for is spread between them."""

DAMPING = 1e-3
"""Square of the distance [m²] that a change of one radian is worth: a stretched limb is not swung for a millimetre."""


def closable(constraints: Constraints, limbs: Sequence[Limb] = LIMBS) -> NDArray[np.bool_]:
    """Columns whose places limbs keep, (C,)."""
    found = np.zeros(constraints.layout.size, np.bool_)
    first = constraints.layout.blocks[PLACES].start
    for number, name in enumerate(POINTS):
        closes = any(name.rpartition("_")[0] in limb.closes for limb in limbs)
        found[first + 3 * number : first + 3 * (number + 1)] = closes
    return found


def closed(
    motion: Motion,
    anchor: Anchor,
    constraints: Constraints,
    limbs: Sequence[Limb] = LIMBS,
    segments: SegmentMotion | None = None,
) -> Motion:
    """The motion with points of its limbs that are asked at their places, as far as the limbs reach.

    Args:
        motion: the window.
        anchor: the frame before it.
        constraints: what is asked; all else than places of `Limb.closes` is left.
        limbs: that may move.
        segments: of the motion, in the world, where they are known.
    """
    asked, places = _asked(constraints, motion.body.leg)
    moving = [
        (limb, sides) for limb in limbs if (sides := [side for side in SIDES if asked[:, limb.of_closed(side)].any()])
    ]
    if not moving:
        return motion
    pose, joints = segments_at_rest(motion) if segments is None else segments, motion.joints.copy()
    turn, place = yaw_matrix(np.array(anchor.yaw)), body_points(motion.body, pose.position, pose.rotation)
    for limb, sides in moving:
        # Both sides are solved at once, as if the frames of one came after those of the other.
        points, columns = [limb.of_points(side) for side in sides], [limb.of_joints(side) for side in sides]
        centre, axis = anchor.local(_by_side(pose.anchor, columns)), _by_side(pose.axis, columns) @ turn
        own = LimbPose(centre, axis, anchor.local(_by_side(place, points)), limb.carried)
        wanted = Wanted.of(limb, own, _by_side(asked, points), _by_side(places, points))
        told = np.flatnonzero(wanted.weight.any(axis=(0, 2)))
        angles, limits = np.stack([joints[:, own] for own in columns]), joint_limits()[columns]
        angles = _closed(own.only(told), angles, limits, wanted.only(told), limb.near)
        for own_columns, found in zip(columns, angles, strict=True):
            joints[:, own_columns] = found
    return motion.changed(joints=joints)


def _by_side(values: NDArray, columns: list[list[int]]) -> NDArray:
    """Columns of each of S sides, one side's frames after the other's, (W, C, 3) -> (S W, K, 3)."""
    return np.concatenate([values[:, own] for own in columns])


def staying(motion: Motion, anchor: Anchor, constraints: Constraints) -> NDArray[np.bool_] | None:
    """Feet that stand at a place of the floor that is asked of them, ahead and aside, (W, 2); None: no frame has one.

    Args:
        motion: the window, its legs closed.
        anchor: the frame before it.
        constraints: what is asked.
    """
    asked, places = _asked(constraints, motion.body.leg)
    feet = [LEG.of_closed(side) for side in SIDES]
    told = asked[:, feet, :2].all(axis=-1)
    if not told.any():
        return None
    away = WindowPose.of(motion, anchor).points[:, feet, :2] - places[:, feet, :2]
    there = np.linalg.norm(away, axis=-1) < STAYS
    return np.asarray(told.any(axis=-1) & (there | ~told).all(axis=-1), np.bool_)


def within_arms(pose: WindowPose, constraints: Constraints, most: float) -> bool:
    """Whether arms alone bring all hands that are asked to their places: near, in reach, and no elbow is asked.

    Args:
        pose: of the window.
        constraints: what is asked.
        most: distance of the hands from their places [m].
    """
    asked, places = _asked(constraints, pose.body.leg)
    for side in SIDES:
        columns = ARM.of_points(side)
        mask, (shoulder, _, hand) = asked[:, columns], np.moveaxis(pose.points[:, columns], 1, 0)
        if mask[:, 1].any():
            return False  # an elbow moves on a sphere
        if not mask[:, -1].any():
            continue
        wanted = np.where(mask[:, -1], places[:, columns[-1]], hand)
        reach = IN_REACH * _reach(ARM, pose.points[:, columns])
        beyond = (_lengths(wanted - hand) > most) | (_lengths(wanted - shoulder) > reach)
        if (beyond & mask[:, -1].any(axis=1)).any():
            return False
    return True


def _asked(constraints: Constraints, leg: float) -> tuple[NDArray[np.bool_], Float]:
    """Which coordinates of points are asked, (W, 16, 3), and places, (W, 16, 3) [m]."""
    columns = constraints.layout.blocks[PLACES]
    frames = len(constraints.mask)
    mask = constraints.mask[:, columns].reshape(frames, -1, 3)
    return mask, constraints.values[:, columns].reshape(frames, -1, 3) * leg


@dataclass(frozen=True)
class Wanted:
    """Where the P points of a limb are wanted.

    Attributes:
        places: within the limb's reach, (W, P, 3) [m].
        weight: of their coordinates, (W, P, 3); 0 where nothing is asked.
    """

    places: Float
    weight: Float

    @classmethod
    def of(cls, limb: Limb, pose: LimbPose, asked: NDArray[np.bool_], places: Float) -> Wanted:
        """What is asked of a limb in a pose, and what follows from it.

        Args:
            limb, pose: of which.
            asked: coordinates of its points, (W, P, 3).
            places: of its points, (W, P, 3) [m].
        """
        own, end = pose.points, limb.points.index(limb.end)
        closes = np.array([point in limb.closes for point in limb.points])
        asked = asked & closes[:, None]
        places, weight = np.where(asked, places, own), asked.astype(np.float64)
        if limb.rigid:
            rigid = [limb.points.index(point) for point in limb.rigid]
            told = asked[:, rigid]
            way = (places - own)[:, rigid].sum(axis=1) / np.maximum(told.sum(axis=1), 1)
            places[:, rigid] = np.where(told, places[:, rigid], own[:, rigid] + way[:, None])
            weight[:, rigid] = np.where(told, 1.0, FOLLOWING * told.any(axis=(1, 2), keepdims=True))
            # No foot is brought below the floor, or below where it is.
            places[:, rigid, 2] = np.maximum(places[:, rigid, 2], np.minimum(own[:, rigid, 2], 0.0))
        if np.isfinite(limb.farthest):
            way = places - own
            length = np.sqrt(np.einsum("tpi,tpi->tp", way, way))[..., None]
            made = np.minimum(np.maximum(2.0 - 2.0 * length / limb.farthest, 0.0), 1.0)
            places = own + made * way
        # What the limb's end lacks of its place beyond the limb's reach, the points that move with it lack as well.
        away, reach = places[:, end] - own[:, 0], _reach(limb, own)
        short = away * np.minimum(0.0, reach / np.maximum(_lengths(away), 1e-6) - 1.0)[:, None]
        places[:, [end, *(limb.points.index(point) for point in limb.rigid if point != limb.end)]] += short[:, None]
        return cls(places, weight)

    def only(self, points: NDArray[np.intp]) -> Wanted:
        """The same of some of the points."""
        return Wanted(self.places.take(points, axis=1), self.weight.take(points, axis=1))

    def errors(self, pose: LimbPose, sides: int) -> Float:
        """Weighted sums of the squared distances from the places, of each of S sides, (S,) [m²]."""
        return _squares(self.weight * (self.places - pose.points), sides)


def _closed(pose: LimbPose, angles: Float, limits: Float, wanted: Wanted, near: float) -> Float:
    """Angles of the J joints of a limb on S sides with which its points are where they are wanted; see `_change`.

    Args:
        pose, wanted: of all sides, (S W, ...).
        angles: as they are, (S, W, J) [rad].
        limits: least and greatest angle, (S, J, 2) [rad].
        near: see `Limb`.

    Returns:
        (S, W, J) [rad].
    """
    sides = len(angles)
    share, error = np.ones(sides), wanted.errors(pose, sides)
    low, high = limits[:, None, :, 0], limits[:, None, :, 1]
    enough = near**2 * _squares(wanted.weight, sides)
    for _ in range(ROUNDS):
        going = error > enough
        if not going.any():
            break
        moved = angles + share[:, None, None] * _change(pose, wanted, sides)
        # Angles that are beyond their limits already stay where they are.
        moved = np.minimum(np.maximum(moved, np.minimum(low, angles)), np.maximum(high, angles))
        there = pose.moved((moved - angles).reshape(len(pose.points), -1))
        left = wanted.errors(there, sides)
        nearer = going & (left < error)
        pose = there if nearer.all() else pose.where(~np.repeat(nearer, len(pose.points) // sides), there)
        angles = np.where(nearer[:, None, None], moved, angles)
        # A limb at its limits, or at a singular angle, is tried with less; one that gets no nearer is done.
        share = np.where(nearer, share, SHORTER * share)
        enough = np.where(nearer & (left > SLOWLY * error), np.inf, enough)
        error = np.where(nearer, left, error)
    return angles


def _change(pose: LimbPose, wanted: Wanted, sides: int) -> Float:
    """Change of the angles of a limb on S sides, (S, W, J) [rad]."""
    size, frames = pose.axis.shape[1], len(pose.axis) // sides
    over = _functions(frames)
    # The joints of a frame are summed up before functions of time are: a frame's rows share those.
    anchor, axis, points, places, weight = map(
        np.ascontiguousarray, (pose.anchor, pose.axis, pose.points, wanted.places, wanted.weight)
    )
    squares, pulled = equations(anchor, axis, points, np.array(pose.carried), places, weight, FARTHEST)
    squares, pulled = squares.reshape(sides, frames, -1), pulled.reshape(sides, frames, size)
    normal = (squares.swapaxes(-1, -2) @ _products(frames)).reshape(sides, size, size, over.shape[1], -1)
    normal = normal.swapaxes(2, 3).reshape(sides, size * over.shape[1], -1) + _evenness(frames, size)
    right = (pulled.swapaxes(-1, -2) @ over).reshape(sides, -1)
    # By LAPACK alone: SciPy's own calls take as long again. What is damped has a solution; a symmetric matrix is its
    # own transpose, which has LAPACK's order and is not copied.
    found = np.array([dposv(own.T, to, overwrite_a=True)[1] for own, to in zip(normal, right, strict=True)])
    change: Float = over @ found.reshape(sides, size, -1).swapaxes(-1, -2)
    return change * np.minimum(1.0, TURNED / np.maximum(np.abs(change).max(axis=(1, 2)), 1e-6))[:, None, None]


def _squares(values: Float, sides: int) -> Float:
    """Sums of the squares of the values of each of S sides, (S W, P, 3) -> (S,)."""
    found: Float = np.square(values.reshape(sides, -1)).sum(axis=1)
    return found


def _reach(limb: Limb, points: Float) -> Float:
    """Length of a limb from its first point to its end, of its points (W, P, 3) [m], (W,) [m]."""
    chain = points[:, : limb.points.index(limb.end) + 1]
    ways = chain[:, 1:] - chain[:, :-1]
    found: Float = np.sqrt(np.einsum("tpi,tpi->tp", ways, ways)).sum(axis=1)
    return found


def _lengths(vectors: Float) -> Float:
    found: Float = np.sqrt(np.einsum("ti,ti->t", vectors, vectors))
    return found


@lru_cache(maxsize=8)
def _evenness(frames: int, joints: int) -> Float:
    """Quadratic form of the coefficients of all joints and of their second differences, (J K, J K)."""
    own = np.eye(_functions(frames).shape[1])
    even = np.diff(own, n=2, axis=0)
    return np.asarray(np.kron(np.eye(joints), EVEN * even.T @ even + DAMPING * own), np.float64)


@lru_cache(maxsize=4)
def _products(frames: int) -> Float:
    """Products of every two of `_functions`, (W, K K)."""
    over = _functions(frames)
    return np.asarray(over[:, :, None] * over[:, None], np.float64).reshape(frames, -1)


@lru_cache(maxsize=4)
def _functions(frames: int) -> Float:
    """Cubic B-splines over the frames of a window, zero and level before the first, (W, K)."""
    # Evenly spaced beyond both ends, so that even coefficients are even changes.
    knots = KNOT_FRAMES * np.arange(-3.0, np.ceil(frames / KNOT_FRAMES) + 4.0)
    time = np.arange(1.0, frames + 1)
    found: Float = BSpline.design_matrix(time, knots, 3).toarray()
    return found * smoothstep(time, 0.0, BEGUN)[:, None]
