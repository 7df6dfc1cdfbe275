"""`ArmDistance`: how near the forearms come to the rest of the robot, and which way is out, at any joint angles.

Forearms are capsules of which a few points are taken, the rest of the body rounded boxes: capsules and spheres as they
are, other shapes by the box around them. One compiled call for all rows, after one of MuJoCo's kinematics a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import FLOAT, FLOATS, INTS, compiled, fields, packed, part
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
        ids = np.array([[model.joint(name).id for name in side] for side in names[self.joints]])
        moved = model.jnt_bodyid[ids]
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        solid = np.flatnonzero(solid & (model.geom_bodyid > 0))
        # Which joints of which arm move a shape, (G, 2, m).
        paths = [np.isin(moved, _path(model, int(model.geom_bodyid[geom]))) for geom in solid]
        turned = np.array(paths, dtype=bool).reshape(-1, *moved.shape)
        of_arm = turned[:, :, chain.fore_joint].any(axis=1)
        fore, body = solid[of_arm], solid[~turned.any(axis=(1, 2))]
        side = turned[of_arm, :, 0].argmax(axis=1)
        # Forearms as capsules along the longest edge of their box, the rest as rounded boxes.
        half = model.geom_aabb[fore, 3:]
        along, thickness = half.argmax(axis=1), np.sort(half, axis=1)[:, 1]
        reach = half.max(axis=1) - thickness
        round_ = np.isin(model.geom_type[body], (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE))
        rounding = np.where(round_, model.geom_size[body, 0], 0.0)
        # What forearms keep clear of: the rest of the body, and each other, for which each goes half of the way.
        others, rounding = np.concatenate([body, fore]), np.concatenate([rounding, thickness])
        core = np.concatenate([model.geom_aabb[body, 3:], reach[:, None] * (np.arange(3) == along[:, None])])
        core[: len(body)] -= rounding[: len(body), None]
        legs = np.concatenate([_path(model, int(foot)) for foot in robot.foot_ids])
        meet = np.array([[_meet(model, int(a), int(b)) for b in others] for a in fore], dtype=bool)
        meet = meet.reshape(len(fore), len(others))
        meet[:, len(body) :] &= side[:, None] != side
        self.kept = _LEAST * float(chain.lengths.sum(axis=1).mean())
        within = (reach + thickness)[:, None] + np.linalg.norm(core, axis=1) + rounding + self.kept
        self._shapes = packed(
            _Shapes,
            fore=fore,
            others=others,
            centre=model.geom_aabb[:, :3],
            side=side,
            along=along,
            reach=reach,
            thickness=thickness,
            turns=turned[of_arm, side].astype(float),
            core=core,
            rounding=rounding,
            part=np.repeat([1.0, 0.5], [len(body), len(fore)]),
            kind=np.where(np.isin(model.geom_bodyid[others], legs[legs != robot.torso_id]), LEG, REST),
            within=np.where(meet, within, 0.0) ** 2,
            joints=ids,
            kept=self.kept,
        )

    def nearest(self, q: Float) -> Approach:
        """The nearest approach of each arm at joint angles (R, n) [rad]."""
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
        return Approach(*_nearest(self._shapes, xpos, xmat, xaxis, xanchor))


class _Shapes(NamedTuple):
    """Forearms, and what they keep clear of: the rest of the body and each other.

    Attributes:
        fore, others: shapes of the model, (F,) and (O,).
        centre: of the box around each shape of the model, in its frame, (G, 3) [m].
        side: of the arm of each forearm, (F,).
        along: edge of its box along which it is a capsule, (F,).
        reach: half of the capsule's length without its ends, (F,) [m]; thickness: its radius, (F,) [m].
        turns: 1 where a joint of its arm moves it, (F, m).
        core, rounding: half sizes and radius of the rounded boxes, (O, 3) [m], (O,) [m].
        part: of what is missing, which a forearm must go, (O,).
        kind: `REST` or `LEG`, (O,).
        within: squared distance of their centres within which a pair is looked at, (F, O) [m²]; 0: never.
        joints: of both arms, in the model, (2, m).
        kept: distance that forearms keep [m].
    """

    fore: Int
    others: Int
    centre: Float
    side: Int
    along: Int
    reach: Float
    thickness: Float
    turns: Float
    core: Float
    rounding: Float
    part: Float
    kind: Int
    within: Float
    joints: Int
    kept: float


@part
def _centre(shapes: _Shapes, geom: int, xpos: Float, xmat: Float, out: Float) -> None:
    """Write the centre of the box around a shape (3,) [m]."""
    for i in range(3):
        out[i] = xpos[geom, i]
        for j in range(3):
            out[i] += xmat[geom, 3 * i + j] * shapes.centre[geom, j]


@compiled(
    fields(
        _Shapes,
        *[INTS[1]] * 2,
        FLOATS[2],
        *[INTS[1]] * 2,
        *[FLOATS[1]] * 2,
        *[FLOATS[2]] * 2,
        *[FLOATS[1]] * 2,
        INTS[1],
        FLOATS[2],
        INTS[2],
        FLOAT,
    ),
    *[FLOATS[3]] * 4,
)
def _nearest(
    shapes: _Shapes, xpos: Float, xmat: Float, xaxis: Float, xanchor: Float
) -> tuple[Float, Float, Float, Float]:
    """Fields of `Approach`, at shapes (R, G, 3) and (R, G, 9) and joints (R, J, 3) as MuJoCo has them."""
    rows, count = len(xpos), shapes.joints.shape[1]
    missing, aside = np.zeros((2, rows, 2)), np.zeros((rows, 2))
    way, lever = np.zeros((2, rows, 2, 3)), np.zeros((2, rows, 2, count, 3))
    fore, other, point, beyond = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    local, out = np.empty(3), np.empty(3)
    deepest = np.zeros((2, rows, 2))
    for row in range(rows):
        for f in range(len(shapes.fore)):
            _centre(shapes, shapes.fore[f], xpos[row], xmat[row], fore)
            side, own = shapes.side[f], xmat[row, shapes.fore[f]]
            for o in range(len(shapes.others)):
                if shapes.within[f, o] <= 0.0:
                    continue
                _centre(shapes, shapes.others[o], xpos[row], xmat[row], other)
                apart = (fore[0] - other[0]) ** 2 + (fore[1] - other[1]) ** 2 + (fore[2] - other[2]) ** 2
                if apart >= shapes.within[f, o]:
                    continue
                frame, kind = xmat[row, shapes.others[o]], shapes.kind[o]
                kept = shapes.kept + shapes.thickness[f] + shapes.rounding[o]
                for step in range(_POINTS):
                    share = (2.0 * step / (_POINTS - 1) - 1.0) * shapes.reach[f]
                    for i in range(3):
                        point[i] = fore[i] + share * own[3 * i + shapes.along[f]]
                    outside, farthest = 0.0, -np.inf
                    for i in range(3):
                        local[i] = 0.0
                        for j in range(3):
                            local[i] += frame[3 * j + i] * (point[j] - other[j])
                        beyond[i] = abs(local[i]) - shapes.core[o, i]
                        outside += max(beyond[i], 0.0) ** 2
                        farthest = max(farthest, beyond[i])
                    outside = math.sqrt(outside)
                    signed = outside if outside > 0.0 else farthest
                    lacks = kept - signed
                    if lacks <= deepest[kind, row, side]:
                        continue
                    deepest[kind, row, side] = lacks
                    missing[kind, row, side] = shapes.part[o] * lacks
                    length = 0.0
                    for i in range(3):
                        out[i] = max(beyond[i], 0.0) if outside > 0.0 else (1.0 if beyond[i] == farthest else 0.0)
                        length += out[i] ** 2
                    length = max(math.sqrt(length), 1e-9)
                    for i in range(3):
                        out[i] *= np.sign(local[i]) / length
                    for i in range(3):
                        way[kind, row, side, i] = (
                            frame[3 * i] * out[0] + frame[3 * i + 1] * out[1] + frame[3 * i + 2] * out[2]
                        )
                    if kind == LEG:
                        # Outward until beside the leg: the rest of the distance is kept ahead, behind, above or below.
                        across = signed * way[kind, row, side, 1] * (1.0 - 2.0 * side)
                        rest = -(across**2)
                        for i in range(3):
                            rest += (signed * way[kind, row, side, i]) ** 2
                        aside[row, side] = math.sqrt(max(kept**2 - rest, 0.0)) - across
                    for k in range(count):
                        axis, anchor = xaxis[row, shapes.joints[side, k]], xanchor[row, shapes.joints[side, k]]
                        x, y, z = point[0] - anchor[0], point[1] - anchor[1], point[2] - anchor[2]
                        moved = shapes.turns[f, k]
                        lever[kind, row, side, k, 0] = moved * (axis[1] * z - axis[2] * y)
                        lever[kind, row, side, k, 1] = moved * (axis[2] * x - axis[0] * z)
                        lever[kind, row, side, k, 2] = moved * (axis[0] * y - axis[1] * x)
    return missing, way, aside, lever


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
