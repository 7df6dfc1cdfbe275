"""What the robot itself did in a run of the simulation: its hands, its way, its turn."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from reversals import reversals

from flexmotion.configs.robot import Robot
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.metrics import Displacement

Float = NDArray[np.float64]

LOOK_HZ = 25.0
"""How often hands are looked at."""
SWINGS = 2
"""Turns of a waving hand that make it a wave."""
REACH = 0.09
"""A hand swings if it moves by at least this share of the arm's length between its turns: 5 cm of a human's."""
NEAR = 0.18
"""A hand waves from this share of the arm's length below its shoulder upwards: 10 cm of a human's."""


@dataclass(frozen=True)
class Deeds:
    """What the robot did while its source played.

    Attributes:
        raised: whether the left and the right hand were above their shoulders, (2,).
        waved: whether each swung to and fro up there, (2,).
        forward, left: straight displacement as seen from where it faced at first [m].
        turned: by how much its heading changed, positive left [degrees].
    """

    raised: tuple[bool, bool]
    waved: tuple[bool, bool]
    forward: float
    left: float
    turned: float


def deeds(robot: Robot, record: RunTrace) -> Deeds:
    """Read from the ground truth of a run."""
    rows = np.flatnonzero(np.isfinite(record.source_s) & np.isfinite(record.true_base).all(axis=1))
    base = record.true_base[rows]
    yaw = continuous_heading(base[:, 3:])
    went = Displacement.of(base[:, :3], yaw)
    looked = rows[:: max(round(record.rate_hz / LOOK_HZ), 1)]
    hand, shoulder, torso = _arms(robot, record.true_base[looked], record.true_q[looked])
    arm = float(np.linalg.norm(hand - shoulder, axis=-1).max())
    local = np.einsum("tji,tsj->tsi", torso, hand - shoulder)
    above = hand[:, :, 2] - shoulder[:, :, 2]
    return Deeds(
        raised=(bool((above[:, 0] > 0).any()), bool((above[:, 1] > 0).any())),
        waved=(_waves(local[:, 0], above[:, 0], arm), _waves(local[:, 1], above[:, 1], arm)),
        forward=went.ahead_m,
        left=went.left_m,
        turned=float(np.degrees(went.turned_rad)),
    )


def _arms(robot: Robot, base: Float, q: Float) -> tuple[Float, Float, Float]:
    """Hands and shoulders in the world, (K, 2, 3) [m], and the torso's rotation, (K, 3, 3)."""
    hands = robot.config.hands
    assert hands is not None
    data = mujoco.MjData(robot.model)
    names = [robot.joint_names[list(robot.chain(f"{side}_arm").values())[-2]] for side in ("left", "right")]
    joints = [robot.model.joint(name).id for name in names]
    hand, shoulder = np.empty((2, len(q), 2, 3))
    torso = np.empty((len(q), 3, 3))
    for row in range(len(q)):
        data.qpos[:7], data.qpos[robot.qpos_address] = base[row], q[row]
        mujoco.mj_kinematics(robot.model, data)
        torso[row] = data.xmat[robot.torso_id].reshape(3, 3)
        shoulder[row] = data.xanchor[joints]
        for side, own in enumerate((hands.left, hands.right)):
            body = robot.model.body(own.body).id
            hand[row, side] = data.xpos[body] + data.xmat[body].reshape(3, 3) @ np.asarray(own.point)
    return hand, shoulder, torso


def _waves(local: Float, above: Float, arm: float) -> bool:
    """Whether a hand, seen from the torso (K, 3), turns to and fro while it is up."""
    up = local[above > -NEAR * arm]
    return len(up) > LOOK_HZ / 5 and max(reversals(axis, REACH * arm) for axis in up.T) >= SWINGS
