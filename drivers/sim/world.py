"""The simulated world: the robot's model with the mismatch of the options, on a floor that may slope."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.drivers.sim.imu import SENSORS
from flexmotion.drivers.sim.options import Plate, SimOptions

FLOOR = "floor"
HOLDER = "holder"
PLATE_HALF_THICKNESS = 0.01
"""Of a plate in the way [m]."""
PLATE_SOLREF = (0.02, 1)
"""Time constant [s] and damping ratio of its contacts, MuJoCo's own: softer than the floor."""


def build_model(robot: Robot, options: SimOptions) -> mujoco.MjModel:
    """The robot with a floor, an IMU's sensors, and a mocap body `holder` that the torso can be welded to.

    Raises `ConfigError` if `total_mass` leaves no mass for the torso.
    """

    def edit(spec: mujoco.MjSpec) -> None:
        spec.option.timestep = options.timestep
        _add_floor(spec, floor_quaternion(options))
        _add_holder(spec, robot.config.torso)
        for number, plate in enumerate(options.plates):
            _add_plate(spec, number, plate)
        if robot.config.imu is not None:
            _add_imu(spec, robot)

    model = robot.compile(edit)
    if options.friction is not None:
        model.geom_friction[:, 0] = options.friction  # MuJoCo uses the larger of a pair: set both
    model.dof_frictionloss *= options.joint_friction_scale
    _scale_masses(model, robot, options)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def plate_name(number: int) -> str:
    """Name of the geom of a plate, by its place among the options' `plates`."""
    return f"plate_{number}"


def floor_quaternion(options: SimOptions) -> NDArray[np.float64]:
    """Orientation of the floor, w x y z."""
    return Rotation.from_euler("yx", options.slope_deg, degrees=True).as_quat(scalar_first=True)


def start_qpos(robot: Robot, model: mujoco.MjModel, pose: NDArray[np.float64], options: SimOptions) -> np.ndarray:
    """A qpos with the joints at `pose` (n,), the left sole flat on the floor, both soles around the origin."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    data.qpos[3] = 1.0
    data.qpos[robot.qpos_address] = pose
    mujoco.mj_kinematics(model, data)
    feet = list(robot.foot_ids)
    rotations = data.xmat[feet].reshape(2, 3, 3)
    soles = data.xpos[feet] + np.einsum("fij,fj->fi", rotations, robot.soles)
    floor = Rotation.from_quat(floor_quaternion(options), scalar_first=True)
    upright = Rotation.from_matrix(rotations[0].T)  # torso in the frame of the left foot
    soles = upright.apply(soles)
    torso = -np.array([*soles[:, :2].mean(axis=0), soles[:, 2].min()])
    if options.suspended:
        torso[2] *= 1.5
    data.qpos[:3] = floor.apply(torso)
    data.qpos[3:7] = (floor * upright).as_quat(scalar_first=True)
    return data.qpos.copy()


def _add_floor(spec: mujoco.MjSpec, quaternion: NDArray[np.float64]) -> None:
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.86, 0.88, 0.90],
        rgb2=[0.78, 0.80, 0.83],
        width=256,
        height=256,
    )
    material = spec.add_material(name=FLOOR, texrepeat=[5, 5], texuniform=True, reflectance=0.05)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.1],
        quat=quaternion,
        material=FLOOR,
        friction=[0.8, 0.005, 0.0001],
        solref=[0.004, 1],
        condim=3,
    )
    spec.worldbody.add_light(pos=[1, -1, 3], dir=[-0.3, 0.3, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)


def _add_holder(spec: mujoco.MjSpec, torso: str) -> None:
    spec.worldbody.add_body(name=HOLDER, mocap=True)
    weld = spec.add_equality(
        name=HOLDER,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=HOLDER,
        name2=torso,
        active=False,
    )
    anchor, position, quaternion, torque_scale = [0, 0, 0], [0, 0, 0], [1, 0, 0, 0], 1
    weld.data[:11] = [*anchor, *position, *quaternion, torque_scale]


def _add_plate(spec: mujoco.MjSpec, number: int, plate: Plate) -> None:
    out = np.array(plate.normal) / np.linalg.norm(plate.normal)
    quaternion = np.zeros(4)
    mujoco.mju_quatZ2Vec(quaternion, out)
    spec.worldbody.add_geom(
        name=plate_name(number),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[plate.half_size, plate.half_size, PLATE_HALF_THICKNESS],
        pos=np.array(plate.position) - PLATE_HALF_THICKNESS * out,
        quat=quaternion,
        solref=PLATE_SOLREF,
        rgba=[0.8, 0.5, 0.4, 1.0],
    )


def _add_imu(spec: mujoco.MjSpec, robot: Robot) -> None:
    imu = robot.config.imu
    assert imu is not None
    name = "flexmotion_imu"
    spec.body(imu.body).add_site(name=name, pos=imu.position, quat=imu.quaternion)
    kinds = (mujoco.mjtSensor.mjSENS_GYRO, mujoco.mjtSensor.mjSENS_ACCELEROMETER)
    for sensor, kind in zip(SENSORS, kinds, strict=True):
        spec.add_sensor(name=sensor, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name)


def _scale_masses(model: mujoco.MjModel, robot: Robot, options: SimOptions) -> None:
    torso = robot.torso_id
    scale = np.full(model.nbody, options.mass_scale)
    scale[torso] *= options.torso_mass_scale
    if options.total_mass is not None:
        others = float((model.body_mass * scale).sum() - model.body_mass[torso] * scale[torso])
        scale[torso] = (options.total_mass - others) / model.body_mass[torso]
        if not scale[torso] > 0:
            raise ConfigError(
                f"option total_mass {options.total_mass} kg: the links without the torso weigh {others:.3f} kg, "
                f"expected more than that"
            )
    model.body_mass *= scale
    model.body_inertia *= scale[:, None]
    if not math.isfinite(float(model.body_mass.sum())):
        raise ConfigError("options mass_scale, torso_mass_scale: the robot's mass is not finite")
