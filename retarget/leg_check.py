"""Checks of a closed-form leg against the robot's model: the order of its joints, and poses that it must reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import RetargetError
from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]
Solver = Callable[[Float, Float, Float, Float], tuple[Float, Float]]
"""From torso position (T, 3) and rotation (T, 3, 3), sole position and rotation to joint angles (T, 6) [rad] and the
missing length of the leg (T,) [m]; see `legs.Leg.solve`."""

POSES = 64
"""Poses that are solved: over the whole range of the six joints, from a fixed seed."""
POSITION_TOLERANCE = 2e-3
"""Largest distance of the sole from its target [m]. Axes that miss each other by the millimetre that is allowed put it
off by as much; OP3's do by .3 mm. A chain of another order is off by centimetres."""
ROTATION_TOLERANCE = 1e-3
"""Largest rotation of the sole away from its target [rad]: the closed form is exact in rotation."""
KNEE = 3
"""Index of the knee in the chain."""


def check_order(robot: Robot, side: str, names: Sequence[str], body: int) -> None:
    """Check that the joints from torso to foot are `names`, in this order.

    Args:
        side: "left" or "right", for the message.
        names: the six joints of the mapping, hip yaw first.
        body: id of the foot's body.

    Raises:
        RetargetError: they come in another order, one is elsewhere, or the model has others between them.
    """
    model, found = robot.model, list[str]()
    while body not in (0, robot.torso_id):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        found += [model.joint(first + k).name for k in reversed(range(count))]
        body = int(model.body_parentid[body])
    found.reverse()
    if found != list(names):
        raise RetargetError(
            f"{robot.file}: mapping.{side}_leg: from torso to foot the model has the joints "
            f"{', '.join(found) or 'none'}; expected hip yaw, hip roll, hip pitch, knee, ankle pitch, ankle roll: "
            f"{', '.join(names)}"
        )


def check_poses(
    robot: Robot, side: str, indices: NDArray[np.int64], signs: Float, knee_range: tuple[float, float], solve: Solver
) -> None:
    """Solve sole poses that forward kinematics gave, and check that the angles found reach them again.

    Args:
        side: "left" or "right".
        indices: columns of the six joints, (6,); signs: direction of the model's axes along the canonical ones, (6,).
        knee_range: least and greatest knee angle of the closed form, in the canonical direction [rad].
        solve: the closed form.

    Raises:
        RetargetError: the knee bends backward, or a sole is off its target by more than the tolerances.
    """
    lower, upper = robot.lower[indices].copy(), robot.upper[indices].copy()
    knee = np.sort(signs[KNEE] * np.array([lower[KNEE], upper[KNEE]]))
    least, most = max(knee[0], knee_range[0]), min(knee[1], knee_range[1])
    name = robot.joint_names[indices[KNEE]]
    if least >= most:
        raise RetargetError(
            f"{robot.file}: joint {name!r} of the {side} leg: limits {_limits(robot, indices[KNEE])} rad bend the knee "
            f"backward; expected a range within {_span(signs[KNEE] * np.array(knee_range))} rad, the shank turned back"
        )
    lower[KNEE], upper[KNEE] = np.sort(signs[KNEE] * np.array([least, most]))
    angles = np.random.default_rng(0).uniform(lower, upper, (POSES, len(indices)))
    torso, rotation = np.zeros((POSES, 3)), np.tile(np.eye(3), (POSES, 1, 1))
    position, turned = _soles(robot, side, indices, angles)
    found, _ = solve(torso, rotation, position, turned)
    reached, towards = _soles(robot, side, indices, found)
    off = np.linalg.norm(reached - position, axis=1)
    turn = np.arccos(np.clip(0.5 * (np.einsum("tij,tij->t", towards, turned) - 1.0), -1.0, 1.0))
    worst = int(np.argmax(off / POSITION_TOLERANCE + turn / ROTATION_TOLERANCE))
    if off[worst] > POSITION_TOLERANCE or turn[worst] > ROTATION_TOLERANCE:
        pose = ", ".join(f"{robot.joint_names[i]} {angle:.2f}" for i, angle in zip(indices, angles[worst], strict=True))
        raise RetargetError(
            f"{robot.file}: {side} leg: the closed form misses the sole's pose at {pose} rad by "
            f"{1e3 * off[worst]:.1f} mm and {np.degrees(turn[worst]):.1f}°, {1e3 * POSITION_TOLERANCE:g} mm is "
            "allowed; expected the three hip axes in one point and the two ankle axes in another"
        )


def check_height(robot: Robot, side: str, length: float) -> None:
    """Check that the robot can stand as high as its file says.

    Args:
        side: "left" or "right", for the message.
        length: longest distance from hip to ankle of the model's leg [m].

    Raises:
        RetargetError: the leg is shorter.
    """
    height = robot.gait.stand_hip_height
    if height > length:
        raise RetargetError(
            f"{robot.file}: field gait.stand_hip_height: {height:g} m, but the {side} leg of the model reaches "
            f"{length:.4f} m from hip to ankle; expected less than that"
        )


def _soles(robot: Robot, side: str, indices: NDArray[np.int64], angles: Float) -> tuple[Float, Float]:
    """Centre (T, 3) and rotation (T, 3, 3) of the sole for joint angles (T, 6), by MuJoCo, in the torso's frame."""
    foot = ("left", "right").index(side)
    model, body = robot.model, robot.foot_ids[foot]
    data = mujoco.MjData(model)
    q = np.zeros(robot.n)
    data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
    position, rotation = np.empty((len(angles), 3)), np.empty((len(angles), 3, 3))
    for k, row in enumerate(angles):
        q[indices] = row
        data.qpos[robot.qpos_address] = q
        mujoco.mj_kinematics(model, data)
        rotation[k] = data.xmat[body].reshape(3, 3)
        position[k] = data.xpos[body] + rotation[k] @ robot.soles[foot]
    return position, rotation


def _limits(robot: Robot, joint: int) -> str:
    return _span(np.array([robot.lower[joint], robot.upper[joint]]))


def _span(ends: Float) -> str:
    low, high = np.sort(ends)
    return f"[{low:.2f}, {high:.2f}]"
