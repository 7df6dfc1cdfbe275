"""Muscle geometry and strength of legs and trunk, from the models of `myo-sim` (extra `biomech`).

MyoLegs (80 muscles) and MyoTorso (210) are from MIT-licensed sources. Of the legs only muscle paths are used, corrected
to those of the published model (A. Rajagopal et al., IEEE Trans. Biomed. Eng. 63(10), 2016: "2016 model" below);
strengths and force curves are those of `hill_muscle`. Of the trunk paths and force curves are used. No dynamics are.

Coordinates of the models are proportional to those of `JOINTS`: a lumbar angle is the sum of five vertebral angles.
Dependent coordinates (kneecap, vertebrae) follow the equality constraints of the models, and moment arms are projected
through the slopes of these. Coordinates that `JOINTS` lacks (subtalar, toes) are zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.hill_muscle import HillMuscles, leg_muscles
from flexmotion.configs.errors import ConfigError
from flexmotion.human.skeleton import JOINTS

Float = NDArray[np.float64]

LEG_COORDINATES = {
    "hip_flexion": "hip_flexion",
    "hip_adduction": "hip_adduction",
    "hip_rotation": "hip_rotation",
    "knee_flexion": "knee_angle",
    "ankle_dorsiflexion": "ankle_angle",
}
TRUNK_COORDINATES = {
    "lumbar_extension": "flex_extension",
    "lumbar_bending": "lat_bending",
    "lumbar_rotation": "axial_rotation",
}
"""Joint -> coordinate of the models of the same sign."""

VERTEBRAE = {"flex_extension": "_FE", "lat_bending": "_LB", "axial_rotation": "_AR"}
"""Coordinates of the vertebrae; their sum is a lumbar angle."""

CROSSED = {"hip": "femur", "knee": "tibia", "ankle": "talus"}
"""Joints whose contact force is computed, and the segment below."""

UP = 1
"""Of the three slides of a crossing in a leg: that along the segment, towards its proximal joint."""

MODEL_MASS, MODEL_HEIGHT = 75.0, 1.70
"""Mass and height of the adult of the models [kg, m] (Rajagopal et al., IEEE Trans. Biomed. Eng. 63(10), 2016)."""

KNEE_AXIS = np.array([-0.00808954, -0.0035348, 0.00148474])
"""Place of the left knee's axis in the tibia [m]; the right one's is its mirror image (Rajagopal et al., 2016).

MyoLegs 0.2 has it at the tibia's origin, 8 mm farther forward: moment arms of the hamstrings are 8 mm too long.
"""


@dataclass(frozen=True)
class Wrapping:
    """A cylinder of the right leg around which a muscle's path bends.

    Attributes:
        segment: that it is fixed to.
        centre: in the segment [m].
        turn: of its axis z, intrinsic rotations about x, y, z [rad].
        radius: [m].
        side: direction in the cylinder's frame in which the path passes it.
        after: number of the path's point before it, from 1.
        points: number of the path's points.
    """

    segment: str
    centre: tuple[float, float, float]
    turn: tuple[float, float, float]
    radius: float
    side: tuple[float, float, float]
    after: int
    points: int


WRAPPINGS = {
    "psoas": Wrapping("pelvis", (-0.074, -0.06, 0.0656), (-0.25, -0.27, 0.1), 0.05, (1.0, 0.0, 0.0), 2, 4),
    "glmax1": Wrapping("pelvis", (-0.077, -0.099, 0.061), (-0.6, 0.45, 0.0), 0.04, (-0.7, -0.72, 0.0), 2, 4),
    "glmax2": Wrapping("pelvis", (-0.08, -0.083, 0.068), (-0.75, 0.39, 0.0), 0.04, (-0.36, -0.93, 0.0), 2, 4),
    "iliacus": Wrapping("pelvis", (-0.071, -0.065, 0.0756), (-0.32, -0.24, 0.9), 0.0549, (0.87, -0.48, 0.0), 2, 4),
    "gasmed": Wrapping(
        "tibia",
        (0.0707, -0.0915, -0.0033),
        (-3.0675, -0.1184, -1.4855),
        0.1291,
        (0.49, -0.88, 0.0),
        1,
        2,
    ),
}
"""Wrapping surfaces of the 2016 model that MyoLegs 0.2 lacks, or has as a sphere (iliacus).

Without them the moment arm of psoas at 20 degrees of hip extension is 12 mm instead of 26, and that of the medial
gastrocnemius at the straight knee 10 mm instead of 18. The latter has two surfaces in the 2016 model, which MuJoCo
cannot take in a row: its one is fitted to moment arms of that model (RMS .4 mm in walking; lengths 1.4 mm).
"""

RISE, FALL = 0.010, 0.040
"""Time constants of activation of the leg muscles (2016 model) [s]."""


@dataclass(frozen=True, eq=False)
class MuscleModel:
    """A compiled muscle model and the indices of joints in it.

    Attributes:
        model: with three slides added at every joint whose contact force is computed.
        joints: the J joints that its muscles move.
        masters: the model's coordinates for them, (J,).
        share: such a coordinate as a share of the joint angle, (J,).
        slides: three perpendicular slides at each crossing, (C, 3).
        crossings: names of the C joints whose contact force is computed.
        hill: strengths and force curves of its muscles; None: MuJoCo's muscles have them.
    """

    model: mujoco.MjModel
    joints: tuple[str, ...]
    masters: NDArray[np.intp]
    share: Float
    slides: NDArray[np.intp]
    crossings: tuple[str, ...]
    hill: HillMuscles | None = None

    @property
    def time_constants(self) -> tuple[float, float]:
        """Time constants of rising and falling activation [s]."""
        if self.hill is not None:
            return RISE, FALL
        rise, fall = self.model.actuator_dynprm[0, :2]
        return float(rise), float(fall)

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names of the muscles."""
        return tuple(self.model.actuator(i).name for i in range(self.model.nu))

    @cached_property
    def columns(self) -> NDArray[np.intp]:
        """Indices of its joints in `JOINTS`, (J,)."""
        return np.array([JOINTS.index(name) for name in self.joints], dtype=np.intp)

    @cached_property
    def followers(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Float]:
        """Dependent coordinates: index, position of their master in `masters`, and polynomial coefficients."""
        model, rows = self.model, []
        for constraint in range(model.neq):
            if model.eq_type[constraint] != mujoco.mjtEq.mjEQ_JOINT:
                continue
            follower, master = model.eq_obj1id[constraint], model.eq_obj2id[constraint]
            found = np.flatnonzero(self.masters == master)
            if len(found):
                rows.append((follower, found[0], model.eq_data[constraint, :5]))
        index, place, coefficients = zip(*rows, strict=True)
        return np.array(index, np.intp), np.array(place, np.intp), np.array(coefficients)

    def lengths_and_slopes(self, angles: Float) -> tuple[Float, Float]:
        """Lengths of the muscles, (M,) [m], and their derivatives by the joint angles (J,), (M, J) [m].

        A moment arm is such a derivative with the opposite sign.
        """
        model, data = self.model, mujoco.MjData(self.model)
        data.qpos[:], slopes = self.pose(angles)
        mujoco.mj_fwdPosition(model, data)
        dense = np.zeros((model.nu, model.nv))
        mujoco.mju_sparse2dense(
            dense, data.actuator_moment.ravel(), data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        return data.actuator_length.copy(), dense @ slopes

    def pose(self, angles: Float) -> tuple[Float, Float]:
        """Model coordinates (nq,) at joint angles (J,), and their derivatives (nq, J).

        Angles are clipped to the range of the model, in which its muscle paths are valid.
        """
        limits = self.model.jnt_range[self.masters]
        values = np.clip(angles * self.share, limits[:, 0], limits[:, 1])
        qpos = np.zeros(self.model.nq)
        slopes = np.zeros((self.model.nq, len(self.joints)))
        qpos[self.masters] = values
        slopes[self.masters, np.arange(len(self.joints))] = self.share
        index, place, coefficients = self.followers
        powers = values[place, None] ** np.arange(5)
        qpos[index] = np.sum(coefficients * powers, axis=1)
        slopes[index, place] = self.share[place] * np.sum(
            coefficients[:, 1:] * np.arange(1, 5) * powers[:, :-1], axis=1
        )
        return qpos, slopes


@lru_cache(maxsize=1)
def muscle_models() -> tuple[MuscleModel, ...]:
    """Left leg, right leg and trunk.

    Raises:
        ConfigError: `myo-sim` is not installed, or is not the one that the corrections are for.
    """
    legs, trunk = _specs()
    return _leg(legs.copy(), "l"), _leg(legs.copy(), "r"), _trunk(trunk)


def muscle_names() -> tuple[str, ...]:
    """Names of all 290 muscles in the order of `Motion.activations`."""
    return tuple(name for model in muscle_models() for name in model.muscles)


def _specs() -> tuple[mujoco.MjSpec, mujoco.MjSpec]:
    try:
        from myo_sim.build.compose import build_legs_spec, build_spec
    except ImportError as error:
        raise ConfigError("muscles need the extra 'biomech': in a clone, pip install '.[biomech]'") from error
    return build_legs_spec(), build_spec("myotorso")


def _leg(spec: mujoco.MjSpec, side: str) -> MuscleModel:
    other = "r" if side == "l" else "l"
    for actuator in list(spec.actuators):
        if actuator.name.endswith(f"_{other}"):
            spec.delete(actuator)
    for tendon in list(spec.tendons):
        if tendon.name.endswith(f"_{other}_tendon") or tendon.name.endswith(f"_{other}"):
            spec.delete(tendon)
    for joint in spec.body(f"tibia_{side}").joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            if np.any(joint.pos):
                place = ", ".join(f"{1e3 * value:.1f}" for value in joint.pos)
                raise ConfigError(
                    f"myo-sim: {joint.name} is at ({place}) mm in the tibia, expected (0, 0, 0) as in 0.2: the "
                    "corrections are for that version; pip install 'myo-sim<0.3'"
                )
            joint.pos = KNEE_AXIS * (1.0, 1.0, 1.0 if side == "l" else -1.0)
    for name, wrapping in WRAPPINGS.items():
        _wrap(spec, name, wrapping, side)
    for actuator in spec.actuators:
        # Its control is the tension [N].
        actuator.set_to_motor()
        actuator.gainprm[0] = -1.0
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
    crossed = {f"{joint}_{side}": f"{segment}_{side}" for joint, segment in CROSSED.items()}
    joints = {f"{ours}_{side}": f"{theirs}_{side}" for ours, theirs in LEG_COORDINATES.items()}
    names = tuple(actuator.name.removesuffix(f"_{side}") for actuator in spec.actuators)
    return _compiled(spec, joints, crossed, leg_muscles(names))


def _wrap(spec: mujoco.MjSpec, name: str, wrapping: Wrapping, side: str) -> None:
    """Replace a muscle's path by one that bends around a cylinder."""
    mirror = np.array([1.0, 1.0, 1.0 if side == "r" else -1.0])
    # A mirror image in z turns the other way about x and y.
    turn = Rotation.from_euler("XYZ", np.array(wrapping.turn) * (mirror[2], mirror[2], 1.0))
    centre = np.array(wrapping.centre) * mirror
    segment = spec.body(wrapping.segment if wrapping.segment == "pelvis" else f"{wrapping.segment}_{side}")
    surface, guide = f"{name}_surface_{side}", f"{name}_guide_{side}"
    segment.add_geom(
        name=surface,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[wrapping.radius, 0.05, 0.0],
        pos=centre,
        quat=turn.as_quat(scalar_first=True),
        mass=0.0,
    )
    segment.add_site(name=guide, pos=centre + turn.apply(1.5 * wrapping.radius * np.array(wrapping.side) * mirror))
    tendon = spec.tendon(f"{name}_{side}_tendon")
    spec.delete(tendon)
    tendon = spec.add_tendon(name=f"{name}_{side}_tendon")
    for point in range(1, wrapping.points + 1):
        tendon.wrap_site(f"{name}-P{point}_{side}")
        if point == wrapping.after:
            tendon.wrap_geom(surface, guide)


def _trunk(spec: mujoco.MjSpec) -> MuscleModel:
    return _compiled(spec, TRUNK_COORDINATES, {"lumbar": "lumbar5"})


def _compiled(
    spec: mujoco.MjSpec, joints: dict[str, str], crossed: dict[str, str], hill: HillMuscles | None = None
) -> MuscleModel:
    slides = {joint: _slides(spec.body(segment), joint) for joint, segment in crossed.items()}
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model = spec.compile()
    masters = np.array([model.joint(name).id for name in joints.values()], dtype=np.intp)
    return MuscleModel(
        model=model,
        joints=tuple(joints),
        masters=masters,
        share=np.array([_share(model, name) for name in joints.values()]),
        slides=np.array([[model.joint(name).id for name in names] for names in slides.values()], np.intp),
        crossings=tuple(crossed),
        hill=hill,
    )


def _slides(segment: mujoco.MjsBody, joint: str) -> list[str]:
    """Three slides of a segment: existing ones (a knee glides), and new ones perpendicular to them."""
    slide = mujoco.mjtJoint.mjJNT_SLIDE
    present = [item for item in segment.joints if item.type == slide]
    axes = [np.array(item.axis) / np.linalg.norm(item.axis) for item in present]
    wanted = list(np.eye(3)) if not axes else [np.cross(axes[0], axes[1])]
    names = [item.name for item in present]
    for number, axis in enumerate(wanted):
        names.append(f"gap_{joint}_{number}")
        segment.add_joint(name=names[-1], type=slide, axis=axis, range=[-1, 1])
    return names


def _share(model: mujoco.MjModel, coordinate: str) -> float:
    """A coordinate as a share of the joint angle, to which its dependent coordinates add."""
    suffix = VERTEBRAE.get(coordinate)
    if suffix is None:
        return 1.0
    master = model.joint(coordinate).id
    total = 1.0
    for constraint in range(model.neq):
        follower = model.joint(model.eq_obj1id[constraint]).name
        if model.eq_obj2id[constraint] == master and follower.endswith(suffix):
            total += model.eq_data[constraint, 1]
    return 1.0 / total
