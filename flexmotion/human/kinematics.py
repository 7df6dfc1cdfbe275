"""Forward kinematics of human motion: positions of joints, feet, hands and centre of mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.body import Body
from flexmotion.human.human_model import HumanModel, human_model
from flexmotion.human.motion import Motion
from flexmotion.human.pose_loops import poses
from flexmotion.human.skeleton import SIDES

Float = NDArray[np.float64]

SIDED_BODIES = {
    "hip": "femur",
    "knee": "tibia",
    "ankle": "talus",
    "shoulder": "humerus",
    "elbow": "ulna",
    "wrist": "hand",
}
"""Joint centre -> body of the model whose origin it is."""

SIDED_SITES = ("heel", "toe", "hand")

STATE = ("xpos", "xipos", "xmat", "xanchor", "xaxis", "site_xpos")
"""Arrays of MuJoCo's state that `frame_arrays` makes."""
FORWARD = ("xpos", "xipos", "xmat", "site_xpos")
"""Those that `forward` is made of."""


@dataclass(frozen=True)
class HumanKinematics:
    """Positions [m] and rotations of every frame in the world; sides are ordered left, right.

    Rotation matrices map a segment's axes (x forward, y left, z up in upright stance) into the world.

    Attributes:
        com: centre of mass of the whole body, (T, 3).
        pelvis_position: midpoint of the hips, (T, 3).
        pelvis_rotation, torso_rotation, head_rotation: (T, 3, 3).
        hip, knee, ankle: joint centres, (T, 2, 3).
        heel, toe: sole points at the back of the heel and under the toe joint, (T, 2, 3).
        foot_rotation: x along the foot to the toes, z up when it stands flat, (T, 2, 3, 3).
        shoulder, elbow, wrist: joint centres, (T, 2, 3).
        hand: centre of the closed fist, (T, 2, 3).
        hand_rotation: z from the fist to the forearm, x out of the palm, (T, 2, 3, 3).
        vertex: top of the head, (T, 3).
    """

    com: Float
    pelvis_position: Float
    pelvis_rotation: Float
    torso_rotation: Float
    head_rotation: Float
    hip: Float
    knee: Float
    ankle: Float
    heel: Float
    toe: Float
    foot_rotation: Float
    shoulder: Float
    elbow: Float
    wrist: Float
    hand: Float
    hand_rotation: Float
    vertex: Float

    def __len__(self) -> int:
        return len(self.com)

    def __getitem__(self, frames: slice) -> HumanKinematics:
        """The frames of a slice (views, not copies)."""
        return HumanKinematics(**{item.name: getattr(self, item.name)[frames] for item in fields(self)})

    def __add__(self, other: HumanKinematics) -> HumanKinematics:
        """The frames of both, one after the other."""
        return HumanKinematics(
            **{
                item.name: np.concatenate([getattr(self, item.name), getattr(other, item.name)])
                for item in fields(self)
            }
        )


def forward(motion: Motion, known: Mapping[str, Float] | None = None) -> HumanKinematics:
    """Kinematics of every frame of a motion, by forward kinematics on the model of its body.

    Args:
        known: `named_arrays` of `FORWARD` of these frames, where they are known.
    """
    human = human_model(motion.body)
    arrays = named_arrays(motion, FORWARD) if known is None else known
    bodies, centres, matrices, sites = (arrays[name] for name in FORWARD)
    return _collect(human, bodies, centres, matrices.reshape(*bodies.shape, 3), sites)


def foot_points(motion: Motion) -> Float:
    """Heel and toe of both feet in every frame, (T, 2, 2, 3) [m]: left and right, heel and toe; less than `forward`."""
    sites, needed = _feet(motion.body)
    return _state(motion, needed)[-1].take(sites, axis=1)


def frame_arrays(motion: Motion, *names: str) -> tuple[Float, ...]:
    """Arrays of MuJoCo's state, by name, after forward kinematics of every frame, (T, ...) each.

    Args:
        motion: of the human.
        names: of `STATE`, such as `xpos`, (B, 3) [m], and `xmat`, (B, 9).

    Raises:
        ValueError: another name.
    """
    unknown = [name for name in names if name not in STATE]
    if unknown:
        raise ValueError(f"no arrays {', '.join(unknown)}, expected some of {', '.join(STATE)}")
    state = _state(motion, _all(motion.body))
    return tuple(state[STATE.index(name)] for name in names)


def _state(motion: Motion, needed: NDArray[np.bool_]) -> tuple[Float, ...]:
    """The arrays of `STATE`, of the needed segments."""
    position, quaternion, joints = (
        np.ascontiguousarray(value, np.float64)
        for value in (motion.root_position, motion.root_quaternion, motion.joints)
    )
    return poses(human_model(motion.body).segments, position, quaternion, joints, needed)


@lru_cache(maxsize=32)
def _all(body: Body) -> NDArray[np.bool_]:
    return np.ones(human_model(body).model.nbody, np.bool_)


@lru_cache(maxsize=32)
def _feet(body: Body) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Sites of heel and toe of both feet, (2, 2), and segments that they need, (B,)."""
    human = human_model(body)
    sites = np.array([[human.site_index[f"{name}_{side}"] for name in ("heel", "toe")] for side in SIDES])
    needed = np.zeros_like(_all(body))
    for segment in human.model.site_bodyid[sites.ravel()]:
        while segment:
            needed[segment] = True
            segment = human.model.body_parentid[segment]
    return sites, needed


def named_arrays(motion: Motion, names: Sequence[str]) -> dict[str, Float]:
    """`frame_arrays` by name."""
    return dict(zip(names, frame_arrays(motion, *names), strict=True))


def _collect(human: HumanModel, bodies: Float, centres: Float, rotations: Float, sites: Float) -> HumanKinematics:
    mass, body, site = human.model.body_mass, human.body_index, human.site_index

    def sided(array: Float, index: dict[str, int], name: str) -> Float:
        # A slice of two: a view, where a list of two numbers would copy.
        left, right = (index[f"{name}_{side}"] for side in SIDES)
        return array[:, left : right + 1 : right - left]

    return HumanKinematics(
        com=np.einsum("b,tbi->ti", mass / mass.sum(), centres),
        pelvis_position=bodies[:, body["pelvis"]],
        pelvis_rotation=rotations[:, body["pelvis"]],
        torso_rotation=rotations[:, body["torso"]],
        head_rotation=rotations[:, body["head"]],
        foot_rotation=sided(rotations, body, "calcaneus"),
        hand_rotation=sided(rotations, body, "hand"),
        vertex=sites[:, site["vertex"]],
        **{name: sided(bodies, body, origin) for name, origin in SIDED_BODIES.items()},
        **{name: sided(sites, site, name) for name in SIDED_SITES},
    )
