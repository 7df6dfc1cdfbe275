"""The default clip, made from keyframes: wave, bow, steps.

`python -m flexmotion.importers.default_clip` builds `data/default.npz` from `data/default_clip.yaml`. The centre of
mass moves as a linear inverted pendulum over the feet, so that steps are balanced; the legs follow the planted feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation

from flexmotion.configs.schema import Strict, load
from flexmotion.human.angles import rotation_about, three_angles
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.motion_file import load_motion, save_motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.importers.limb import solve_limb
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Keyframes = list[tuple[float, float]]

DATA = "default.npz"


class Step(Strict):
    """One step: times of lift-off and landing [s], and x of the landing [m]."""

    foot: Literal["l", "r"]
    lift: float
    land: float
    x: float


class Script(Strict):
    """Keyframes of a clip; see the comments in `data/default_clip.yaml`."""

    fps: float
    seconds: float
    joints: dict[str, Keyframes]
    pelvis_tilt: Keyframes
    pelvis_drop: Keyframes
    clearance: float
    steps: list[Step]


@lru_cache(maxsize=1)
def default_clip() -> Motion:
    """The shipped clip."""
    with resources.as_file(resources.files("flexmotion").joinpath("data", DATA)) as path:
        return load_motion(path)


def build_clip(script: Script, body: Body) -> Motion:
    """Motion of a keyframe script for a human of this size."""
    time = np.arange(round(script.seconds * script.fps) + 1) / script.fps
    joints = np.zeros((len(time), len(JOINTS)))
    for joint, keys in script.joints.items():
        joints[:, JOINTS.index(joint)] = np.radians(minimum_jerk(time, keys))
    tilt = np.radians(minimum_jerk(time, script.pelvis_tilt))
    ankles = _ankles(script, body, time)
    balance = _balanced_com(_zmp(script, ankles[..., :2], time), time, body)

    height = body.standing_height - minimum_jerk(time, script.pelvis_drop)
    motion = Motion(
        fps=script.fps,
        root_position=np.column_stack([balance, height]),
        root_quaternion=Rotation.from_euler("y", tilt[:, None]).as_quat(scalar_first=True),
        joints=joints,
        body=body,
        mass_given=True,
        source="default",
    )
    # The legs move with the pelvis, so its shift is iterated until the centre of mass is at its target.
    for _ in range(6):
        motion = _with_legs(motion, ankles)
        shift = np.column_stack([balance - forward(motion).com[:, :2], np.zeros(len(time))])
        motion = replace(motion, root_position=motion.root_position + shift)
    return _with_legs(motion, ankles)


def minimum_jerk(time: Float, keys: Sequence[tuple[float, float]]) -> Float:
    """Values at `time` [s] through keyframes (second, value), at rest in each (Flash and Hogan 1985), (T,)."""
    at, values = np.array(keys).T
    after = np.clip(np.searchsorted(at, time, side="right"), 1, max(len(at) - 1, 1))
    if len(at) == 1:
        return np.full(len(time), values[0])
    share = np.clip((time - at[after - 1]) / (at[after] - at[after - 1]), 0.0, 1.0)
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    return values[after - 1] + blend * (values[after] - values[after - 1])


def _ankles(script: Script, body: Body, time: Float) -> Float:
    """Ankle centres of both feet, which stay level, (T, 2, 3)."""
    size = body.segments
    ankles = np.zeros((len(time), 2, 3))
    for side, name in enumerate(SIDES):
        steps = [step for step in script.steps if step.foot == name]
        keys = [(0.0, 0.0)]
        for step in steps:
            keys += [(step.lift, keys[-1][1]), (step.land, step.x)]
            share = np.clip((time - step.lift) / (step.land - step.lift), 0.0, 1.0)
            ankles[:, side, 2] += script.clearance * 64 * (share * (1 - share)) ** 3
        ankles[:, side, 0] = minimum_jerk(time, keys)
        ankles[:, side, 1] = (0.5 - side) * size.hip_width
    ankles[..., 2] += size.ankle_height
    return ankles


def _zmp(script: Script, feet: Float, time: Float) -> Float:
    """Zero-moment point: under the stance foot during a step, else between both feet, (T, 2)."""
    keys = [(0.0, 0.5)]
    for step in script.steps:
        # Share of the load on the right foot.
        standing = 1.0 if step.foot == "l" else 0.0
        keys += [(step.lift, standing), (step.land, standing)]
    if script.steps:
        keys = [keys[0], (script.steps[0].lift - 0.5, 0.5), *keys[1:], (script.steps[-1].land + 0.6, 0.5)]
    share = minimum_jerk(time, keys)[:, None]
    return (1 - share) * feet[:, 0] + share * feet[:, 1]


def _balanced_com(zmp: Float, time: Float, body: Body) -> Float:
    """Horizontal centre of mass of a linear inverted pendulum over this ZMP, at rest at both ends, (T, 2).

    c'' = w² (c - p) (Kajita et al. 2001), solved as a boundary value problem by finite differences.
    """
    square = GRAVITY / (0.56 * body.height) * (time[1] - time[0]) ** 2
    bands = np.zeros((3, len(time)))
    bands[0, 2:], bands[2, :-2], bands[1] = -1.0, -1.0, 2.0 + square
    bands[1, [0, -1]] = 1.0
    right = square * zmp
    right[[0, -1]] = zmp[[0, -1]]
    com: Float = solve_banded((1, 1), bands, right)
    return com


def _with_legs(motion: Motion, ankles: Float) -> Motion:
    """The motion with leg angles that reach the given ankles with level soles."""
    size = motion.body.segments
    pelvis = Rotation.from_quat(motion.root_quaternion, scalar_first=True).as_matrix()
    joints = motion.joints.copy()
    for side, name in enumerate(SIDES):
        hip = motion.root_position + pelvis @ np.array([0.0, (0.5 - side) * size.hip_width, 0.0])
        leg = solve_limb(hip, ankles[:, side], pelvis[:, :, 1], (size.thigh, size.shank), 1.0)
        hips = three_angles(
            pelvis.swapaxes(1, 2) @ leg.rotation, ("hip_flexion", "hip_adduction", "hip_rotation"), name
        )
        shank = leg.rotation @ rotation_about("y", leg.flexion)
        column = JOINTS.index(f"hip_flexion_{name}")
        joints[:, column : column + 3] = hips
        joints[:, column + 3] = leg.flexion
        # The sole is level when the ankle compensates the forward lean of the shank.
        joints[:, column + 4] = np.arctan2(-shank[:, 2, 0], shank[:, 2, 2])
    return replace(motion, joints=joints)


def main() -> None:
    """Build the shipped file."""
    folder = Path(__file__).parents[1] / "data"
    save_motion(build_clip(load(Script, folder / "default_clip.yaml"), Body()), folder / DATA)


if __name__ == "__main__":
    main()
