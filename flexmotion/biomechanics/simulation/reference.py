"""`Reference`: what the simulated human tracks: a motion whose feet meet the floor, and the torques that it needs.

Recorded feet are up to some centimetres above or below the floor when they carry load, which a simulation would answer
with falls and impacts. The legs are adjusted so that the lowest corner of a loaded sole is on the floor, otherwise by
damped least squares that prefer the recorded angles.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from flexmotion.biomechanics.dynamics import Dynamics
from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.ground_reaction import GROUND, GroundReaction, GroundSettings, ground_reaction
from flexmotion.biomechanics.inverse_dynamics import effort
from flexmotion.biomechanics.segment_motion import SegmentMotion, segment_motion
from flexmotion.biomechanics.simulation.tracking_model import TrackingModel
from flexmotion.biomechanics.smoothing import CUTOFF, smoothing_spline
from flexmotion.biomechanics.sole import NEARNESS, Nearness, SolePoints, sole_grid, sole_points
from flexmotion.human.human_model import human_model
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

SAG = 1.5e-3
"""Depth to which a loaded corner is planted [m]: that of MuJoCo's contact under half of the body weight."""

STIFFNESS = 0.03
"""Weight of the recorded leg angles [m²/rad²]: 5° cost as much as half a centimetre at every corner of the sole."""

PLANTING_STEPS = 8
"""Gauss-Newton steps of the legs; after four, loaded soles were up to 8 mm above the floor, and the human fell over the
foot that was to carry a quarter of its weight."""

FURTHEST = 0.05
"""Farthest that the target of a loaded sole is moved on [m]."""

PELVIS_CUTOFF = 2.0
"""The pelvis follows the feet's correction below this frequency [Hz]; the legs do the rest."""

STRAIGHT = 0.05
"""Planting does not extend a knee beyond this angle, or beyond the recorded one [rad]."""


@dataclass(frozen=True)
class Floor:
    """Plane z = origin_z + slope · (xy - origin_xy).

    Attributes:
        slope: rise along x and y, (2,) [m/m].
        origin: a point of the plane, (3,) [m].
    """

    slope: Float
    origin: Float

    def height(self, points: Float) -> Float:
        """Height of the floor at points (..., 3), (...,) [m]."""
        found: Float = self.origin[2] + (points[..., :2] - self.origin[:2]) @ self.slope
        return found

    @property
    def normal(self) -> Float:
        """Unit vector out of the floor, (3,)."""
        vector = np.array([-self.slope[0], -self.slope[1], 1.0])
        found: Float = vector / np.linalg.norm(vector)
        return found


@dataclass(frozen=True)
class Reference:
    """A motion to track, T frames of `substeps` steps of simulation each, N = (T - 1) substeps + 1.

    Attributes:
        qpos, qvel: state of the tracking model, (N, 39) and (N, 32).
        torques: generalised forces that the motion needs beyond ground and known loads, (N, 32) [N, N·m]; those of the
            root are what the ground cannot give.
        ground: ground forces of the motion at the frames.
        substeps: steps of simulation per frame.
        floor: under the feet.
    """

    qpos: Float
    qvel: Float
    torques: Float
    ground: GroundReaction
    substeps: int
    floor: Floor

    def __len__(self) -> int:
        return len(self.ground.wrenches)


def corner_positions(tracked: TrackingModel, data: mujoco.MjData) -> Float:
    """Lowest points of the corners of left and right sole in the world, (2, 4, 3) [m]."""
    return np.array([data.xpos[foot] + tracked.corners @ data.xmat[foot].reshape(3, 3).T for foot in tracked.feet])


def reference(
    tracked: TrackingModel,
    found: Dynamics,
    floor: Floor,
    carried: Mapping[str, float],
    settings: GroundSettings = GROUND,
    nearness: Nearness = NEARNESS,
) -> Reference:
    """The reference of a motion on a floor.

    Args:
        tracked: the simulated human, with the masses that it carries.
        found: the motion on a level floor, with its ground forces.
        floor: to stand on.
        carried: point masses at segments [kg], known to the human.
        settings, nearness: of the quadratic programme for the ground forces.
    """
    motion = found.motion
    assert motion.contacts is not None
    nodes = _planted(tracked, found, floor)
    time = np.arange(len(nodes)) / motion.fps
    step = tracked.model.opt.timestep
    substeps = round(1 / (motion.fps * step))
    steps = (len(nodes) - 1) * substeps + 1
    curve = make_interp_spline(time, nodes, k=5)
    # One step before and after, for velocities and accelerations by central differences.
    qpos = _normalised(tracked, curve(np.arange(-1, steps + 1) * step))
    half = np.zeros((steps + 1, tracked.linear.nv))
    for at in range(steps + 1):
        mujoco.mj_differentiatePos(tracked.linear, half[at], step, qpos[at], qpos[at + 1])
    qpos, qvel, qacc = qpos[1:-1], (half[1:] + half[:-1]) / 2, np.diff(half, axis=0) / step

    planted = tracked.motion(qpos[::substeps], motion)
    segments = segment_motion(planted)
    loads = carried_loads(segments, tracked, carried)
    sole = _sole_on(floor, found, segments, nearness)
    ground = ground_reaction(
        segments,
        effort(segments, motion.body, loads),
        sole,
        segments.rotation[:, tracked.pelvis, :, 1],
        settings,
    )
    frames = slice(None, None, substeps)
    torques = _torques(tracked, qpos[frames], qvel[frames], qacc[frames], ground)
    return Reference(
        qpos=qpos,
        qvel=qvel,
        torques=make_interp_spline(time, torques, k=1)(np.arange(steps) * step),
        ground=ground,
        substeps=substeps,
        floor=floor,
    )


def carried_loads(
    segments: SegmentMotion, tracked: TrackingModel, carried: Mapping[str, float]
) -> tuple[ExternalLoad, ...]:
    """Forces of carried point masses on their segments: -m (a + g), in which their inertia counts."""
    index = human_model(tracked.body).body_index
    gravity = np.array([0.0, 0.0, GRAVITY])
    return tuple(
        ExternalLoad(name, -mass * (segments.acceleration[:, index[name]] + gravity)) for name, mass in carried.items()
    )


def _planted(tracked: TrackingModel, found: Dynamics, floor: Floor) -> Float:
    """Generalised positions with loaded soles on the floor, (T, 39)."""
    motion = found.motion
    assert motion.wrenches is not None and motion.contacts is not None
    model, data = tracked.linear, mujoco.MjData(tracked.linear)
    qpos = tracked.qpos(motion)
    corners = np.empty((len(qpos), 2, len(tracked.corners), 3))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        corners[frame] = corner_positions(tracked, data)
    lowest = corners[..., 2].min(axis=-1)
    rise = np.where(motion.contacts, -SAG - lowest, np.maximum(-lowest, 0.0))
    rise = smoothing_spline(rise, motion.fps, CUTOFF)
    share = np.maximum(motion.wrenches[..., 2], 0.0) / (motion.body.mass * GRAVITY) + 0.05
    pelvis = (rise * share).sum(axis=1) / share.sum(axis=1)
    # The level floor of the recording is at z = 0.
    targets = corners.copy()
    targets[..., 2] += rise[..., None] + floor.height(corners)
    recorded = qpos.copy()
    recorded[:, 2] += smoothing_spline(pelvis, motion.fps, PELVIS_CUTOFF) + floor.height(qpos[:, :3])
    # Within [0, 1]: a foot that is loaded from one frame to the next is not moved at once.
    loaded = np.clip(smoothing_spline(motion.contacts.astype(float), motion.fps, CUTOFF), 0.0, 1.0)
    rows = zip(recorded, targets, floor.height(targets), loaded, strict=True)
    # Soles that are lifted on a slope lose its track: standing, 58 % of the windows are tracked with it, all without.
    lifted = 0.0 if floor.slope.any() else FURTHEST
    return _smoothed(tracked, np.stack([_legs_to(tracked, data, *row, lifted) for row in rows]), motion.fps)


def _legs_to(
    tracked: TrackingModel,
    data: mujoco.MjData,
    recorded: Float,
    targets: Float,
    ground: Float,
    loaded: Float,
    lifted: float,
) -> Float:
    """Generalised positions whose sole corners are near targets, legs near the recorded ones.

    The lowest corner of a loaded sole comes to its target's height: recorded angles, which hold it back, are outweighed
    by moving the target on by what is left.

    Args:
        tracked: the simulated human.
        data: of its model; changed.
        recorded: generalised positions, (39,).
        targets: of the corners, (2, 4, 3) [m].
        ground: height of the floor at the targets, (2, 4) [m].
        loaded: how far each foot is, 0 to 1, (2,).
        lifted: farthest that the target is moved up [m].
    """
    model = tracked.linear
    knees = [int(model.joint(f"knee_flexion_{side}").qposadr[0]) for side in SIDES]
    jacobian, away = np.zeros((3, model.nv)), np.zeros(model.nv)
    data.qpos[:] = recorded
    wanted, shift = (targets[..., 2] - ground).min(axis=1), np.zeros(2)
    for _ in range(PLANTING_STEPS):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_differentiatePos(model, away, 1.0, recorded, data.qpos)
        corners, change = corner_positions(tracked, data), np.zeros(model.nv)
        shift += loaded * (wanted - (corners[..., 2] - ground).min(axis=1))
        shift = np.clip(shift, -FURTHEST, lifted)
        for side, foot in enumerate(tracked.feet):
            leg = _leg_dofs(tracked, side)
            rows = []
            for corner in corners[side]:
                mujoco.mj_jac(model, data, jacobian, None, corner, foot)
                rows.append(jacobian[:, leg].copy())
            stacked = np.concatenate(rows)
            error = (targets[side] + [0.0, 0.0, shift[side]] - corners[side]).ravel()
            normal = stacked.T @ stacked + STIFFNESS * np.eye(len(leg))
            change[leg] = np.linalg.solve(normal, stacked.T @ error - STIFFNESS * away[leg])
        mujoco.mj_integratePos(model, data.qpos, change, 1.0)
        data.qpos[knees] = np.maximum(data.qpos[knees], np.minimum(recorded[knees], STRAIGHT))
    return np.array(data.qpos)


def _leg_dofs(tracked: TrackingModel, side: int) -> list[int]:
    model, name = tracked.linear, SIDES[side]
    hip = int(model.joint(f"femur_{name}").dofadr[0])
    others = [int(model.joint(f"{joint}_{name}").dofadr[0]) for joint in ("knee_flexion", "ankle_dorsiflexion")]
    return [hip, hip + 1, hip + 2, *others]


def _smoothed(tracked: TrackingModel, qpos: Float, fps: float) -> Float:
    """Generalised positions without what planting added above the cut-off of the recording's filter."""
    for first in tracked.quaternions():
        qpos[:, first : first + 4] = continuous_quaternions(qpos[:, first : first + 4])
    return _normalised(tracked, smoothing_spline(qpos, fps, CUTOFF + 1.0))


def _normalised(tracked: TrackingModel, qpos: Float) -> Float:
    for first in tracked.quaternions():
        qpos[:, first : first + 4] /= np.linalg.norm(qpos[:, first : first + 4], axis=1, keepdims=True)
    return qpos


def _sole_on(floor: Floor, found: Dynamics, segments: SegmentMotion, nearness: Nearness) -> SolePoints:
    """Sole points of the planted motion on the floor, as near to stance as those of the recorded motion."""
    body = found.motion.body
    index = human_model(body).body_index
    feet = [index[f"calcaneus_{side}"] for side in SIDES]
    position = segments.position[:, feet, None] + np.einsum(
        "tsij,pj->tspi", segments.rotation[:, feet], sole_grid(body)
    )
    position[..., 2] = floor.height(position)
    return SolePoints(position, sole_points(body, found.segments, found.motion.fps, nearness).nearness)


def _torques(tracked: TrackingModel, qpos: Float, qvel: Float, qacc: Float, ground: GroundReaction) -> Float:
    """Inverse dynamics of the tracking model less the ground forces, (T, 32)."""
    model, data = tracked.linear, mujoco.MjData(tracked.linear)
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    torques = np.empty((len(qpos), model.nv))
    for frame in range(len(qpos)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[frame], qvel[frame], qacc[frame]
        mujoco.mj_inverse(model, data)
        torques[frame] = data.qfrc_inverse
        for side, foot in enumerate(tracked.feet):
            mujoco.mj_jac(model, data, linear, angular, ground.centres[frame, side], foot)
            wrench = ground.wrenches[frame, side]
            torques[frame] -= linear.T @ wrench[:3] + angular.T @ wrench[3:]
    return torques
