"""`Robot`: a robot file and its MJCF, checked against each other and against the servo catalogue."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.calibration import calibrated, calibrated_imu, check_zero
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.get_up import read_get_up
from flexmotion.configs.identification import apply_to_joints, complete_joints, identified
from flexmotion.configs.push_correction import read_push_correction
from flexmotion.configs.repertoire import read_repertoire
from flexmotion.configs.robot_checks import check_numbers
from flexmotion.configs.robot_file import ROBOT_FILE_VERSIONS, Gait, JointConfig, Mapping, RobotFile
from flexmotion.configs.schema import parse, read_yaml
from flexmotion.configs.servo import Servo, find_servo

Float = NDArray[np.float64]

ROBOTS = Path(__file__).parent / "robots"


def list_robots() -> tuple[str, ...]:
    """Names of the shipped robots."""
    return tuple(sorted(folder.name for folder in ROBOTS.iterdir() if (folder / f"{folder.name}.yaml").is_file()))


def is_shipped(robot: Robot) -> bool:
    """Whether a robot's folder is one of this package, for all robots of its kind."""
    return robot.folder.resolve().is_relative_to(ROBOTS.resolve())


def load_robot(name_or_folder: str | Path) -> Robot:
    """Load a shipped robot by name, or any robot by folder.

    A folder contains `robot.yaml` or `FOLDERNAME.yaml` and the MJCF that it names. Raises `ConfigError`.
    """
    given: Any = name_or_folder  # a program without a type checker may give anything
    if not isinstance(given, str | Path):
        raise ConfigError(f"robot: {given!r}, expected the name of a robot ({', '.join(list_robots())}) or its folder")
    shipped = ROBOTS / str(name_or_folder)
    if isinstance(name_or_folder, str) and name_or_folder in list_robots():
        return Robot(shipped / f"{name_or_folder}.yaml")
    folder = Path(name_or_folder).expanduser()
    if not folder.is_dir():
        raise ConfigError(
            f"unknown robot {str(name_or_folder)!r}: neither a folder nor one of: {', '.join(list_robots())}"
        )
    candidates = (folder / f"{folder.resolve().name}.yaml", folder / "robot.yaml")
    for file in candidates:
        if file.is_file():
            return Robot(file)
    others = ", ".join(sorted(file.name for file in folder.glob("*.yaml")))
    raise ConfigError(
        f"{folder}: no robot file, expected {candidates[0].name} or {candidates[1].name}"
        + (f", found {others}" if others else "")
    )


class Robot:
    """A robot, read-only. Arrays over joints are (n,), in the order of the robot file.

    Attributes:
        file, folder: the YAML file and its folder.
        config: the file's content, with the calibrated mounting of the IMU.
        name, rate_hz, gait, mapping, safety: parts of it.
        joints, joint_names, servos: joint configurations (calibrated), names and servos (identified, where they were);
            n: number of joints.
        catalogue_servos: the servos as the catalogue has them.
        lower, upper: limits [rad].
        kp: stiffness of the position loop at nominal voltage and the joint's gain [N·m/rad].
        back_emf: torque lost per speed [N·m·s/rad].
        stall_torque, usable_torque: at nominal voltage [N·m].
        no_load_speed: [rad/s].
        servo_delay: from the arrival of a goal to a servo acting on it [s], one number for all: the mean of those
            identified, or else of the catalogue's.
        nominal_voltage: [V].
        tick_rad: position unit [rad].
        direction, zero: servo angle = direction * joint angle + zero [rad].
        stand_pose, rest_pose: [rad].
        get_up: from which sides it gets up on request, and how (`flexmotion.configs.get_up`).
        push_correction: how its joints answer a push; None: not known (`flexmotion.configs.push_correction`).
        repertoire: kinds of motion that it was judged to do; None: it was not judged (`flexmotion.configs.repertoire`).
        model: the compiled MJCF, without floor; read-only (`compile` makes an editable one).
        qpos_address, dof_address: index of each joint in MuJoCo's qpos and qvel.
        torso_id: id of the torso's body.
        foot_ids: ids of the left and right foot's body.
        soles: centre of the left and right sole in the foot's body frame, (2, 3) [m].
        sole_half_size: usable half extents of the soles, (2, 2) [m].
    """

    def __init__(self, file: Path) -> None:
        """Load and check `file`. Raises `ConfigError`, which names file, field and valid values."""
        self.file, self.folder = file, file.parent
        content = read_yaml(file)
        # Before the fields: a file of another version may have others.
        ROBOT_FILE_VERSIONS.check(content.get("version", 1), file)
        written = parse(RobotFile, content, file)
        self.config = written.model_copy(update={"imu": calibrated_imu(written.imu, self.folder)})
        self.name, self.rate_hz = self.config.name, self.config.rate_hz
        self.gait: Gait = self.config.gait
        self.mapping: Mapping = self.config.mapping
        self.safety = self.config.safety
        self.joints: tuple[JointConfig, ...] = calibrated(self.config.joints, self.folder)
        self.joint_names = tuple(joint.name for joint in self.joints)
        self.n = len(self.joints)
        self._check_addresses()
        self.catalogue_servos: tuple[Servo, ...] = tuple(self._servo(joint) for joint in self.joints)
        self.servos: tuple[Servo, ...] = identified(self.joints, self.catalogue_servos, self.folder)

        self.lower = _array(joint.limits[0] for joint in self.joints)
        self.upper = _array(joint.limits[1] for joint in self.joints)
        self.direction = _array(joint.direction for joint in self.joints)
        self.zero = _array(joint.zero for joint in self.joints)
        self.kp = _array(
            servo.kp * (joint.p_gain or servo.gain_register) / servo.gain_register
            for joint, servo in zip(self.joints, self.servos, strict=True)
        )
        self.back_emf = _array(servo.back_emf for servo in self.servos)
        self.stall_torque = _array(servo.stall_torque for servo in self.servos)
        self.usable_torque = _array(servo.usable_torque for servo in self.servos)
        self.no_load_speed = _array(servo.no_load_speed for servo in self.servos)
        self.servo_delay = _mean_delay(self.servos, self.catalogue_servos)
        self.nominal_voltage = _array(servo.nominal_voltage for servo in self.servos)
        self.tick_rad = _array(servo.tick_rad for servo in self.servos)
        self._rad_per_tick = _frozen(self.tick_rad * self.direction)
        self._ticks_per_rad = _frozen(self.direction / self.tick_rad)
        self._zero_tick = _frozen(_array(servo.centre_tick for servo in self.servos) + self.zero / self.tick_rad)
        self._min_tick = _array(servo.min_tick for servo in self.servos)
        self._max_tick = _array(servo.max_tick for servo in self.servos)
        self._check_servo_ranges()
        self.stand_pose = self.pose(f"{file}: field stand_pose", self.config.stand_pose)
        self.rest_pose = self.pose(f"{file}: field rest_pose", self.config.rest_pose)

        self.model = self.compile()
        self._check_joints()
        self._check_mapping()
        self.qpos_address = _frozen(np.array([self.model.joint(j).qposadr[0] for j in self.joint_names]))
        self.dof_address = _frozen(np.array([self.model.joint(j).dofadr[0] for j in self.joint_names]))
        feet = (self.config.feet.left, self.config.feet.right)
        self.torso_id = self._body("torso", self.config.torso)
        self._check_free_torso()
        self.foot_ids = (self._body("feet.left.body", feet[0].body), self._body("feet.right.body", feet[1].body))
        self.soles = _frozen(np.array([foot.sole for foot in feet]))
        self.sole_half_size = _frozen(np.array([foot.half_size for foot in feet]))
        if self.config.imu is not None:
            self._body("imu.body", self.config.imu.body)
        if self.config.hands is not None:
            self._body("hands.left.body", self.config.hands.left.body)
            self._body("hands.right.body", self.config.hands.right.body)
        if self.config.head is not None:
            self._body("head.body", self.config.head.body)
        check_numbers(self)
        self.get_up = read_get_up(self)
        self.push_correction = read_push_correction(self)
        self.repertoire = read_repertoire(self)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.n} joints, {self.file})"

    @property
    def place(self) -> str:
        """What commands call it: the name of a shipped robot, or the folder of another."""
        return self.name if is_shipped(self) else str(self.folder)

    @cached_property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return float(self.model.body_mass.sum())

    def index(self, joint: str) -> int:
        """Index of a joint in every (n,) array. Raises `ConfigError` with the closest names."""
        if joint not in self.joint_names:
            raise ConfigError(f"{self.file}: unknown joint {joint!r}, {self._alternatives(joint, self.joint_names)}")
        return self.joint_names.index(joint)

    def servo(self, joint: str) -> Servo:
        """The servo of a joint. Raises `ConfigError` if there is no such joint."""
        return self.servos[self.index(joint)]

    def chain(self, name: str) -> dict[str, int]:
        """Part -> joint index, of a chain of the mapping (`left_leg`, …, `head`). Raises `ConfigError`."""
        chains = self.mapping.chains()
        if name not in chains:
            raise ConfigError(f"{self.file}: mapping has no {name!r}, it has: {', '.join(chains)}")
        return {part: self.index(joint) for part, joint in chains[name]}

    def spec(self) -> mujoco.MjSpec:
        """A new MjSpec of the MJCF, for edits. Raises `ConfigError` if MuJoCo cannot read it.

        Joints have the armature and frictionloss that were identified, else the MJCF's, and where it says none their
        servo's: a joint without a rotor's inertia is driven by a stiff servo faster than a simulation resolves.
        """
        file = self.folder / self.config.mjcf
        if not file.is_file():
            raise ConfigError(f"{self.file}: field mjcf: no such file: {file}")
        try:
            spec = mujoco.MjSpec.from_file(str(file))
        except ValueError as error:
            raise ConfigError(f"{file}: not a valid MJCF: {' '.join(str(error).split())}") from error
        complete_joints(spec, self.joint_names, self.servos)
        apply_to_joints(spec, self.folder)
        return spec

    def compile(self, edit: Callable[[mujoco.MjSpec], None] | None = None) -> mujoco.MjModel:
        """A new MjModel; `edit` may change the MjSpec first (a floor, another mass). Raises `ConfigError`."""
        spec = self.spec()
        if edit is not None:
            edit(spec)
        try:
            return spec.compile()
        except ValueError as error:
            raise ConfigError(f"{self.folder / self.config.mjcf}: {' '.join(str(error).split())}") from error

    def to_ticks(self, position: Float, out: Float | None = None) -> Float:
        """Joint angles [rad] -> servo position units (whole numbers, in the servos' range), (n,)."""
        out = np.multiply(position, self._ticks_per_rad, out=out)
        out += self._zero_tick
        np.rint(out, out=out)
        np.maximum(out, self._min_tick, out=out)
        return np.minimum(out, self._max_tick, out=out)

    def from_ticks(self, ticks: Float, out: Float | None = None) -> Float:
        """Servo position units -> joint angles [rad], (n,)."""
        out = np.subtract(ticks, self._zero_tick, out=out)
        out *= self._rad_per_tick
        return out

    def _alternatives(self, name: str, known: Iterable[str]) -> str:
        known = tuple(known)
        close = get_close_matches(name, known, n=3)
        return f"did you mean: {', '.join(close)}" if close else f"expected one of: {', '.join(known)}"

    def _servo(self, joint: JointConfig) -> Servo:
        try:
            return find_servo(joint.servo)
        except ConfigError as error:
            raise ConfigError(f"{self.file}: joint {joint.name!r}: {error}") from error

    def _check_addresses(self) -> None:
        names: set[str] = set()
        owners: dict[tuple[str, int], str] = {}
        for joint in self.joints:
            if joint.name in names:
                raise ConfigError(f"{self.file}: joint {joint.name!r} is listed twice")
            names.add(joint.name)
            if joint.bus not in self.config.buses:
                raise ConfigError(
                    f"{self.file}: joint {joint.name!r}: unknown bus {joint.bus!r}, "
                    f"expected one of: {', '.join(self.config.buses)}"
                )
            other = owners.setdefault((joint.bus, joint.id), joint.name)
            if other != joint.name:
                raise ConfigError(
                    f"{self.file}: joint {joint.name!r}: id {joint.id} on bus {joint.bus!r} "
                    f"already belongs to {other!r}"
                )

    def _check_servo_ranges(self) -> None:
        for joint, servo in zip(self.joints, self.servos, strict=True):
            try:
                check_zero(joint, servo, joint.zero)
            except ConfigError as error:
                raise ConfigError(f"{self.file}: {error}") from error

    def pose(self, origin: str, pose: dict[str, float]) -> Float:
        """A pose given by joint name as an array, (n,) [rad]; joints not named are at 0.

        Raises `ConfigError`, which begins with `origin`, for a joint that there is not and an angle outside its limits.
        """
        self.check_joint_names(origin, pose)
        values = np.zeros(self.n)
        for joint, value in pose.items():
            values[self.joint_names.index(joint)] = value
        outside = np.flatnonzero((values < self.lower) | (values > self.upper))
        if len(outside):
            joint_config = self.joints[outside[0]]
            raise ConfigError(
                f"{origin}.{joint_config.name}: {values[outside[0]]:g} is outside the joint's limits "
                f"{list(joint_config.limits)}"
            )
        return _frozen(values)

    def check_joint_names(self, origin: str, names: Iterable[str]) -> None:
        """Raise `ConfigError`, which begins with `origin`, for a joint that there is not."""
        for joint in names:
            if joint not in self.joint_names:
                raise ConfigError(f"{origin}: unknown joint {joint!r}, {self._alternatives(joint, self.joint_names)}")

    def _check_joints(self) -> None:
        """Check that every joint of the file is a hinge of the MJCF, and every joint of the MJCF is in the file."""
        model, mjcf = self.model, self.config.mjcf
        kinds = {model.joint(i).name: model.jnt_type[i] for i in range(model.njnt)}
        hinges = [name for name, kind in kinds.items() if kind == mujoco.mjtJoint.mjJNT_HINGE]
        for name in self.joint_names:
            if name not in hinges:
                raise ConfigError(
                    f"{self.file}: joint {name!r} is not a hinge of {mjcf}, {self._alternatives(name, hinges)}"
                )
        for name, kind in kinds.items():
            if kind == mujoco.mjtJoint.mjJNT_FREE:
                continue
            if name not in self.joint_names:
                raise ConfigError(f"{self.file}: field joints: {mjcf} has joint {name!r} that the robot file lacks")

    def _check_mapping(self) -> None:
        owners: dict[str, str] = {}
        for chain, parts in self.mapping.chains().items():
            for part, joint in parts:
                field = f"mapping.{chain}.{part}"
                if joint not in self.joint_names:
                    raise ConfigError(
                        f"{self.file}: field {field}: unknown joint {joint!r}, "
                        f"{self._alternatives(joint, self.joint_names)}"
                    )
                other = owners.setdefault(joint, field)
                if other != field:
                    raise ConfigError(f"{self.file}: field {field}: joint {joint!r} is already {other}")

    def _body(self, field: str, name: str) -> int:
        body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body < 1:
            bodies = [self.model.body(i).name for i in range(1, self.model.nbody)]
            raise ConfigError(
                f"{self.file}: field {field}: no body {name!r} in {self.config.mjcf}, "
                f"{self._alternatives(name, bodies)}"
            )
        return int(body)

    def _check_free_torso(self) -> None:
        address = self.model.body_jntadr[self.torso_id]
        if address < 0 or self.model.jnt_type[address] != mujoco.mjtJoint.mjJNT_FREE:
            raise ConfigError(f"{self.file}: field torso: body {self.config.torso!r} must have the MJCF's free joint")


def _array(values: Iterable[float]) -> Float:
    return _frozen(np.fromiter(values, np.float64))


def _mean_delay(servos: Sequence[Servo], catalogue: Sequence[Servo]) -> float:
    """Of the servos that differ from the catalogue, if any do [s]."""
    known = [servo.delay for servo, other in zip(servos, catalogue, strict=True) if servo.delay != other.delay]
    return float(np.mean(known or [servo.delay for servo in servos]))


def _frozen(array: NDArray) -> NDArray:
    array.setflags(write=False)
    return array
