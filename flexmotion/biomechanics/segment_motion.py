"""`SegmentMotion`: motion of the masses of a human, for the equations of motion of a whole clip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import derivative, second_derivative
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_model
from flexmotion.human.kinematics import named_arrays
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS

Float = NDArray[np.float64]


AT_REST = ("xpos", "xipos", "xmat", "xanchor", "xaxis")
"""Arrays of MuJoCo's state that `segments_at_rest` is made of."""
_POSES = ("position", "rotation", "com", "anchor", "axis")
"""Fields of `SegmentMotion` that a pose has without its motion."""


@dataclass(frozen=True)
class SegmentMotion:
    """Segments (B bodies of the model, the world first) and joints (J = 26, order of `JOINTS`) in the world frame.

    Attributes:
        mass: of each segment, (B,) [kg].
        position, rotation: frame of each segment, (T, B, 3) [m] and (T, B, 3, 3).
        com: centre of mass of each segment, (T, B, 3) [m].
        acceleration: of those centres, (T, B, 3) [m/s²].
        angular_momentum_rate: of each segment about its own centre of mass, (T, B, 3) [N·m].
        anchor, axis: of each joint's hinge, (T, J, 3) [m] and unit vectors.
    """

    mass: Float
    position: Float
    rotation: Float
    com: Float
    acceleration: Float
    angular_momentum_rate: Float
    anchor: Float
    axis: Float

    def __len__(self) -> int:
        return len(self.position)

    @property
    def centre(self) -> Float:
        """Centre of mass of the whole body, (T, 3) [m]."""
        return np.einsum("b,tbi->ti", self.mass / self.mass.sum(), self.com)


def segment_motion(motion: Motion) -> SegmentMotion:
    """Kinematics by MuJoCo, derivatives of segment positions and rotations by central differences.

    Segments are differentiated, not joint coordinates: three hinges near gimbal lock rotate fast while the limb moves
    smoothly.
    """
    still, inertia = segments_at_rest(motion), human_model(motion.body).model.body_inertia
    return replace(
        still,
        acceleration=second_derivative(still.com, motion.fps),
        angular_momentum_rate=_angular_momentum_rate(inertia, still.rotation, motion.fps),
    )


def segments_at_rest(motion: Motion, known: Mapping[str, Float] | None = None) -> SegmentMotion:
    """The poses of a motion, each as if it were held: kinematics by MuJoCo, no acceleration.

    Args:
        known: `named_arrays` of `AT_REST` of these frames, where they are known.
    """
    arrays = named_arrays(motion, AT_REST) if known is None else known
    position, com, rotation, anchor, axis = (arrays[name] for name in AT_REST)
    hinges = hinge_index(motion.body)
    return SegmentMotion(
        mass=human_model(motion.body).model.body_mass.copy(),
        position=position,
        rotation=rotation.reshape(*position.shape, 3),
        com=com,
        acceleration=np.zeros_like(com),
        angular_momentum_rate=np.zeros_like(com),
        anchor=anchor.take(hinges, axis=1),
        axis=axis.take(hinges, axis=1),
    )


def moved_by(joints: NDArray[np.bool_], segments: SegmentMotion, motion: Motion) -> SegmentMotion:
    """The segments after some joints of the last frames have changed; only what these carry is differentiated again.

    Args:
        joints: that have changed, (26,).
        segments: as they were, (T, ...), with their derivatives.
        motion: the last of those frames as they became; its root is where it was.
    """
    still, first, fps = segments_at_rest(motion), len(segments) - len(motion), motion.fps
    now = {name: np.concatenate([getattr(segments, name)[:first], getattr(still, name)]) for name in _POSES}
    moved = np.flatnonzero(carried(motion.body)[joints].any(axis=0))
    acceleration, rate = segments.acceleration.copy(), segments.angular_momentum_rate.copy()
    acceleration[:, moved] = second_derivative(now["com"][:, moved], fps)
    inertia = human_model(motion.body).model.body_inertia[moved]
    rate[:, moved] = _angular_momentum_rate(inertia, now["rotation"][:, moved], fps)
    return replace(segments, **now, acceleration=acceleration, angular_momentum_rate=rate)


def _angular_momentum_rate(inertia: Float, rotation: Float, fps: float) -> Float:
    """d/dt (R I Rᵀ ω), inertia tensors in the segments' own axes, (T, B, 3); `inertia`: their diagonals, (B, 3)."""
    # Coordinates first in memory, frames and segments last: a fifth of the time of a product for each of them.
    own, rate = (np.ascontiguousarray(array.transpose(2, 3, 0, 1)) for array in (rotation, derivative(rotation, fps)))
    spin = np.einsum("ji...,jk...->ik...", own, rate)
    # The antisymmetric part, in the segments' axes: finite differences are not exactly skew-symmetric.
    local = np.stack([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]])
    local *= 0.5 * inertia.T[:, None]
    momentum = np.einsum("ij...,j...->i...", own, local)
    return derivative(np.ascontiguousarray(momentum.transpose(1, 2, 0)), fps)


@lru_cache(maxsize=32)
def hinge_index(body: Body) -> NDArray[np.intp]:
    """Index of every joint of `JOINTS` among the model's joints, (26,)."""
    model = human_model(body).model
    return np.array([model.joint(name).id for name in JOINTS], dtype=np.intp)


@lru_cache(maxsize=32)
def carried(body: Body) -> Float:
    """Whether a joint carries a segment, (26, B), 1 or 0."""
    human = human_model(body)
    model = human.model
    carries = np.zeros((len(JOINTS), model.nbody))
    for row, joint in enumerate(hinge_index(body)):
        for segment in range(model.nbody):
            ancestor = segment
            while ancestor and ancestor != model.jnt_bodyid[joint]:
                ancestor = model.body_parentid[ancestor]
            carries[row, segment] = ancestor > 0
    return carries
