"""Augmentation: the same motion with other bodies, at other speeds, from other poses, under loads.

Results depend on arguments and the state of the random generator only. Dynamics must be computed anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.smoothing import BALL_JOINTS
from flexmotion.human.angles import three_angle_rotation, three_angles
from flexmotion.human.body import Body, Segments
from flexmotion.human.joint_limits import joint_limits
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, LEG_JOINTS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Ranges:
    """Ranges of the augmentation.

    Attributes:
        tempo: greatest local change of speed, relative.
        height: greatest change of stature, relative.
        body_mass_index: lower and upper limit [kg/m²]; 18.5 to 25 is normal, to 30 overweight (WHO).
        angle: standard deviation of a joint's initial angle [rad]; legs are unchanged, they stand on the floor.
        settle: time constant with which that difference decays [s].
        push: greatest force on the trunk, as of a brush in a crowd [body weights].
        carried: greatest mass in both hands [kg].
    """

    tempo: float = 0.15
    height: float = 0.08
    body_mass_index: tuple[float, float] = (18.5, 30.0)
    angle: float = 0.05
    settle: float = 0.5
    push: float = 0.05
    carried: float = 5.0


RANGES = Ranges()


def time_warped(motion: Motion, generator: np.random.Generator, ranges: Ranges = RANGES) -> Motion:
    """The motion at a varying tempo, with a knot about every second; kinematics only."""
    frames = len(motion)
    if frames < 4:
        return motion
    knots = max(2, round(motion.duration) + 1)
    speed = 1 + ranges.tempo * generator.uniform(-1, 1, knots)
    places = np.linspace(0, frames - 1, knots)
    # Cumulative duration of the original frames: the time at which each is reached.
    reached = np.concatenate([[0.0], np.cumsum(1 / PchipInterpolator(places, speed)(np.arange(frames - 1) + 0.5))])
    at = PchipInterpolator(reached, np.arange(frames))(np.arange(int(reached[-1]) + 1)).clip(0, frames - 1)

    def sampled(signal: Float) -> Float:
        values: Float = CubicSpline(np.arange(frames), signal)(at)
        return values

    def turned(quaternions: Float) -> Float:
        values = sampled(continuous_quaternions(quaternions))
        normal: Float = values / np.linalg.norm(values, axis=-1, keepdims=True)
        return normal

    joints = sampled(motion.joints)
    # Rotations are interpolated, since angles do not define the pose between frames near gimbal lock.
    for names, side in BALL_JOINTS:
        columns = [JOINTS.index(f"{name}_{side}" if side else name) for name in names]
        quaternions = three_angle_rotation(motion.joints[:, columns], names, side).as_quat()
        joints[:, columns] = three_angles(Rotation.from_quat(turned(quaternions)).as_matrix(), names, side)
    return replace(
        motion,
        root_position=sampled(motion.root_position),
        root_quaternion=turned(motion.root_quaternion),
        joints=joints,
        torques=None,
        wrenches=None,
        activations=None,
        joint_contact=None,
        pressure_centres=None,
        contacts=None,
    )


def other_body(motion: Motion, generator: np.random.Generator, ranges: Ranges = RANGES) -> Motion:
    """The same angles on a body of another size, sex and mass; the path scales with the legs."""
    scale = 1 + ranges.height * generator.uniform(-1, 1)
    height = scale * motion.body.height
    fitted = None
    if motion.body.fitted is not None:
        sizes = {name: value * scale for name, value in vars(motion.body.fitted).items() if name != "toe_out"}
        fitted = Segments(**sizes, toe_out=motion.body.fitted.toe_out)
    body = Body(
        height=height,
        mass=float(generator.uniform(*ranges.body_mass_index)) * height**2,
        sex="male" if generator.random() < 0.5 else "female",
        fitted=fitted,
    )
    return replace(motion, body=body, mass_given=True, root_position=scale * motion.root_position)


def other_start(motion: Motion, generator: np.random.Generator, ranges: Ranges = RANGES) -> Motion:
    """The motion with other initial angles of trunk, neck and arms, which decay to it; within joint limits."""
    fade = np.exp(-np.arange(len(motion)) / (ranges.settle * motion.fps))
    legs = np.array([name.removesuffix("_l").removesuffix("_r") in LEG_JOINTS for name in JOINTS])
    difference = np.where(legs, 0.0, ranges.angle * generator.standard_normal(len(JOINTS)))
    joints = motion.joints + fade[:, None] * difference
    lower, upper = joint_limits().T
    inside = np.clip(joints, np.minimum(lower, motion.joints), np.maximum(upper, motion.joints))
    return replace(motion, joints=inside)


def loads(motion: Motion, generator: np.random.Generator, ranges: Ranges = RANGES) -> tuple[ExternalLoad, ...]:
    """A transient push on the trunk, and a mass carried in the hands."""
    frames, weight = len(motion), motion.body.mass * GRAVITY
    middle, width = generator.uniform(0, frames), generator.uniform(0.2, 0.6) * motion.fps
    course = np.exp(-(((np.arange(frames) - middle) / width) ** 2))
    direction = generator.uniform(-np.pi, np.pi)
    push = ranges.push * weight * generator.random() * course[:, None]
    found = [ExternalLoad("torso", push * [np.cos(direction), np.sin(direction), 0.0])]
    burden = ranges.carried * GRAVITY * generator.random() / 2
    found += [ExternalLoad(f"hand_{side}", np.tile([0.0, 0.0, -burden], (frames, 1))) for side in "lr"]
    return tuple(found)


def varied(motion: Motion, seed: int, ranges: Ranges = RANGES) -> tuple[Motion, tuple[ExternalLoad, ...]]:
    """The motion with all augmentations, and its loads, from one seed."""
    generator = np.random.default_rng(seed)
    changed = other_start(other_body(time_warped(motion, generator, ranges), generator, ranges), generator, ranges)
    return changed, loads(changed, generator, ranges)
