"""What swings of a leg ask of its servos, over what they give.

A foot travels over the floor while the torso moves on above the other foot. The joints follow by inverse kinematics,
their torques by Newton-Euler (Featherstone 2008, *Rigid Body Dynamics Algorithms*, section 5.3) for links whose mass is
at their centre; the rotation of the links themselves is left out, which is 2 % of the rotors' inertia for OP3. All
servos are taken at their nominal voltage, as in `configs/envelope.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import ANY, FLOATS, compiled, fields, packed
from flexmotion.configs.robot import Robot
from flexmotion.retarget.legs import Leg
from flexmotion.retarget.zmp_roll import roll_share, steady_hips
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.rotations import yaw_matrices

Float = NDArray[np.float64]

ROWS = 33
"""Rows of a swing, lift-off and touch-down included."""
_FASTEST_SHARE = 0.97
"""Speed that is used, over the no-load speed."""

MARGIN = 1.1
"""Most torque of a swing over what the servos give; voltage and speed have no margin. At 1.4 one of two walks fell."""
_BRAKING = 0.3
"""Speed from which a servo that brakes gives all of its stall torque [rad/s]; the envelope itself jumps at 0."""


class Limits(NamedTuple):
    """What the servos of both legs give in the order of `legs.CHAIN`, the weaker of each pair, (6,) each.

    Attributes:
        usable: torque [N·m].
        stall: torque that the supply drives against back-EMF [N·m].
        back_emf: torque lost per speed [N·m·s/rad].
        speed: greatest that is used [rad/s].
        armature: inertia of rotor and gears at the joint [kg·m²].
        friction: dry friction [N·m].
    """

    usable: Float
    stall: Float
    back_emf: Float
    speed: Float
    armature: Float
    friction: Float

    @classmethod
    def of(cls, robot: Robot, legs: tuple[Leg, Leg]) -> Limits:
        """Read them from the robot's file and model."""
        pairs = np.array([leg.indices for leg in legs])
        dofs = robot.dof_address[pairs]
        return packed(
            cls,
            usable=robot.usable_torque[pairs].min(axis=0),
            stall=robot.stall_torque[pairs].min(axis=0),
            back_emf=robot.back_emf[pairs].max(axis=0),
            speed=_FASTEST_SHARE * robot.no_load_speed[pairs].min(axis=0),
            armature=robot.model.dof_armature[dofs].max(axis=0),
            friction=robot.model.dof_frictionloss[dofs].max(axis=0),
        )


class _Links(NamedTuple):
    """Links of a leg in its zero pose, by joint.

    Attributes:
        axes, anchors, centre: see `LegChain`, (6, 3); mass: (6,) [kg].
        cross, cross_squared: matrices K with K v = axis x v, and K K, (6, 3, 3).
    """

    axes: Float
    anchors: Float
    centre: Float
    mass: Float
    cross: Float
    cross_squared: Float


class LegChain:
    """Links of a leg as masses at their centres, moved by its six joints."""

    def __init__(self, robot: Robot, leg: Leg) -> None:
        model = robot.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        torso = robot.torso_id
        joints = [model.joint(robot.joint_names[i]).id for i in leg.indices]
        to_torso = data.xmat[torso].reshape(3, 3).T
        self.axes: Float = data.xaxis[joints] @ to_torso.T
        anchors = (data.xanchor[joints] - data.xpos[torso]) @ to_torso.T
        self.anchors: Float = np.diff(anchors, axis=0, prepend=np.zeros((1, 3)))
        """Of each joint from the one above, in the zero pose, (6, 3) [m]."""
        moved = [int(body) for body in model.jnt_bodyid[joints]]
        self.mass, self.centre = np.zeros(len(joints)), np.zeros((len(joints), 3))
        for body in range(1, model.nbody):
            above = body
            while above and above not in moved:
                above = int(model.body_parentid[above])
            if above:
                link = moved.index(above)
                self.mass[link] += model.body_mass[body]
                self.centre[link] += model.body_mass[body] * (to_torso @ (data.xipos[body] - data.xpos[torso]))
        self.centre = self.centre / np.maximum(self.mass, 1e-9)[:, None] - anchors
        turn = np.cross(self.axes[:, None], np.eye(3)).swapaxes(1, 2)
        self.links = packed(
            _Links,
            axes=self.axes,
            anchors=self.anchors,
            centre=self.centre,
            mass=self.mass,
            cross=turn,
            cross_squared=turn @ turn,
        )


class SwingEffort:
    """Measures swings of one robot; all of them are of its left leg, those of the right are their mirror images.

    Args:
        robot: whose servos swing the leg.
        legs: left and right.
        omega: natural frequency of the robot's pendulum [1/s].
    """

    def __init__(self, robot: Robot, legs: tuple[Leg, Leg], omega: float) -> None:
        self.gait, self.leg, self.omega = robot.gait, legs[0], omega
        self.limits, self.chain = Limits.of(robot, legs), LegChain(robot, legs[0])
        self.phase = np.linspace(0.0, 1.0, ROWS)
        self._sole_half_length = float(robot.sole_half_size[:, 0].min())
        self._height = self.gait.walk_hip_height - float(self.leg.sole[2]) - float(self.leg.hip[2])

    def figures(self) -> Float:
        """All that the effort depends on, as one vector."""
        leg, gait, chain = self.leg, self.gait, self.chain
        parts = [
            [gait.walk_hip_height, gait.double_support_min_s, gait.clearance, gait.max_foot_yaw, gait.max_toe_in],
            [self.omega, self._sole_half_length, leg.thigh, leg.shank, *leg.hip, *leg.sole, *leg.signs],
            *self.limits._asdict().values(),
            *(part.ravel() for part in (chain.axes, chain.anchors, chain.mass, chain.centre)),
        ]
        return np.concatenate(parts)

    def asked(self, progress: Float, lift: Float, travel: Float, seconds: Float) -> Float:
        """What swings ask of the servos, over what they give.

        Args:
            progress: share of the travel, (B, ROWS); lift: height of the sole over the floor, (B, ROWS) [m].
            travel: of the foot ahead, to the left and turning to the left, (B, 3) [m, m, rad].
            seconds: duration of the swings, (B,) [s].

        Returns:
            Signed shares of the torque that they give, of the torque that the supply drives against back-EMF, and of
            the greatest speed, (B, ROWS - 2, 3, 6). NaN where the leg cannot reach.
        """
        return self._shares(*self._joints(progress, lift, travel, seconds), seconds)

    def asked_over(self, mirrored: NDArray[np.bool_], soles: Float, torso: Float, seconds: Float) -> Float:
        """What swings ask while the torso moves as it is planned, over what the servos give.

        Args:
            mirrored: which swings are of the right leg, (B,).
            soles: x, y, z of the sole's centre and yaw, (B, ROWS, 4) [m, m, m, rad].
            torso: x, y, height of the hips over the ankle of a foot on the ground and yaw, (B, ROWS, 4) [m, m, m, rad].
            seconds: duration of the swings, (B,) [s].

        Returns:
            As `asked`.
        """
        mirror = np.where(mirrored[:, None, None], [1.0, -1.0, 1.0, -1.0], 1.0)
        soles, torso = mirror * soles, mirror * torso
        position = torso[..., :3] - [0.0, 0.0, self.leg.sole[2] + self.leg.hip[2]]
        return self._shares(*self._solved(position, torso[..., 3], soles), seconds)

    def _shares(self, q: Float, torso: Float, rotation: Float, seconds: Float) -> Float:
        """What joint paths of swings ask; returns as `asked`, arguments as `_joints` returns them."""
        return _asked(self.chain.links, self.limits, q, torso, rotation, seconds)

    def _joints(self, progress: Float, lift: Float, travel: Float, seconds: Float) -> tuple[Float, Float, Float]:
        """Joint angles (B, ROWS, 6) [rad], and positions and rotations of the torso.

        In a steady walk a foot travels by two strides. The zero-moment point rolls ahead, not aside, and the torso
        turns as it goes aside.
        """
        pause, stride = self.gait.double_support_min_s, 0.5 * travel
        rolled, still = (
            steady_hips(self.phase, roll, seconds, pause, self.omega)
            for roll in (roll_share(stride[:, 0], self._sole_half_length), np.zeros(len(stride)))
        )
        foot = (progress - 0.5)[..., None] * travel[:, None]
        torso = np.stack([rolled, still, still], axis=-1) * stride[:, None]
        position = np.concatenate([torso[..., :2], np.full((*progress.shape, 1), self._height)], axis=-1)
        ahead = foot[..., :2] + (self.leg.hip + self.leg.sole)[:2]
        soles = np.concatenate([ahead, lift[..., None], foot[..., 2:]], axis=-1)
        return self._solved(position, torso[..., 2], soles)

    def _solved(self, position: Float, yaw: Float, soles: Float) -> tuple[Float, Float, Float]:
        """Joint angles for poses of the torso, upright, and of the sole; returns as `_joints`.

        Args:
            position: of the torso, (B, ROWS, 3) [m]; yaw: of the torso, (B, ROWS) [rad].
            soles: x, y, z, yaw, (B, ROWS, 4) [m, m, m, rad].
        """
        rotation = yaw_matrices(yaw.reshape(-1))
        sole = soles.reshape(-1, 4)
        q, missing = self.leg.solve(position.reshape(-1, 3), rotation, sole[:, :3], yaw_matrices(sole[:, 3]))
        q[missing > 1e-6] = np.nan
        shape = yaw.shape
        return q.reshape(*shape, 6), position, rotation.reshape(*shape, 3, 3)


@compiled(
    fields(_Links, *[FLOATS[2]] * 3, FLOATS[1], *[FLOATS[3]] * 2),
    fields(Limits, *[FLOATS[1]] * 6),
    FLOATS[3],
    ANY[3],
    ANY[4],
    ANY[1],
)
def _asked(links: _Links, limits: Limits, q: Float, torso: Float, rotation: Float, seconds: Float) -> Float:
    """`SwingEffort._shares`."""
    number, rows, _ = q.shape
    anchors, axes, centres = np.empty((rows, 6, 3)), np.empty((rows, 6, 3)), np.empty((rows, 6, 3))
    turned, own, above = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    force, moment = np.empty(3), np.empty(3)
    out = np.empty((number, rows - 2, 3, 6))
    for swing in range(number):
        dt = seconds[swing] / (rows - 1)
        for row in range(rows):
            turned[:], above[:] = rotation[swing, row], torso[swing, row]
            for k in range(6):
                for i in range(3):
                    anchors[row, k, i], axes[row, k, i] = above[i], 0.0
                    for j in range(3):
                        anchors[row, k, i] += turned[i, j] * links.anchors[k, j]
                        axes[row, k, i] += turned[i, j] * links.axes[k, j]
                above[:] = anchors[row, k]
                # Rodrigues' formula without the identity.
                sin, versine = math.sin(q[swing, row, k]), 1.0 - math.cos(q[swing, row, k])
                for i in range(3):
                    for j in range(3):
                        own[i, j] = sin * links.cross[k, i, j] + versine * links.cross_squared[k, i, j]
                for i in range(3):
                    a, b, c = turned[i, 0], turned[i, 1], turned[i, 2]
                    for j in range(3):
                        turned[i, j] += a * own[0, j] + b * own[1, j] + c * own[2, j]
                for i in range(3):
                    centres[row, k, i] = above[i]
                    for j in range(3):
                        centres[row, k, i] += turned[i, j] * links.centre[k, j]
        for row in range(1, rows - 1):
            # Moments about the world's origin add up along the chain, as do forces.
            total_x, total_y, total_z = 0.0, 0.0, 0.0
            moment[:] = 0.0
            for k in range(5, -1, -1):
                for i in range(3):
                    bend = centres[row + 1, k, i] - 2.0 * centres[row, k, i] + centres[row - 1, k, i]
                    force[i] = links.mass[k] * (bend / dt**2 + (GRAVITY if i == 2 else 0.0))
                total_x, total_y, total_z = total_x + force[0], total_y + force[1], total_z + force[2]
                x, y, z = centres[row, k]
                moment[0] += y * force[2] - z * force[1]
                moment[1] += z * force[0] - x * force[2]
                moment[2] += x * force[1] - y * force[0]
                x, y, z = anchors[row, k]
                torque = axes[row, k, 0] * (moment[0] - (y * total_z - z * total_y))
                torque += axes[row, k, 1] * (moment[1] - (z * total_x - x * total_z))
                torque += axes[row, k, 2] * (moment[2] - (x * total_y - y * total_x))
                before, now, after = q[swing, row - 1, k], q[swing, row, k], q[swing, row + 1, k]
                speed, acceleration = (after - before) / (2.0 * dt), (after - 2.0 * now + before) / dt**2
                torque += limits.armature[k] * acceleration + limits.friction[k] * math.tanh(speed / 0.1)
                # A servo that brakes gives its stall torque, one that drives its usable torque (`configs/envelope.py`).
                usable, stall = limits.usable[k], limits.stall[k]
                braking = min(max(-torque * speed / (_BRAKING * usable), 0.0), 1.0)
                out[swing, row - 1, 0, k] = torque / (MARGIN * (usable + braking * (stall - usable)))
                out[swing, row - 1, 1, k] = (torque + limits.back_emf[k] * speed) / stall
                out[swing, row - 1, 2, k] = speed / limits.speed[k]
    return out
