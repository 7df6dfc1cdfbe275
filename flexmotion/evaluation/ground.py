"""Judge of ground forces: residual and zero-moment point by MuJoCo's inverse dynamics, on motion differentiated anew.

Independent of the code that makes the forces (`biomechanics.segment_motion`, `inverse_dynamics`): generalised positions
are interpolated by splines of fifth order instead of differentiating segments by differences, and MuJoCo's inverse
dynamics gives the root's generalised force, with the ground's wrenches applied to the feet and without.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.ground_reaction import GROUND
from flexmotion.biomechanics.sole import REACH, sole_grid
from flexmotion.human.human_model import HumanModel, human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOADED = 0.1
"""Share of body weight from which a frame, or a foot, counts as loaded."""

TOLERANCE = 0.005
"""Distance by which a centre of pressure may be outside the sole [m], and friction above its limit, relative to it."""

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
_OUTWARD = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])


@dataclass(frozen=True)
class GroundJudgement:
    """What the ground's forces leave of a motion, and whether a ground can give them.

    Attributes:
        residual: force [body weights] and moment about the pelvis [body weights x m] on the root, (T, 6).
        beyond: distance of the zero-moment point from the region under the soles, negative within it, (T,) [m].
        loaded: whether a foot is within reach of the floor and the motion needs it, (T,).
        impossible: whether a foot's force pulls, slips, or acts beside its sole, (T, 2).
        borne: whether a foot carries load, (T, 2).
    """

    residual: Float
    beyond: Float
    loaded: Flags
    impossible: Flags
    borne: Flags

    @property
    def figures(self) -> dict[str, float]:
        """Means over all frames but `EDGE` at each end, where accelerations are extrapolated.

        Keys: `residual_force` [% of body weight], `residual_moment` [% of body weight x m], their 95th percentiles
        `residual_force_p95`, `residual_moment_p95`; `zmp_outside`, share of loaded frames whose zero-moment point is
        outside the soles [%]; `ground_impossible`, share of loaded feet with a force that no ground gives [%].

        Raises:
            ValueError: too few frames.
        """
        if len(self.beyond) <= 2 * EDGE:
            raise ValueError(f"physics metrics need more than {2 * EDGE} frames, got {len(self.beyond)}")
        inner = slice(EDGE, -EDGE)
        force, moment = (100 * np.linalg.norm(self.residual[inner, part], axis=1) for part in (slice(3), slice(3, 6)))
        loaded, borne = self.loaded[inner], self.borne[inner]
        outside, impossible = self.beyond[inner][loaded] > 0, self.impossible[inner][borne]
        return {
            "residual_force": float(force.mean()),
            "residual_force_p95": float(np.quantile(force, 0.95)),
            "residual_moment": float(moment.mean()),
            "residual_moment_p95": float(np.quantile(moment, 0.95)),
            "zmp_outside": 100 * float(outside.mean()) if len(outside) else 0.0,
            "ground_impossible": 100 * float(impossible.mean()) if len(impossible) else 0.0,
        }


def judge_ground(motion: Motion) -> GroundJudgement:
    """Judge the ground forces of a motion.

    Args:
        motion: with wrenches and centres of pressure, at least 6 frames.

    Raises:
        ValueError: it has none.
    """
    if motion.wrenches is None or motion.pressure_centres is None:
        raise ValueError("judging ground forces needs wrenches and centres of pressure")
    human, weight = human_model(motion.body), motion.body.mass * GRAVITY
    model, data = human.model, mujoco.MjData(human.model)
    feet = [human.body_index[f"calcaneus_{side}"] for side in SIDES]
    frames = len(motion)
    needed, left = np.empty((frames, 6)), np.empty((frames, 6))
    soles = np.empty((frames, 2, len(sole_grid(motion.body)), 3))
    for frame, (qpos, qvel, qacc) in enumerate(zip(*_differentiated(human, motion), strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(model, data)
        given = np.zeros(model.nv)
        for side, foot in enumerate(feet):
            wrench, place = motion.wrenches[frame, side], motion.pressure_centres[frame, side]
            mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], place, foot, given)
            soles[frame, side] = data.xpos[foot] + sole_grid(motion.body) @ data.xmat[foot].reshape(3, 3).T
        pelvis = data.xmat[human.body_index["pelvis"]].reshape(3, 3)
        # The free joint's moment is in the axes of the pelvis, about its origin.
        moment = pelvis @ data.qfrc_inverse[3:6] + np.cross(qpos[:3], data.qfrc_inverse[:3])
        needed[frame] = np.concatenate([data.qfrc_inverse[:3], moment])
        left[frame] = (data.qfrc_inverse - given)[:6]
    lift = np.maximum(needed[:, 2], LOADED * weight)
    point = np.stack([-needed[:, 4], needed[:, 3]], axis=1) / lift[:, None]
    reaches = soles[..., 2] < REACH
    beyond = _beyond(point, soles[..., :2].reshape(frames, -1, 2), reaches.reshape(frames, -1))
    borne = motion.wrenches[..., 2] > LOADED * weight
    return GroundJudgement(
        residual=left / weight,
        beyond=beyond,
        loaded=reaches.any(axis=(1, 2)) & (needed[:, 2] > LOADED * weight),
        impossible=_impossible(motion.wrenches, motion.pressure_centres, soles[..., :2], reaches),
        borne=borne,
    )


def _differentiated(human: HumanModel, motion: Motion) -> tuple[Float, Float, Float]:
    """Generalised positions (T, 33), velocities and accelerations (T, 32) by interpolating splines."""
    times = np.arange(len(motion)) / motion.fps
    qpos = human.qpos(motion)
    spline = make_interp_spline(times, qpos, k=5)
    first, second = spline(times, 1), spline(times, 2)
    turn = qpos[:, 3:7]
    # The angular velocity in the body's axes is twice the vector part of conj(q) q'.
    spin, change = (_vector_of_product(turn, rate) for rate in (first[:, 3:7], second[:, 3:7]))
    qvel = np.concatenate([first[:, :3], spin, first[:, 7:]], axis=1)
    return qpos, qvel, np.concatenate([second[:, :3], change, second[:, 7:]], axis=1)


def _vector_of_product(turn: Float, rate: Float) -> Float:
    """2 vec(conj(q) r) of quaternions w x y z, (T, 3)."""
    found: Float = 2.0 * (turn[:, :1] * rate[:, 1:] - rate[:, :1] * turn[:, 1:] - np.cross(turn[:, 1:], rate[:, 1:]))
    return found


def _beyond(point: Float, soles: Float, reaches: Flags) -> Float:
    """Distance of points (T, 2) from the convex hull of the sole points that reach the floor, (T,) [m]."""
    bounds = np.where(reaches[..., None], soles @ _OUTWARD, -np.inf).max(axis=1)
    found: Float = (point @ _OUTWARD - bounds).max(axis=1)
    return found


def _impossible(wrenches: Float, centres: Float, soles: Float, reaches: Flags) -> Flags:
    """Forces that no ground gives: see `GroundJudgement`."""
    vertical = wrenches[..., 2]
    slips = np.linalg.norm(wrenches[..., :2], axis=-1) > (1 + TOLERANCE) * GROUND.friction * np.maximum(vertical, 0.0)
    beside = np.stack([_beyond(centres[:, side, :2], soles[:, side], reaches[:, side]) for side in (0, 1)], axis=1)
    return (vertical < 0) | slips | (beside > TOLERANCE)
