"""`Layout`: blocks of features that describe a frame to the model.

Lengths are in leg lengths of the human (`Body.leg`), forces in body weights, moments in body weights x leg, so that
people of every size share one model. Vectors are in the heading frame of their own frame: z up, x along the heading of
the pelvis.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property

from flexmotion.features.joint_groups import ROTATION_SIZE
from flexmotion.human.skeleton import CONTACT_JOINTS, JOINTS, SIDES

POINTS: tuple[str, ...] = tuple(
    f"{point}_{side}"
    for side in SIDES
    for point in ("hip", "knee", "ankle", "heel", "toe", "shoulder", "elbow", "hand")
)
"""Points of the body whose positions, velocities and accelerations are features."""

BLOCKS: dict[str, int] = {
    "root": 4,  # velocity forward and left [leg/s], turning [rad/s], height of the pelvis [leg]
    "rotations": ROTATION_SIZE,  # see `joint_groups`
    "positions": 3 * len(POINTS),  # from the floor below the pelvis [leg]
    "velocities": 3 * len(POINTS),  # in the world [leg/s]
    "accelerations": 3 * len(POINTS),  # in the world [leg/s²]
    "torques": len(JOINTS),  # [weight x leg]
    "wrenches": 12,  # force and moment about the ankle, left and right foot [weight, weight x leg]
    "contacts": 2,  # whether a foot carries load, 0 or 1
}
"""Sizes of the blocks of every layout, in order."""

JOINT_CONTACT = "joint_contact"
"""Name of an optional block behind the wrenches: contact forces of `CONTACT_JOINTS`, in segment axes [weight]."""

KINEMATIC = ("root", "rotations", "positions", "velocities")
"""Inputs of the model (of its history) and of the evaluator: at run time kinematics are known, torques and forces are
not."""

ACTIVATIONS = "activations"
"""Name of the last block: muscle activations in [0, 1]; absent for sets without muscles."""

FORCES = ("torques", "wrenches", JOINT_CONTACT, "contacts", ACTIVATIONS)
"""Blocks that are estimated from the motion by `biomechanics`, not recorded."""


@dataclass(frozen=True)
class Layout:
    """Content of a feature vector, its skeleton and frame rate.

    Attributes:
        fps: frames per second.
        muscles: number of activations.
        joint_contact: whether joint contact forces are part of a frame.
        joints, points: names in the order of the blocks that depend on them.
    """

    fps: float
    muscles: int = 0
    joints: tuple[str, ...] = JOINTS
    points: tuple[str, ...] = POINTS
    joint_contact: bool = False

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Block -> its columns."""
        sizes = {}
        for name, size in BLOCKS.items():
            sizes[name] = size
            if name == "wrenches" and self.joint_contact:
                sizes[JOINT_CONTACT] = 3 * len(CONTACT_JOINTS)
        if self.muscles:
            sizes[ACTIVATIONS] = self.muscles
        slices, start = {}, 0
        for name, size in sizes.items():
            slices[name] = slice(start, start + size)
            start += size
        return slices

    @property
    def kinematic(self) -> dict[str, slice]:
        """The blocks of `KINEMATIC`."""
        return {name: self.blocks[name] for name in KINEMATIC}

    @property
    def size(self) -> int:
        """Features of a frame."""
        return list(self.blocks.values())[-1].stop

    @cached_property
    def hash(self) -> str:
        """Hash of everything that must agree between a model and its users.

        The blocks tell whether there are joint contact forces: layouts without them have the hash that they had before
        the block existed.
        """
        content = {**asdict(self), "blocks": {name: [cut.start, cut.stop] for name, cut in self.blocks.items()}}
        del content["joint_contact"]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
