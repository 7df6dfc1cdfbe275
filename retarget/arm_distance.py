"""`ArmDistance`: how near the forearms come to the rest of the robot, and which way is out, at any joint angles.

Forearms are capsules of which a few points are taken, the rest of the body rounded boxes: capsules and spheres as they
are, other shapes by the box around them. In numpy over all rows at once, after one call of MuJoCo's kinematics a row.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.arm_chain import ArmChain

Float = NDArray[np.float64]
Int = NDArray[np.int64]

REST, LEG = 0, 1
"""Kinds of what a forearm keeps clear of."""
_LEAST = 0.04
"""Distance that is kept, over arm length: half of what `BodyClearance` keeps, for joints that lag (OP3: 8 mm; its
forearms were up to 5 mm off their reference when they passed a thigh)."""
_POINTS = 5
"""Points along a forearm: 15 mm apart on OP3, which misses .7 mm of a crossing thigh."""


@dataclass(frozen=True)
class Approach:
    """The nearest approach of each arm to each kind of body at the rows of a plan.

    Attributes:
        missing: what lacks of the distance to be kept, (2 kinds, R, 2) [m]; 0: nothing. Kinds: `REST`, `LEG`.
        way: unit vector of the shortest way out, (2 kinds, R, 2, 3).
        aside: distance to be moved outward to be clear of legs, (R, 2) [m].
        lever: movement of the nearest point by the joints of the arm, (2 kinds, R, 2, m, 3) [m/rad].
    """

    missing: Float
    way: Float
    aside: Float
    lever: Float


class ArmDistance:
    """Distances of the forearms of one robot; has MuJoCo data of its own.

    Args:
        robot: the robot file; what has no collision shape is not kept clear of.
        chain: its arms.

    Attributes:
        joints: columns of the arm joints, (2, m).
        kept: distance that forearms keep [m].
    """

    def __init__(self, robot: Robot, chain: ArmChain) -> None:
        model, hands = robot.model, robot.config.hands
        assert hands is not None  # ArmChain has checked it
        self._robot, self._model, self._data = robot, model, mujoco.MjData(model)
        self.joints = chain.joints
        names = np.array(robot.joint_names)
        self._ids = np.array([[model.joint(name).id for name in side] for side in names[self.joints]])
        moved = model.jnt_bodyid[self._ids]
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        solid = np.flatnonzero(solid & (model.geom_bodyid > 0))
        # Which joints of which arm move a shape, (G, 2, m).
        paths = [np.isin(moved, _path(model, int(model.geom_bodyid[geom]))) for geom in solid]
        turned = np.array(paths, dtype=bool).reshape(-1, *moved.shape)
        fore = turned[:, :, chain.fore_joint].any(axis=1)
        self._fore, body = solid[fore], solid[~turned.any(axis=(1, 2))]
        self._side = turned[fore, :, 0].argmax(axis=1)
        self._turns = turned[fore, self._side].astype(float)[:, :, None]
        # Forearms as capsules along the longest edge of their box, the rest as rounded boxes.
        half = model.geom_aabb[self._fore, 3:]
        self._along = half.argmax(axis=1)
        self._thickness = np.sort(half, axis=1)[:, 1]
        self._reach = half.max(axis=1) - self._thickness
        round_ = np.isin(model.geom_type[body], (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE))
        rounding = np.where(round_, model.geom_size[body, 0], 0.0)
        # What forearms keep clear of: the rest of the body, and each other, for which each goes half of the way.
        self._others = np.concatenate([body, self._fore])
        self._rounding = np.concatenate([rounding, self._thickness])
        core = self._reach[:, None] * (np.arange(3) == self._along[:, None])
        self._core = np.concatenate([model.geom_aabb[body, 3:] - rounding[:, None], core])
        self._part = np.repeat([1.0, 0.5], [len(body), len(self._fore)])
        legs = np.concatenate([_path(model, int(foot)) for foot in robot.foot_ids])
        self._legs = np.isin(model.geom_bodyid[self._others], legs[legs != robot.torso_id])
        meet = np.array([[_meet(model, int(a), int(b)) for b in self._others] for a in self._fore], dtype=bool)
        self._meet = meet.reshape(len(self._fore), len(self._others))
        self._meet[:, len(body) :] &= self._side[:, None] != self._side
        self.kept = _LEAST * float(chain.lengths.sum(axis=1).mean())
        far = np.linalg.norm(self._core, axis=1) + self._rounding
        within = (self._reach + self._thickness)[:, None] + far + self.kept
        self._within = np.where(self._meet, within, 0.0) ** 2

    def nearest(self, q: Float) -> Approach:
        """The nearest approach of each arm at joint angles (R, n) [rad]."""
        rows, count = len(q), self.joints.shape[1]
        centres, turned, axes, anchors = self._poses(q)
        split = len(self._fore)
        away = centres[:, :split, None] - centres[:, None, split:]
        pairs = np.nonzero(np.einsum("rfox,rfox->rfo", away, away) < self._within)
        row, fore, other = pairs
        missing, aside = np.zeros((2, rows, 2)), np.zeros((rows, 2))
        way, lever = np.zeros((2, rows, 2, 3)), np.zeros((2, rows, 2, count, 3))
        if not len(row):
            return Approach(missing, way, aside, lever)
        along = turned[row, fore, :, self._along[fore]] * self._reach[fore, None]
        steps = np.linspace(-1.0, 1.0, _POINTS)
        points = away[pairs][:, None] + steps[:, None] * along[:, None]
        frame = turned[row, split + other]
        local = points @ frame
        core = self._core[other][:, None]
        beyond = np.abs(local) - core
        outside = np.maximum(beyond, 0.0)
        length = np.sqrt(np.einsum("npx,npx->np", outside, outside))
        signed = np.where(length > 0.0, length, beyond.max(axis=-1))
        kept = self.kept + self._thickness[fore] + self._rounding[other]
        lacks = kept[:, None] - signed
        deepest = lacks.argmax(axis=1)
        found = np.flatnonzero(lacks.max(axis=1) > 0.0)
        if not len(found):
            return Approach(missing, way, aside, lever)
        # Of each kind, row and arm the deepest: ascending, so that it is written last.
        found = found[np.argsort(lacks[found, deepest[found]])]
        at, row, fore, other = deepest[found], row[found], fore[found], other[found]
        side, kind = self._side[fore], self._legs[other].astype(int)
        local, beyond, outside = local[found, at], beyond[found, at], outside[found, at]
        inside = length[found, at] == 0.0
        out = np.where(inside[:, None], (beyond == beyond.max(axis=1, keepdims=True)).astype(float), outside)
        out *= np.sign(local) / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
        out = np.einsum("nij,nj->ni", frame[found], out)
        missing[kind, row, side], way[kind, row, side] = self._part[other] * lacks[found, at], out
        # Outward until beside the leg: the rest of the distance is kept ahead, behind, above or below.
        gap = signed[found, at, None] * out
        across = gap[:, 1] * (1.0 - 2.0 * side)
        rest = np.sum(gap * gap, axis=1) - across**2
        moves = np.sqrt(np.maximum(kept[found] ** 2 - rest, 0.0)) - across
        leg = kind == LEG
        aside[row[leg], side[leg]] = moves[leg]
        point = centres[row, fore] + steps[at, None] * (
            turned[row, fore, :, self._along[fore]] * self._reach[fore, None]
        )
        lever[kind, row, side] = np.cross(axes[row, side], point[:, None] - anchors[row, side]) * self._turns[fore]
        return Approach(missing, way, aside, lever)

    def _poses(self, q: Float) -> tuple[Float, Float, Float, Float]:
        """Boxes around the shapes and joints of the arms, seen from the torso.

        Returns:
            Centres (R, G, 3) [m] and rotations (R, G, 3, 3) of forearms and others, axes and anchors of the arm joints,
            (R, 2, m, 3) each.
        """
        model, data, rows = self._model, self._data, len(q)
        lines = np.zeros((rows, model.nq))
        lines[:, 3], lines[:, self._robot.qpos_address] = 1.0, q
        xpos, xmat = np.empty((rows, model.ngeom, 3)), np.empty((rows, model.ngeom, 9))
        xaxis, xanchor = np.empty((rows, model.njnt, 3)), np.empty((rows, model.njnt, 3))
        # Views, looked up once, as in `RobotDynamics`.
        qpos, kinematics = data.qpos, mujoco.mj_kinematics
        positions, rotations, axes, anchors = data.geom_xpos, data.geom_xmat, data.xaxis, data.xanchor
        for k, line in enumerate(lines):
            qpos[:] = line
            kinematics(model, data)
            xpos[k], xmat[k], xaxis[k], xanchor[k] = positions, rotations, axes, anchors
        geoms = np.concatenate([self._fore, self._others])
        turned = xmat[:, geoms].reshape(rows, len(geoms), 3, 3)
        centres = xpos[:, geoms] + np.einsum("rgij,gj->rgi", turned, model.geom_aabb[geoms, :3])
        return centres, turned, xaxis[:, self._ids], xanchor[:, self._ids]


def _meet(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Whether two shapes can touch: MuJoCo leaves out those of a body and its parent, and pairs that a model names."""
    a, b = sorted(int(model.body_weldid[model.geom_bodyid[geom]]) for geom in (one, other))
    if a == b or int(model.body_weldid[model.body_parentid[b]]) == a:
        return False
    bodies = sorted(int(model.geom_bodyid[geom]) for geom in (one, other))
    masks = (
        model.geom_contype[one] & model.geom_conaffinity[other],
        model.geom_contype[other] & model.geom_conaffinity[one],
    )
    return any(masks) and (bodies[0] << 16) + bodies[1] not in model.exclude_signature


def _path(model: mujoco.MjModel, body: int) -> Int:
    """A body and those that it hangs on, up to the root, (K,)."""
    path = []
    while body > 0:
        path.append(body)
        body = int(model.body_parentid[body])
    return np.array(path, dtype=np.int64)
