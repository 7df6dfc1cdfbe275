"""`SegmentMotion`: motion of the masses of a human, for the equations of motion of a whole clip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import neighbour_weights
from flexmotion.biomechanics.motion_loops import derive
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
    """Forward kinematics, derivatives of segment positions and rotations by central differences.

    Segments are differentiated, not joint coordinates: three hinges near gimbal lock rotate fast while the limb moves
    smoothly.
    """
    found = segments_at_rest(motion)
    _derive(found, motion, _every(motion.body))
    return found


def segments_at_rest(motion: Motion, known: Mapping[str, Float] | None = None) -> SegmentMotion:
    """The poses of a motion, each as if it were held: forward kinematics, no acceleration.

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
    still, first = segments_at_rest(motion), len(segments) - len(motion)
    now = {name: np.concatenate([getattr(segments, name)[:first], getattr(still, name)]) for name in _POSES}
    moved = np.flatnonzero(carried(motion.body)[joints].any(axis=0))
    found = replace(
        segments,
        **now,
        acceleration=segments.acceleration.copy(),
        angular_momentum_rate=segments.angular_momentum_rate.copy(),
    )
    _derive(found, motion, moved)
    return found


def _derive(segments: SegmentMotion, motion: Motion, which: NDArray[np.intp]) -> None:
    """Write the derivatives of some segments."""
    derive(
        neighbour_weights(1, len(segments)),
        neighbour_weights(2, len(segments)),
        human_model(motion.body).model.body_inertia,
        segments.com,
        segments.rotation,
        which,
        segments.acceleration,
        segments.angular_momentum_rate,
        motion.fps,
    )


@lru_cache(maxsize=32)
def _every(body: Body) -> NDArray[np.intp]:
    return np.arange(human_model(body).model.nbody)


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
