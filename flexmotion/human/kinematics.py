"""Forward kinematics of human motion: positions of joints, feet, hands and centre of mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.human.human_model import HumanModel, human_model, scratch
from flexmotion.human.motion import Motion
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

FORWARD = ("xpos", "xipos", "xmat", "site_xpos")
"""Arrays of MuJoCo's state that `forward` is made of."""


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
    """Kinematics of every frame of a motion, by MuJoCo's forward kinematics on the model of its body.

    Args:
        known: `named_arrays` of `FORWARD` of these frames, where they are known.
    """
    human = human_model(motion.body)
    arrays = named_arrays(motion, FORWARD) if known is None else known
    bodies, centres, matrices, sites = (arrays[name] for name in FORWARD)
    return _collect(human, bodies, centres, matrices.reshape(*bodies.shape, 3), sites)


def foot_points(motion: Motion) -> Float:
    """Heel and toe of both feet in every frame, (T, 2, 2, 3) [m]: left and right, heel and toe; less than `forward`."""
    site = human_model(motion.body).site_index
    (sites,) = frame_arrays(motion, "site_xpos")
    return sites[:, [[site[f"{name}_{side}"] for name in ("heel", "toe")] for side in SIDES]]


def frame_arrays(motion: Motion, *names: str) -> tuple[Float, ...]:
    """Arrays of MuJoCo's state, by name, after forward kinematics of every frame, (T, ...) each.

    Args:
        motion: of the human.
        names: of attributes of `MjData`, such as `xpos`, (B, 3) [m], and `xmat`, (B, 9).
    """
    human = human_model(motion.body)
    model, data, qpos = human.model, scratch(motion.body), human.qpos(motion)
    # Views into the MjData, looked up once: attribute access costs as much as the kinematics.
    state, views = data.qpos, [getattr(data, name) for name in names]
    found = tuple(np.empty((len(motion), *view.shape)) for view in views)
    for frame, pose in enumerate(qpos):
        state[:] = pose
        mujoco.mj_kinematics(model, data)
        for array, view in zip(found, views, strict=True):
            array[frame] = view
    return found


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
