"""What the simulated robot did in a run, by its true motion: hands, displacement, turn."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.judges import waves
from flexmotion.configs.robot import Robot
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.metrics import Displacement

Float = NDArray[np.float64]

SAMPLED_HZ = 25.0
"""Rate at which hands are sampled."""
REACH = 0.09
"""Share of the arm's length that a hand must move between two reversals: 5 cm of a human's."""
NEAR = 0.18
"""A hand is up from this share of the arm's length below its shoulder: 10 cm of a human's."""
FEWEST_S = 0.24
"""A hand that is up for less does not wave [s]."""


@dataclass(frozen=True)
class Achieved:
    """What the robot did while its source played.

    Attributes:
        raised: whether the left and the right hand were above their shoulders, (2,).
        waved: whether each moved to and fro up there, (2,).
        forward, left: straight displacement, seen from the initial heading [m].
        turned: change of the heading, positive to the left [degrees].
    """

    raised: tuple[bool, bool]
    waved: tuple[bool, bool]
    forward: float
    left: float
    turned: float


def achieved(robot: Robot, record: RunTrace) -> Achieved:
    """Measured on the true motion of a simulated run."""
    rows = np.flatnonzero(np.isfinite(record.source_s) & np.isfinite(record.true_base).all(axis=1))
    base = record.true_base[rows]
    went = Displacement.of(base[:, :3], continuous_heading(base[:, 3:]))
    sampled = rows[:: max(round(record.rate_hz / SAMPLED_HZ), 1)]
    hand, shoulder, torso = _arms(robot, record.true_base[sampled], record.true_q[sampled])
    arm = float(np.linalg.norm(hand - shoulder, axis=-1).max())
    local = np.einsum("tji,tsj->tsi", torso, hand - shoulder)
    above = hand[:, :, 2] - shoulder[:, :, 2]
    fewest = round(FEWEST_S * SAMPLED_HZ)
    left, right = (waves(local[:, side], above[:, side] > -NEAR * arm, REACH * arm, fewest) for side in (0, 1))
    return Achieved(
        raised=(bool((above[:, 0] > 0).any()), bool((above[:, 1] > 0).any())),
        waved=(left, right),
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
