"""`true_gaze`: where a simulated robot looks, by its kinematics; `LOOKS`: what counts as a look somewhere."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.shared.gesture_judges import HELD_S
from flexmotion.configs.robot import Robot
from flexmotion.human.signals import runs

Float = NDArray[np.float64]


def _looks() -> dict[str, Mapping[str, float]]:
    rows = yaml.safe_load(Path(__file__).with_name("gesture_prompts.yaml").read_text(encoding="utf-8"))
    return {row["kind"]: row["check"]["looks"] for row in rows if set(row["check"].get("looks", ())) & {"turn", "up"}}


LOOKS = _looks()
"""Kinds of motion that look somewhere: least angles `turn` to the left and `up` [degrees], as for generated motion."""


def true_gaze(robot: Robot, base: Float, q: Float) -> Float:
    """Turning to the left against the torso's heading and pitch up of the head, (T, 2) [degrees].

    Args:
        robot: the robot file; it has a head.
        base: place [m] and quaternion of the torso, (T, 7).
        q: joint angles, (T, n) [rad].
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    head = [int(model.joint(robot.joint_names[index]).bodyid[0]) for index in robot.chain("head").values()]
    last = max(head)  # bodies come after those that carry them
    mujoco.mj_kinematics(model, data)
    own_ahead = data.xmat[last].reshape(3, 3)[0].copy()  # ahead at the reference pose, in the head's axes
    ahead = np.empty((len(q), 3))
    for row, (torso, angles) in enumerate(zip(base, q, strict=True)):
        data.qpos[:7], data.qpos[robot.qpos_address] = torso, angles
        mujoco.mj_kinematics(model, data)
        ahead[row] = data.xmat[last].reshape(3, 3) @ own_ahead
    heading = Rotation.from_quat(base[:, 3:], scalar_first=True).as_euler("ZYX")[:, 0]
    turn = np.angle(np.exp(1j * (np.arctan2(ahead[:, 1], ahead[:, 0]) - heading)))
    return np.degrees(np.stack([turn, np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0))], axis=1))


def gaze_faults(gaze: Float, kind: str, rate_hz: float) -> list[str]:
    """What is wrong with a look, in words: each angle of `LOOKS` is to be held for `HELD_S`.

    Args:
        gaze: as of `true_gaze`; it counts from where it began.
        kind: of motion, one of `LOOKS`; `head`: any of them.
        rate_hz: rows a second.
    """
    if kind == "head":
        some = any(not gaze_faults(gaze, one, rate_hz) for one in LOOKS)
        return [] if some else ["looked nowhere"]
    moved, wrong = gaze - gaze[0], []
    for column, name, side in ((0, "turn", ("right", "left")), (1, "up", ("down", "up"))):
        least = LOOKS[kind].get(name, 0.0)
        along = moved[:, column] * np.sign(least)
        held = any(end - first >= HELD_S * rate_hz for first, end in runs(along >= abs(least)))
        if least and not held:
            wrong.append(f"looked {along.max():.0f}° {side[least > 0]} at most, {abs(least):.0f}° held is a look")
    return wrong
