"""MuJoCo model of the human: 21 segments, a free pelvis and 26 hinges, built from a `Body`.

In the zero pose the human stands upright and faces x, arms hanging, palms forward; every segment's frame then has
x forward, y left, z up. Hinges act in the order of `skeleton.JOINTS` (intrinsic rotations), about the axes of `AXES`.
Masses of foot and forearm are lumped: the foot on the calcaneus, half of the forearm each on ulna and radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.human.body import Body, Inertia
from flexmotion.human.motion import Motion
from flexmotion.human.pose_loops import Segments
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, LEG_JOINTS, SIDES

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

AXES: dict[str, tuple[float, float, float]] = {
    "lumbar_extension": (0.0, -1.0, 0.0),
    "lumbar_bending": X,
    "lumbar_rotation": Z,
    "neck_extension": (0.0, -1.0, 0.0),
    "neck_bending": X,
    "neck_rotation": Z,
    "hip_flexion": (0.0, -1.0, 0.0),
    "hip_adduction": X,
    "hip_rotation": Z,
    "knee_flexion": Y,
    "ankle_dorsiflexion": (0.0, -1.0, 0.0),
    "shoulder_flexion": (0.0, -1.0, 0.0),
    "shoulder_adduction": X,
    "shoulder_rotation": Z,
    "elbow_flexion": (0.0, -1.0, 0.0),
    "forearm_pronation": Z,
}
"""Hinge axes in the upright frame; adduction and rotation of the left side turn about the opposite axis."""

MIRRORED = frozenset({"hip_adduction", "hip_rotation", "shoulder_adduction", "shoulder_rotation", "forearm_pronation"})
"""Joints whose axis is reversed on the left, so that positive means the same for both sides."""

SIDED_SEGMENTS = ("femur", "tibia", "talus", "calcaneus", "toes", "humerus", "ulna", "radius", "hand")

SEGMENTS: tuple[str, ...] = (
    "pelvis",
    "torso",
    "head",
    *(f"{segment}_{side}" for side in SIDES for segment in SIDED_SEGMENTS),
)
"""The 21 bodies of the model."""

SITES: tuple[str, ...] = (*(f"{site}_{side}" for side in SIDES for site in ("heel", "toe", "tip", "hand")), "vertex")
"""Points on the model: the sole under heel, toe joint and toe tip, the centre of the fist, the top of the head."""

RGBA = (0.55, 0.65, 0.8, 1.0)


@dataclass(frozen=True, eq=False)
class HumanModel:
    """A compiled model and the indices of the human's coordinates in it.

    Attributes:
        body: the human it was made from.
        model: MuJoCo model; bodies are named as in `SEGMENTS`, joints as in `skeleton.JOINTS` (the free joint is
            `root`), sites as in `SITES`. No contacts: ground forces of the human are computed, not simulated.
    """

    body: Body
    model: mujoco.MjModel

    @cached_property
    def qpos_index(self) -> NDArray[np.intp]:
        """Index into `qpos` of every joint of `skeleton.JOINTS`, (26,)."""
        return np.array([self.model.joint(name).qposadr[0] for name in JOINTS], dtype=np.intp)

    @cached_property
    def dof_index(self) -> NDArray[np.intp]:
        """Index into `qvel` of the root's six and of every joint of `skeleton.JOINTS`, (32,)."""
        joints = [self.model.joint(name).dofadr[0] for name in JOINTS]
        return np.array([*range(6), *joints], dtype=np.intp)

    @cached_property
    def body_index(self) -> dict[str, int]:
        """Index of every body by name."""
        return {self.model.body(i).name: i for i in range(self.model.nbody)}

    @cached_property
    def segments(self) -> Segments:
        """What forward kinematics need of it."""
        model = self.model
        turn = np.empty((model.nbody, 9))
        for body in range(model.nbody):
            mujoco.mju_quat2Mat(turn[body], model.body_quat[body])
        names = [model.joint(joint).name for joint in range(model.njnt)]
        return Segments(
            parent=model.body_parentid.astype(np.int64),
            offset=model.body_pos.copy(),
            turn=turn.reshape(-1, 3, 3),
            centre=model.body_ipos.copy(),
            first=model.body_jntadr.astype(np.int64),
            hinged=model.body_jntnum.astype(np.int64),
            columns=np.array([JOINTS.index(name) if name in JOINTS else -1 for name in names], np.int64),
            anchor=model.jnt_pos.copy(),
            axis=model.jnt_axis.copy(),
            bearer=model.site_bodyid.astype(np.int64),
            sites=model.site_pos.copy(),
        )

    @cached_property
    def site_index(self) -> dict[str, int]:
        """Index of every site by name."""
        return {self.model.site(i).name: i for i in range(self.model.nsite)}

    def qpos(self, motion: Motion) -> NDArray[np.float64]:
        """Generalised positions of every frame, (T, 33)."""
        qpos = np.empty((len(motion), self.model.nq))
        qpos[:, :3] = motion.root_position
        qpos[:, 3:7] = motion.root_quaternion
        qpos[:, self.qpos_index] = motion.joints
        return qpos


@lru_cache(maxsize=32)
def human_model(body: Body) -> HumanModel:
    """The model of a human, compiled once per body."""
    return HumanModel(body, human_spec(body).compile())


def human_spec(body: Body) -> mujoco.MjSpec:
    """The model as an editable specification, for callers that add floors, muscles or markers."""
    size = body.segments
    spec = mujoco.MjSpec()
    spec.modelname = "human"
    spec.compiler.degree = False

    pelvis = spec.worldbody.add_body(name="pelvis", pos=[0, 0, body.standing_height])
    pelvis.add_freejoint(name="root")
    lumbar = (size.lumbar_forward, 0.0, size.lumbar_height)
    # The table counts the lower trunk from the top, the pelvis frame from the hips.
    lower = body.inertia("lower_trunk")
    _inertia(pelvis, Inertia(lower.mass, 1 - lower.com, lower.gyration), lumbar)
    _capsule(pelvis, (0, -size.hip_width / 2, 0), (0, size.hip_width / 2, 0), 0.08)
    _capsule(pelvis, (0, 0, 0), lumbar, 0.08)

    torso = pelvis.add_body(name="torso", pos=lumbar)
    _hinges(torso, ("lumbar_extension", "lumbar_bending", "lumbar_rotation"))
    neck = (size.neck_forward, 0.0, size.neck_height)
    _inertia(torso, body.inertia("torso"), neck)
    _capsule(torso, (0, 0, 0), neck, 0.10)
    half = size.shoulder_width / 2
    _capsule(
        torso,
        (size.shoulder_forward, -half, size.shoulder_height),
        (size.shoulder_forward, half, size.shoulder_height),
        0.06,
    )

    head = torso.add_body(name="head", pos=neck)
    _hinges(head, ("neck_extension", "neck_bending", "neck_rotation"))
    _inertia(head, body.inertia("head"), (0, 0, size.head))
    _capsule(head, (0, 0, 0.4 * size.head), (0, 0, 0.7 * size.head), 0.3 * size.head)
    head.add_site(name="vertex", pos=[0, 0, size.head])

    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        _leg(pelvis, body, side, sign)
        _arm(torso, body, side, sign)
    return spec


def _leg(pelvis: mujoco.MjsBody, body: Body, side: str, sign: float) -> None:
    size = body.segments
    femur = pelvis.add_body(name=f"femur_{side}", pos=[0, sign * size.hip_width / 2, 0])
    _hinges(femur, LEG_JOINTS[:3], side)
    _inertia(femur, body.inertia("thigh"), (0, 0, -size.thigh))
    _capsule(femur, (0, 0, 0), (0, 0, -size.thigh), 0.06)

    tibia = femur.add_body(name=f"tibia_{side}", pos=[0, 0, -size.thigh])
    _hinges(tibia, ("knee_flexion",), side)
    _inertia(tibia, body.inertia("shank"), (0, 0, -size.shank))
    _capsule(tibia, (0, 0, 0), (0, 0, -size.shank), 0.045)

    talus = tibia.add_body(name=f"talus_{side}", pos=[0, 0, -size.shank])
    _hinges(talus, ("ankle_dorsiflexion",), side)

    yaw = sign * size.toe_out
    sole = -size.ankle_height
    calcaneus = talus.add_body(name=f"calcaneus_{side}", quat=[math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)])
    tip = size.foot - size.heel - size.ball
    _foot_inertia(calcaneus, body)
    _capsule(calcaneus, (0.02 - size.heel, 0, sole + 0.02), (size.ball, 0, sole + 0.02), 0.02)
    calcaneus.add_site(name=f"heel_{side}", pos=[-size.heel, 0, sole])

    toes = calcaneus.add_body(name=f"toes_{side}", pos=[size.ball, 0, sole])
    _capsule(toes, (0, 0, 0.015), (max(tip - 0.015, 0.01), 0, 0.015), 0.015)
    toes.add_site(name=f"toe_{side}")
    toes.add_site(name=f"tip_{side}", pos=[tip, 0, 0])


def _arm(torso: mujoco.MjsBody, body: Body, side: str, sign: float) -> None:
    size = body.segments
    forearm = body.inertia("forearm")
    half = Inertia(forearm.mass / 2, forearm.com, forearm.gyration)
    shoulder = [size.shoulder_forward, sign * size.shoulder_width / 2, size.shoulder_height]

    humerus = torso.add_body(name=f"humerus_{side}", pos=shoulder)
    _hinges(humerus, ARM_JOINTS[:3], side)
    _inertia(humerus, body.inertia("upper_arm"), (0, 0, -size.upper_arm))
    _capsule(humerus, (0, 0, 0), (0, 0, -size.upper_arm), 0.04)

    ulna = humerus.add_body(name=f"ulna_{side}", pos=[0, 0, -size.upper_arm])
    _hinges(ulna, ("elbow_flexion",), side)
    _inertia(ulna, half, (0, 0, -size.forearm))
    _capsule(ulna, (0, 0, 0), (0, 0, -size.forearm), 0.03)

    radius = ulna.add_body(name=f"radius_{side}")
    _hinges(radius, ("forearm_pronation",), side)
    _inertia(radius, half, (0, 0, -size.forearm))

    hand = radius.add_body(name=f"hand_{side}", pos=[0, 0, -size.forearm])
    _inertia(hand, body.inertia("hand"), (0, 0, -size.hand))
    _capsule(hand, (0, 0, -0.02), (0, 0, -size.hand), 0.035)
    hand.add_site(name=f"hand_{side}", pos=[0, 0, -size.hand])


def _hinges(body: mujoco.MjsBody, names: tuple[str, ...], side: str = "") -> None:
    for name in names:
        sign = -1.0 if side == "l" and name in MIRRORED else 1.0
        axis = [sign * component for component in AXES[name]]
        body.add_joint(name=f"{name}_{side}" if side else name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)


def _inertia(body: mujoco.MjsBody, inertia: Inertia, distal: tuple[float, float, float]) -> None:
    """Mass on the line from the body's origin to `distal`; gyration about the body's own axes."""
    length = math.hypot(*distal)
    body.mass = inertia.mass
    body.ipos = [inertia.com * component for component in distal]
    body.inertia = [inertia.mass * (radius * length) ** 2 for radius in inertia.gyration]
    body.explicitinertial = True


def _foot_inertia(calcaneus: mujoco.MjsBody, body: Body) -> None:
    """Inertia of the foot: longitudinal axis x, sagittal axis z; mass half-way between sole and ankle."""
    size, inertia = body.segments, body.inertia("foot")
    sagittal, transverse, longitudinal = inertia.gyration
    calcaneus.mass = inertia.mass
    calcaneus.ipos = [inertia.com * size.foot - size.heel, 0, -size.ankle_height / 2]
    calcaneus.inertia = [inertia.mass * (radius * size.foot) ** 2 for radius in (longitudinal, transverse, sagittal)]
    calcaneus.explicitinertial = True


def _capsule(body: mujoco.MjsBody, start: tuple[float, ...], end: tuple[float, ...], radius: float) -> None:
    """A visual shape without mass and contacts."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*start, *end],
        size=[radius, 0, 0],
        contype=0,
        conaffinity=0,
        mass=0,
        rgba=RGBA,
    )
