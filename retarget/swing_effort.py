"""What swings of a leg ask of its servos, over what they give.

A foot travels over the floor while the torso moves on above the other foot. The joints follow by inverse kinematics,
their torques by Newton-Euler (Featherstone 2008, *Rigid Body Dynamics Algorithms*, section 5.3) for links whose mass is
at their centre; the rotation of the links themselves is left out, which is 2 % of the rotors' inertia for OP3. All
servos are taken at their nominal voltage, as in `configs/envelope.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.vectors import cross
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


@dataclass(frozen=True)
class Limits:
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
        return cls(
            usable=robot.usable_torque[pairs].min(axis=0),
            stall=robot.stall_torque[pairs].min(axis=0),
            back_emf=robot.back_emf[pairs].max(axis=0),
            speed=_FASTEST_SHARE * robot.no_load_speed[pairs].min(axis=0),
            armature=robot.model.dof_armature[dofs].max(axis=0),
            friction=robot.model.dof_frictionloss[dofs].max(axis=0),
        )


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
        self._above = np.stack([self.anchors, self.axes], axis=-1)
        self._cross = np.cross(self.axes[:, None], np.eye(3)).swapaxes(1, 2)
        """Matrices K with K v = axis x v, (6, 3, 3)."""
        self._cross_squared = self._cross @ self._cross

    def place(self, q: Float, torso: Float, rotation: Float) -> tuple[Float, Float, Float]:
        """Anchors and axes of the joints and centres of the links in the world, (R, 6, 3) each.

        Args:
            q: joint angles, (R, 6) [rad]; torso: (R, 3) [m]; rotation: of the torso, (R, 3, 3).
        """
        # Rotations about the joints' axes, (R, 6, 3, 3) (Rodrigues).
        sin, versine = np.sin(q)[..., None, None], (1.0 - np.cos(q))[..., None, None]
        turns = np.eye(3) + sin * self._cross + versine * self._cross_squared
        # Of the torso and of what each joint turns, (7, R, 3, 3).
        turned = np.empty((1 + len(self.mass), *rotation.shape))
        turned[0] = rotation
        for k in range(len(self.mass)):
            np.matmul(turned[k], turns[:, k], out=turned[k + 1])
        # Each joint's anchor from the one above and its axis at once, of all joints, (2, 6, R, 3).
        steps, axes = (turned[:-1] @ self._above[:, None]).transpose(3, 0, 1, 2)
        anchors = np.cumsum(np.concatenate([torso[None], steps]), axis=0)[1:]
        centres = anchors + (turned[1:] @ self.centre[:, None, :, None])[..., 0]
        return anchors.swapaxes(0, 1), axes.swapaxes(0, 1), centres.swapaxes(0, 1)


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
            *(vars(self.limits).values()),
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
        rows = q.shape[:2]
        anchors, axes, centres = (
            part.reshape(*rows, 6, 3)
            for part in self.chain.place(q.reshape(-1, 6), torso.reshape(-1, 3), rotation.reshape(-1, 3, 3))
        )
        dt = (seconds / (ROWS - 1))[:, None, None]
        speed = (q[:, 2:] - q[:, :-2]) / (2.0 * dt)
        acceleration = (q[:, 2:] - 2.0 * q[:, 1:-1] + q[:, :-2]) / dt**2
        force = (centres[:, 2:] - 2.0 * centres[:, 1:-1] + centres[:, :-2]) / dt[..., None] ** 2
        force[..., 2] += GRAVITY
        force *= self.chain.mass[:, None]
        anchors, axes, centres = anchors[:, 1:-1], axes[:, 1:-1], centres[:, 1:-1]
        # Moments about the world's origin add up along the chain, as do forces.
        moment = np.cumsum(cross(centres, force)[:, :, ::-1], axis=2)[:, :, ::-1]
        total = np.cumsum(force[:, :, ::-1], axis=2)[:, :, ::-1]
        limits = self.limits
        torque = np.sum(axes * (moment - cross(anchors, total)), axis=-1)
        torque += limits.armature * acceleration + limits.friction * np.tanh(speed / 0.1)
        driven = torque + limits.back_emf * speed
        # A servo that brakes gives its stall torque, one that drives its usable torque (`configs/envelope.py`).
        braking = np.clip(-torque * speed / (_BRAKING * limits.usable), 0.0, 1.0)
        given = MARGIN * (limits.usable + braking * (limits.stall - limits.usable))
        return np.stack([torque / given, driven / limits.stall, speed / limits.speed], axis=2)

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
