"""`track`: the simulated human follows a reference by a time-varying linear-quadratic regulator (LQR).

1. Along the reference the equations of motion are linearised at every frame, by MuJoCo's finite differences, with the
   feet tied to the floor where the reference loads them: x' = A x + B u, x the deviation of positions and velocities.
2. Backwards in time, the Riccati equation gives the cost-to-go x' P x of every frame.
3. Forwards, every step of simulation minimises

       u' R u + x⁺' P x⁺,   x⁺ = x⁰ + B u,   |torque| <= strength, |assistance| <= its bound, contact forces >= 0

   where x⁰ is the state that the reference's torques would lead to, and B comes from the contacts as they are. Without
   the inequalities and with the reference's contacts this is the LQR's feedback u = -K x.

The third step is why walking works: gains for a planted foot, applied to one that has not landed, throw the leg.
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.simulation.reference import Reference, corner_positions
from flexmotion.biomechanics.simulation.tracking_model import CORNERS, TrackingModel
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

TIED = 0.05
"""Least share of body weight on a foot that is tied to the floor for the linearisation."""

SPREAD = 0.1
"""Distance of the tied points from the centre of pressure, as a share of that of the sole's corners.

Tied at its corners, a foot could pull at the floor: the regulator would rely on moments that no foot can give.
"""

EPSILON = 1e-6
"""Step of the finite differences."""


@dataclass(frozen=True)
class TrackingCost:
    """Deviations that cost as much as one another.

    Attributes:
        position, rotation: of the pelvis [m, rad].
        joint: angle [rad].
        velocity, spin: of the pelvis [m/s, rad/s].
        joint_speed: [rad/s].
        foot, foot_speed: of the corners of the soles [m, m/s]: where and when a foot lands.
        torque: share of a joint's strength, in addition to the reference's torque.
        assistance: share of its bound.
        last: weight of the deviation at the end of the reference, in steps of simulation.
    """

    position: float = 0.1
    rotation: float = 0.05
    joint: float = 0.1
    velocity: float = 1.0
    spin: float = 1.0
    joint_speed: float = 1.5
    foot: float = 0.02
    foot_speed: float = 0.3
    torque: float = 0.4
    assistance: float = 2.0
    last: float = 30.0


COST = TrackingCost()


@dataclass(frozen=True)
class Tracked:
    """A simulated motion, a row per step of simulation (S <= N).

    Attributes:
        qpos: of the tracking model, (S, 39).
        deviation: from the reference's positions, (S, 32) [m, rad].
        control: torques and assistance, in the order of the degrees of freedom, (S, 32) [N, N·m].
        wrenches: ground reaction on left and right foot about the world's origin, (S, 2, 6) [N, N·m].
        push: force on the torso, (S, 3) [N].
        penetration: greatest depth of a contact, (S,) [m].
        slip: greatest speed along the floor of a contact that carries a tenth of body weight, (S,) [m/s].
    """

    qpos: Float
    deviation: Float
    control: Float
    wrenches: Float
    push: Float
    penetration: Float
    slip: Float

    def __len__(self) -> int:
        return len(self.qpos)


def track(
    tracked: TrackingModel, followed: Reference, push: Float, cost: TrackingCost = COST, farthest: float = 0.5
) -> Tracked:
    """Simulate the human that follows a reference.

    Args:
        tracked: the human.
        followed: the reference.
        push: force on the torso that the human does not expect, (N, 3) [N].
        cost: of deviations.
        farthest: distance of the pelvis from the reference at which the simulation ends [m].
    """
    to_go, effort = _cost_to_go(tracked, followed, cost)
    model, data = tracked.model, mujoco.MjData(tracked.model)
    data.qpos[:], data.qvel[:] = followed.qpos[0], followed.qvel[0]
    torso, contacts = model.body("torso").id, _ContactReader(tracked)
    found: list[tuple[Float, ...]] = []
    away = np.zeros(model.nv)
    for step in range(len(followed.qpos) - 1):
        data.xfrc_applied[torso, :3] = push[step]
        mujoco.mj_differentiatePos(model, away, 1.0, followed.qpos[step], data.qpos)
        if not np.isfinite(away).all() or np.abs(away[:3]).max() > farthest:
            break
        at = min(step // followed.substeps + 1, len(followed) - 1)
        control = _control(tracked, data, followed, step, to_go[at], effort)
        state = data.qpos.copy()
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        found.append((state, away.copy(), control, *contacts.read(data)))
    qpos, deviation, control, wrenches, depth, slip = (np.array(column) for column in zip(*found, strict=True))
    return Tracked(qpos, deviation, control, wrenches, push[: len(found)], depth, slip)


def _control(
    tracked: TrackingModel, data: mujoco.MjData, followed: Reference, step: int, to_go: Float, effort: Float
) -> Float:
    """Torques and assistance of one step of simulation, (32,)."""
    model, count = tracked.model, tracked.model.nv
    planned, interval = followed.torques[step], tracked.model.opt.timestep
    data.ctrl[:] = planned
    mujoco.mj_forward(model, data)
    velocity = data.qvel + interval * data.qacc
    position = data.qpos.copy()
    mujoco.mj_integratePos(model, position, velocity, interval)
    ahead = np.empty(2 * count)
    mujoco.mj_differentiatePos(model, ahead[:count], 1.0, followed.qpos[step + 1], position)
    ahead[count:] = velocity - followed.qvel[step + 1]

    inertia = np.zeros((count, count))
    mujoco.mj_fullM(model, data, inertia)
    touching = data.efc_state == mujoco.mjtConstraintState.mjCNSTRSTATE_QUADRATIC
    rows = data.efc_J.reshape(-1, count)[touching]
    stiff = data.efc_D[touching, None] * rows
    response = np.linalg.inv(inertia + rows.T @ stiff)
    moved = np.concatenate([interval**2 * response, interval * response])

    weighted = to_go @ moved
    hessian = effort + moved.T @ weighted
    linear = weighted.T @ ahead
    scale = 1 / np.sqrt(np.diag(hessian))
    bounds = tracked.limits / scale
    forces = data.efc_force[touching]
    solution, _, status, _ = daqp.solve(
        np.ascontiguousarray((hessian + hessian.T) / 2 * scale[:, None] * scale),
        linear * scale,
        np.ascontiguousarray(-stiff @ response * scale),
        np.concatenate([bounds - planned / scale, np.full(len(forces), 1e30)]),
        np.concatenate([-bounds - planned / scale, -forces]),
        np.zeros(count + len(forces), np.int32),
    )
    if status < 1:
        # No control keeps every contact: they are left free.
        solution = -np.linalg.solve(hessian, linear) / scale
    result: Float = np.clip(planned + solution * scale, -tracked.limits, tracked.limits)
    return result


def _cost_to_go(tracked: TrackingModel, followed: Reference, cost: TrackingCost) -> tuple[Float, Float]:
    """Matrices P of every frame, (T, 64, 64), and the cost R of controls, (32, 32)."""
    count = tracked.model.nv
    joints = count - 6
    deviations = [*3 * [cost.position], *3 * [cost.rotation], *joints * [cost.joint]]
    speeds = [*3 * [cost.velocity], *3 * [cost.spin], *joints * [cost.joint_speed]]
    state = np.diag(np.array(deviations + speeds) ** -2.0)
    share = np.array([*6 * [cost.assistance], *joints * [cost.torque]])
    effort = np.diag((share * tracked.limits) ** -2.0)
    moved, pushed, soles = _linearised(tracked, followed)
    feet = np.zeros((2 * count, 2 * count))
    found = np.empty((len(followed), 2 * count, 2 * count))
    found[-1] = matrix = cost.last * state
    for frame in range(len(followed) - 1, 0, -1):
        for step in range(followed.substeps):
            # A frame's matrices hold for half a frame before and after it.
            at = frame if step < followed.substeps // 2 else frame - 1
            feet[:count, :count], feet[count:, count:] = soles[at] / cost.foot**2, soles[at] / cost.foot_speed**2
            weighted = matrix @ pushed[at]
            gain = np.linalg.solve(effort + pushed[at].T @ weighted, weighted.T @ moved[at])
            matrix = state + feet + moved[at].T @ (matrix @ (moved[at] - pushed[at] @ gain))
            matrix = (matrix + matrix.T) / 2
        found[frame - 1] = matrix
    return found, effort


def _linearised(tracked: TrackingModel, followed: Reference) -> tuple[Float, Float, Float]:
    """A, (T, 64, 64), and B, (T, 64, 32), of a step of simulation at every frame; Jᵀ J of the soles, (T, 32, 32)."""
    model, data = tracked.linear, mujoco.MjData(tracked.linear)
    count, frames = model.nv, len(followed)
    moved, pushed = np.zeros((frames, 2 * count, 2 * count)), np.zeros((frames, 2 * count, count))
    soles = np.zeros((frames, count, count))
    jacobian = np.zeros((3, count))
    for frame in range(frames):
        step = frame * followed.substeps
        data.qpos[:], data.qvel[:] = followed.qpos[step], followed.qvel[step]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for side, foot in enumerate(tracked.feet):
            for corner in corner_positions(tracked, data)[side]:
                mujoco.mj_jac(model, data, jacobian, None, corner, foot)
                soles[frame] += jacobian.T @ jacobian / CORNERS
        _tie(tracked, data, followed, frame)
        data.ctrl[:] = followed.torques[step]
        data.qacc_warmstart[:] = 0.0
        mujoco.mjd_transitionFD(model, data, EPSILON, False, moved[frame], pushed[frame], None, None)
    return moved, pushed, soles


def _tie(tracked: TrackingModel, data: mujoco.MjData, followed: Reference, frame: int) -> None:
    """Tie the loaded feet of a frame to the points where they are, around their centres of pressure."""
    model, weight = tracked.linear, tracked.body.mass * GRAVITY
    for side, foot in enumerate(tracked.feet):
        rotation, origin = data.xmat[foot].reshape(3, 3), data.xpos[foot]
        centre = rotation.T @ (followed.ground.centres[frame, side] - origin)
        centre = np.clip(centre, tracked.corners.min(axis=0), tracked.corners.max(axis=0))
        loaded = followed.ground.wrenches[frame, side, 2] > TIED * weight
        for number, corner in enumerate(tracked.corners):
            row, point = CORNERS * side + number, centre + SPREAD * (corner - centre)
            model.eq_data[row, :3], model.eq_data[row, 3:6] = point, origin + rotation @ point
            data.eq_active[row] = loaded


class _ContactReader:
    """Reads ground reaction, depth and slip of the last step of simulation."""

    def __init__(self, tracked: TrackingModel) -> None:
        model = tracked.model
        self._model = model
        self._side = {
            model.geom(f"corner_{name}_{number}").id: side
            for side, name in enumerate(SIDES)
            for number in range(CORNERS)
        }
        self._enough = 0.1 * tracked.body.mass * GRAVITY
        self._local = np.zeros(6)

    def read(self, data: mujoco.MjData) -> tuple[Float, Float, Float]:
        """Wrenches about the world's origin (2, 6), depth [m], slip [m/s]."""
        wrenches, depth, slip = np.zeros((2, 6)), 0.0, 0.0
        for number in range(data.ncon):
            contact = data.contact[number]
            mujoco.mj_contactForce(self._model, data, number, self._local)
            force = contact.frame.reshape(3, 3).T @ self._local[:3]
            side = self._side[contact.geom2 if contact.geom2 in self._side else contact.geom1]
            wrenches[side, :3] += force
            wrenches[side, 3:] += np.cross(contact.pos, force)
            depth = max(depth, -contact.dist)
            if self._local[0] > self._enough:
                # Rows of a friction pyramid: normal velocity plus and minus friction times tangential velocity.
                rows = data.efc_vel[contact.efc_address : contact.efc_address + 4]
                tangential = np.array([rows[0] - rows[1], rows[2] - rows[3]]) / (2 * contact.friction[0])
                slip = max(slip, float(np.linalg.norm(tangential)))
        return wrenches, np.array(depth), np.array(slip)
