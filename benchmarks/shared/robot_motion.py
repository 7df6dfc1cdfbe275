"""`parts_of`: how far human and simulated robot brought the parts that make a kind of motion from their stand.

Both are measured alike, whatever joints a robot has: directions of upper arms and forearms in the torso's frame, the
head's rotation against the torso, the torso's upward axis in the frame of its heading, the height of the hips over the
length of the legs, and the way and the turn over the floor. The robot's are of its true motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.robot import Robot
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.spatial.heading import continuous_heading
from flexmotion.spatial.rotations import matrices
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.directions import human_directions, robot_directions, standing_directions, trunk_of
from flexmotion.text.phrases import seen_parts
from flexmotion.text.sides import LEFT, sides
from flexmotion.text.vocabulary import vocabulary

Float = NDArray[np.float64]

SAMPLED_HZ = 31.25
"""Rate at which human and robot are compared: about that of the human's frames."""
WALKS = 1.0
"""A turn whose human goes further than this is a walked one, whose way counts [lengths of the leg]."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Part:
    """One part at equal times of the source, (T, C) each, as far as it is from the stand; every part has its own unit.

    Attributes:
        human, robot: as far as each moved it. Lengths of the robot are scaled to the human.
    """

    human: Float
    robot: Float


def parts_of(kind: str, robot: Robot, record: RunTrace, motion: Motion) -> dict[str, Part]:
    """The parts that make a kind of motion, by name: the way of a walk, both of a turn, else what is seen of it.

    A turn on the spot has no way.

    Args:
        kind: of motion; what is seen of it is in `phrases.yaml`, what walks and turns in `grammar.yaml`.
        record: of a simulated run.
        motion: of the human in this run, from source time 0.

    Raises:
        ValueError: the robot followed no frame of it.
    """
    known = np.isfinite(record.source_s) & (record.source_s >= 0.0) & np.isfinite(record.true_base).all(axis=1)
    rows = np.flatnonzero(known)[:: max(round(record.rate_hz / SAMPLED_HZ), 1)]
    if len(rows) < 2:
        raise ValueError(f"{kind}: the robot followed no frame of the human")
    frames = np.clip(np.rint(record.source_s[rows] * motion.fps).astype(int), 0, len(motion) - 1)
    both = _Both(robot, record.true_base[rows], record.true_q[rows], motion, frames)
    table = vocabulary().table
    if kind in table["turns"]:
        way = both.way()
        walks = float(np.abs(way.human).max()) >= WALKS
        return {"turn": both.turn(), **({"way": way} if walks else {})}
    if kind in table["walks"]:
        return {"way": both.way()}
    made: dict[str, Callable[[], Part]] = {
        "arm": lambda: both.arms(kind),
        "head": both.head,
        "trunk": both.trunk,
        "leg": both.hips,
    }
    return {name: made[name]() for name in sorted(seen_parts(kind))}


class _Both:
    """Human and robot at the same times.

    Args:
        base, q: the robot's true place and quaternion, (T, 7), and joint angles, (T, n) [rad].
        frames: of the human, (T,).
    """

    def __init__(self, robot: Robot, base: Float, q: Float, motion: Motion, frames: NDArray[np.int64]) -> None:
        self.robot, self.body, self.base, self.q = robot, WholeBody(robot), base, q
        self.motion, self.frames, self.human = motion, frames, forward(motion)
        self.directions = human_directions(self.human)[frames]

    def arms(self, kind: str) -> Part:
        """Upper arms and forearms; of a kind of one side those of that side."""
        chain, named = self.body.upper.chain, sides(kind)
        own = [0, 1] if len(named) != 1 else [0 if LEFT in named else 1]
        stand = standing_directions(self.robot, chain).segments
        made = robot_directions(chain, self.q, np.broadcast_to(_UP, (len(self.q), 3))).segments
        human, robot = ((one - stand)[:, own].reshape(len(self.q), -1) for one in (self.directions.segments, made))
        return Part(human, robot)

    def head(self) -> Part:
        """The rotation of the head against the torso since the first time [rad]."""
        human = np.swapaxes(self.human.torso_rotation, 1, 2) @ self.human.head_rotation
        return Part(_turned(human[self.frames]), _turned(self._heads()))

    def trunk(self) -> Part:
        """The torso's upward axis, against upright."""
        return Part(self.directions.trunk - _UP, trunk_of(self.base, np.zeros((len(self.base), 2))) - _UP)

    def hips(self) -> Part:
        """The height of the hips since the first time, over the length of the legs."""
        hips = self.base[:, 2] + (matrices(self.base[:, 3:]) @ self.body.hip_middle)[:, 2]
        human = self.human.pelvis_position[self.frames, 2]
        legs = self.motion.body.leg, self.body.leg_length
        return Part(*((height - height[0])[:, None] / leg for height, leg in zip((human, hips), legs, strict=True)))

    def way(self) -> Part:
        """The way over the floor, seen from the first heading, over the length of the legs."""
        human = _way(self.human.pelvis_position[self.frames], self.motion.root_quaternion[self.frames])
        return Part(human / self.motion.body.leg, _way(self.base[:, :3], self.base[:, 3:]) / self.body.leg_length)

    def turn(self) -> Part:
        """The heading since the first time [rad]."""
        human = continuous_heading(self.motion.root_quaternion)[self.frames, None]
        robot = continuous_heading(self.base[:, 3:])[:, None]
        return Part(human - human[0], robot - robot[0])

    def _heads(self) -> Float:
        """Rotations of the robot's head against its torso, (T, 3, 3): of a robot without a neck all the same."""
        robot, data = self.robot, mujoco.MjData(self.robot.model)
        neck = robot.chain("head").values() if robot.mapping.head is not None else ()
        bodies = [int(robot.model.joint(robot.joint_names[one]).bodyid[0]) for one in neck]
        bodies += [] if robot.config.head is None else [robot.model.body(robot.config.head.body).id]
        head = max(bodies, default=robot.torso_id)  # bodies come after those that carry them
        found = np.empty((len(self.q), 3, 3))
        for row, angles in enumerate(self.q):
            data.qpos[robot.qpos_address] = angles
            mujoco.mj_kinematics(robot.model, data)
            found[row] = data.xmat[robot.torso_id].reshape(3, 3).T @ data.xmat[head].reshape(3, 3)
        return found


def _turned(rotations: Float) -> Float:
    """Rotation vectors of rotations (T, 3, 3) since the first one, (T, 3) [rad]."""
    return np.asarray(Rotation.from_matrix(rotations @ rotations[0].T).as_rotvec())


def _way(position: Float, quaternion: Float) -> Float:
    """Places ahead of and to the left of the first pose, (T, 2) [m]."""
    yaw = float(continuous_heading(quaternion)[0])
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.asarray((position[:, :2] - position[0, :2]) @ np.array([[cos, -sin], [sin, cos]]))
