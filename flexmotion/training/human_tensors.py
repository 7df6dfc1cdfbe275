"""`HumanTensors`: constants of many human models, for kinematics and dynamics in torch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import mujoco
import numpy as np
import torch
from torch import Tensor

from flexmotion.biomechanics.static_optimisation import strength
from flexmotion.features.joint_groups import BALLS, HINGES, sign
from flexmotion.features.layout import POINTS
from flexmotion.human.body import Body
from flexmotion.human.human_model import AXES, SEGMENTS, human_model
from flexmotion.human.kinematics import SIDED_BODIES
from flexmotion.human.skeleton import JOINTS


def _tree() -> tuple[int, ...]:
    model, index = human_model(Body()).model, human_model(Body()).body_index
    segment = {index[name]: number for number, name in enumerate(SEGMENTS)}
    return tuple(segment.get(int(model.body_parentid[index[name]]), -1) for name in SEGMENTS)


def _moved_by(joint: str) -> int:
    model, index = human_model(Body()).model, human_model(Body()).body_index
    names = {number: name for name, number in index.items()}
    return SEGMENTS.index(names[int(model.jnt_bodyid[model.joint(joint).id])])


PARENTS = _tree()
"""Parent of every segment of `SEGMENTS`, -1 for the pelvis."""

BALL_SEGMENTS = tuple(_moved_by(ball[0]) for ball in BALLS)
HINGE_SEGMENTS = tuple(_moved_by(hinge) for hinge in HINGES)
"""Segment that each ball joint moves, and each hinge."""

HINGE_AXES = np.array(
    [np.abs(AXES[name[:-2]]) * sign(name) for name in HINGES],
)
"""Axes of the single hinges, signs included, (8, 3)."""

JOINT_SEGMENTS = tuple(_moved_by(joint) for joint in JOINTS)
FEET = tuple(SEGMENTS.index(f"calcaneus_{side}") for side in ("l", "r"))
LOADED = tuple(SEGMENTS.index(name) for name in ("torso", "hand_l", "hand_r"))
"""Segments on which external loads act, in the order of a set's field `loads`."""

LOADS = len(LOADED) + 1
"""Forces of a frame: on each of `LOADED`, and the difference of gravity from that of a level floor, on all segments by
their mass."""

ANKLES = tuple(SEGMENTS.index(f"talus_{side}") for side in ("l", "r"))


def _carried() -> np.ndarray:
    """Segments that each joint carries, (26, 21), 1 or 0."""
    carries = np.zeros((len(JOINTS), len(SEGMENTS)))
    for row, moved in enumerate(JOINT_SEGMENTS):
        for number in range(len(SEGMENTS)):
            ancestor = number
            while ancestor not in (-1, moved):
                ancestor = PARENTS[ancestor]
            carries[row, number] = ancestor == moved
    return carries


CARRIED = _carried()


@dataclass(frozen=True)
class HumanTensors:
    """Constants of N humans; S = 21 segments, P points of `layout.POINTS`.

    Attributes:
        offset: origin of each segment in its parent, (N, S, 3) [m].
        turn: fixed rotation of each segment in its parent, (N, S, 3, 3).
        mass: (N, S) [kg].
        com: centre of mass in the segment, (N, S, 3) [m].
        inertia: principal moments about it, along the segment's axes, (N, S, 3) [kg·m²].
        point: of `layout.POINTS` in their segments, (N, P, 3) [m].
        leg: (N,) [m].
        strength: ratio of muscle torques to those of the muscle models, (N,).
    """

    offset: Tensor
    turn: Tensor
    mass: Tensor
    com: Tensor
    inertia: Tensor
    point: Tensor
    leg: Tensor
    strength: Tensor

    @classmethod
    def of(cls, bodies: Sequence[Body], dtype: torch.dtype = torch.float32) -> HumanTensors:
        """Constants of these humans."""
        constants = {body: _constants(body) for body in dict.fromkeys(bodies)}
        rows = [constants[body] for body in bodies]
        names = [item.name for item in fields(cls)]
        return cls(**{name: torch.tensor(np.stack([row[name] for row in rows]), dtype=dtype) for name in names})

    def __getitem__(self, index: Tensor) -> HumanTensors:
        """Constants of some of the humans, in any order."""
        return HumanTensors(**{item.name: getattr(self, item.name)[index] for item in fields(self)})

    def to(self, device: torch.device) -> HumanTensors:
        """On another device."""
        return HumanTensors(**{item.name: getattr(self, item.name).to(device) for item in fields(self)})


def _point_segments() -> tuple[int, ...]:
    owners = {**SIDED_BODIES, "heel": "calcaneus", "toe": "toes"}
    return tuple(SEGMENTS.index(f"{owners.get(name[:-2], name[:-2])}_{name[-1]}") for name in POINTS)


POINT_SEGMENTS = _point_segments()
"""Segment to which each point of `layout.POINTS` is fixed."""


def _constants(body: Body) -> dict[str, np.ndarray]:
    human = human_model(body)
    model, rows = human.model, [human.body_index[name] for name in SEGMENTS]
    turn = np.empty((len(rows), 9))
    for number, row in enumerate(rows):
        mujoco.mju_quat2Mat(turn[number], model.body_quat[row])
    point = np.zeros((len(POINTS), 3))
    for number, name in enumerate(POINTS):
        if name in human.site_index:
            point[number] = model.site_pos[human.site_index[name]]
    return {
        "offset": model.body_pos[rows] * (np.array(PARENTS) >= 0)[:, None],
        "turn": turn.reshape(-1, 3, 3),
        "mass": model.body_mass[rows],
        "com": model.body_ipos[rows],
        "inertia": model.body_inertia[rows],
        "point": point,
        "leg": np.array(body.leg),
        "strength": np.array(strength(body)),
    }
