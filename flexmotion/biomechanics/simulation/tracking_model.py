"""`TrackingModel`: the human for forward simulation, with feet that touch a plane, joint torques and root assistance.

It is the model of `human.human_model` with these differences:

- Joints of three coordinates are ball joints, which have no gimbal lock; the degrees of freedom keep their number.
- Each foot touches the floor by four spheres at the corners of its sole, whose radius lets the foot roll over heel and
  toes.
- Every degree of freedom has an actuator: ideal torques at the joints, bounded by strength, and the assistance at the
  root, bounded by a share of body weight.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.smoothing import BALL_JOINTS
from flexmotion.biomechanics.sole import BREADTH
from flexmotion.biomechanics.strength import STRENGTH
from flexmotion.human.angles import three_angle_rotation, three_angles
from flexmotion.human.body import Body
from flexmotion.human.human_model import human_spec
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import DOF_COUNT, JOINTS, SIDES
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

BALL_SEGMENTS = {
    ("lumbar_extension", ""): "torso",
    ("neck_extension", ""): "head",
    **{("hip_flexion", side): f"femur_{side}" for side in SIDES},
    **{("shoulder_flexion", side): f"humerus_{side}" for side in SIDES},
}
"""First coordinate and side of a ball joint -> the segment that it moves."""

CORNERS = 4
"""Contact points of a foot: heel left and right, toes left and right."""


@dataclass(frozen=True)
class ContactSettings:
    """Contact of foot and floor in MuJoCo's terms.

    Attributes:
        time_constant: of the contact's spring and damper [s]; a foot sinks in by 1 to 2 mm in standing, 5 to 15 mm at a
            foot strike, as heel pad and shoe are compressed. At .02 s two runs were tracked in .6 of the windows
            instead of 1, with peaks of 10 body weights instead of 4; walking and standing were alike.
        damping: ratio, 1 is critical.
        friction: of shoe on floor, the same as `ground_reaction` assumes.
        radius: of the corners of the sole [m].
    """

    time_constant: float = 0.035
    damping: float = 1.0
    friction: float = 0.8
    radius: float = 0.02


@dataclass(frozen=True)
class TrackingSettings:
    """Settings of the simulated human that do not depend on the perturbation.

    Attributes:
        rate: of simulation and feedback [Hz], a multiple of the frame rate.
        contact: of foot and floor.
        assistance: greatest force on the root, and greatest moment per metre of leg [body weights].
    """

    rate: float = 300.0
    contact: ContactSettings = field(default_factory=ContactSettings)
    assistance: float = 0.05


TRACKING = TrackingSettings()


@dataclass(frozen=True, eq=False)
class TrackingModel:
    """Compiled models and the indices of the human's coordinates in them.

    Attributes:
        body: the human.
        model: for simulation; its geometry `floor` is a plane.
        linear: for linearisation: `CORNERS` points of each foot may be tied to points of the world (equality
            constraints, left foot first), and the floor does not act.
        limits: greatest magnitude of every actuator, root's six first, (32,) [N, N·m].
        corners: lowest points of the corners in the frame of the calcaneus, the same for both feet, (4, 3) [m].
    """

    body: Body
    model: mujoco.MjModel
    linear: mujoco.MjModel
    limits: Float
    corners: Float

    @property
    def feet(self) -> list[int]:
        """Body index of left and right calcaneus."""
        return [self.model.body(f"calcaneus_{side}").id for side in SIDES]

    @property
    def pelvis(self) -> int:
        """Body index of the pelvis."""
        return int(self.model.body("pelvis").id)

    def on_slope(self, slope: Float, origin: Float) -> TrackingModel:
        """The same human on a plane through `origin` (3,) that rises by `slope` (2,) metres per metre along x and y."""
        model = copy.copy(self.model)
        floor = model.geom("floor")
        floor.pos[:] = origin
        normal = np.array([-slope[0], -slope[1], 1.0])
        mujoco.mju_quatZ2Vec(floor.quat, normal / np.linalg.norm(normal))
        return replace(self, model=model)

    def carrying(self, masses: Mapping[str, float]) -> TrackingModel:
        """The same human with point masses [kg] at the centres of mass of segments."""
        models = []
        for model in (copy.copy(self.model), copy.copy(self.linear)):
            for name, mass in masses.items():
                model.body(name).mass[:] += mass
            mujoco.mj_setConst(model, mujoco.MjData(model))
            models.append(model)
        return replace(self, model=models[0], linear=models[1])

    def qpos(self, motion: Motion) -> Float:
        """Generalised positions of every frame, with unit quaternions of ball joints, (T, nq)."""
        qpos = np.empty((len(motion), self.model.nq))
        qpos[:, :3], qpos[:, 3:7] = motion.root_position, motion.root_quaternion
        for names, side in BALL_JOINTS:
            at = self.model.joint(BALL_SEGMENTS[names[0], side]).qposadr[0]
            angles = motion.joints[:, _columns(names, side)]
            qpos[:, at : at + 4] = three_angle_rotation(angles, names, side).as_quat(scalar_first=True)
        for name in HINGES:
            qpos[:, self.model.joint(name).qposadr[0]] = motion.joints[:, JOINTS.index(name)]
        return qpos

    def quaternions(self) -> list[int]:
        """Index into `qpos` of the first component of every quaternion."""
        return [3, *(int(self.model.joint(name).qposadr[0]) for name in BALL_SEGMENTS.values())]

    def motion(self, qpos: Float, like: Motion) -> Motion:
        """Motion of generalised positions (T, nq), at the frame rate of `like` and with its body."""
        joints = np.empty((len(qpos), len(JOINTS)))
        for names, side in BALL_JOINTS:
            at = self.model.joint(BALL_SEGMENTS[names[0], side]).qposadr[0]
            rotation = Rotation.from_quat(qpos[:, at : at + 4], scalar_first=True).as_matrix()
            joints[:, _columns(names, side)] = three_angles(rotation, names, side)
        for name in HINGES:
            joints[:, JOINTS.index(name)] = qpos[:, self.model.joint(name).qposadr[0]]
        return Motion(
            fps=like.fps,
            root_position=qpos[:, :3].copy(),
            root_quaternion=qpos[:, 3:7].copy(),
            joints=joints,
            body=like.body,
            source=like.source,
            mass_given=like.mass_given,
        )


HINGES = tuple(
    name
    for name in JOINTS
    if not any(name == (f"{part}_{side}" if side else part) for names, side in BALL_JOINTS for part in names)
)
"""Joints of one coordinate."""


def _columns(names: tuple[str, ...], side: str) -> list[int]:
    return [JOINTS.index(f"{name}_{side}" if side else name) for name in names]


def sole_corners(body: Body, settings: ContactSettings) -> Float:
    """Lowest points of the corners in the frame of the calcaneus, (4, 3) [m]."""
    size = body.segments
    along = (settings.radius - size.heel, size.foot - size.heel - settings.radius)
    half = BREADTH * body.height / 2 - settings.radius
    return np.array([[x, y, -size.ankle_height] for x in along for y in (half, -half)])


@lru_cache(maxsize=8)
def tracking_model(body: Body, settings: TrackingSettings = TRACKING) -> TrackingModel:
    """The models of a human."""
    corners = sole_corners(body, settings.contact)
    limits = actuator_limits(body, settings)
    return TrackingModel(
        body=body,
        model=_spec(body, settings, corners, limits, tied=False).compile(),
        linear=_spec(body, settings, corners, limits, tied=True).compile(),
        limits=limits,
        corners=corners,
    )


def actuator_limits(body: Body, settings: TrackingSettings) -> Float:
    """Greatest magnitude of every actuator, in the order of the model's degrees of freedom, (32,) [N, N·m]."""
    force = settings.assistance * body.mass * GRAVITY
    limits = [*3 * [force / np.sqrt(3)], *3 * [force * body.segments.leg / np.sqrt(3)]]
    spec = _ball_spec(body)
    model = spec.compile()
    for dof in range(6, model.nv):
        name = model.joint(model.dof_jntid[dof]).name
        part = next((names[0] for (names, side) in BALL_JOINTS if BALL_SEGMENTS[names[0], side] == name), name)
        limits.append(STRENGTH[part.partition("_")[0]] * body.mass)
    assert len(limits) == DOF_COUNT
    return np.array(limits)


def _ball_spec(body: Body) -> mujoco.MjSpec:
    spec = human_spec(body)
    for names, side in BALL_JOINTS:
        segment = spec.body(BALL_SEGMENTS[names[0], side])
        for name in names:
            spec.delete(spec.joint(f"{name}_{side}" if side else name))
        segment.add_joint(name=segment.name, type=mujoco.mjtJoint.mjJNT_BALL)
    return spec


def _spec(body: Body, settings: TrackingSettings, corners: Float, limits: Float, *, tied: bool) -> mujoco.MjSpec:
    spec = _ball_spec(body)
    spec.option.timestep = 1 / settings.rate
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    contact = settings.contact
    solref = [contact.time_constant, contact.damping]
    if not tied:
        spec.worldbody.add_geom(
            name="floor",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 1],
            condim=3,
            friction=[contact.friction, 0, 0],
            solref=solref,
            priority=1,
        )
    for side in SIDES:
        foot = spec.body(f"calcaneus_{side}")
        for number, corner in enumerate(corners):
            if tied:
                spec.add_equality(
                    name=f"corner_{side}_{number}",
                    type=mujoco.mjtEq.mjEQ_CONNECT,
                    objtype=mujoco.mjtObj.mjOBJ_BODY,
                    name1=foot.name,
                    name2="world",
                    data=[*corner, *9 * [0.0]],
                    solref=solref,
                    active=False,
                )
            else:
                foot.add_geom(
                    name=f"corner_{side}_{number}",
                    type=mujoco.mjtGeom.mjGEOM_SPHERE,
                    size=[contact.radius, 0, 0],
                    pos=corner + [0.0, 0.0, contact.radius],
                    contype=0,
                    conaffinity=1,
                    mass=0,
                )
    dof = 0
    for joint in _joints(spec):
        size = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}.get(joint.type, 1)
        for axis in range(size):
            gear = np.zeros(6)
            gear[axis] = 1.0
            spec.add_actuator(
                name=f"{joint.name}_{axis}",
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                target=joint.name,
                gear=gear,
                ctrllimited=True,
                ctrlrange=[-limits[dof], limits[dof]],
            )
            dof += 1
    return spec


def _joints(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    """Joints in the order of the compiled model's degrees of freedom: depth first."""
    found: list[mujoco.MjsJoint] = []

    def visit(body: mujoco.MjsBody) -> None:
        found.extend(body.joints)
        for child in body.bodies:
            visit(child)

    visit(spec.worldbody)
    return found
