"""`perturbed`: a motion as the simulated human does it under a push, with a load, on a slope; with its forces.

All values come from the simulation, low-passed like every motion of a set, so that the equations of motion hold between
them. A low-passed impact pulls at the floor beside its peak, and moves the centre of pressure out of the sole: forces
are projected onto what a foot can exert. What that takes away and the assistance at the root are the residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.dynamics import CONTACT_SHARE, Dynamics, dynamics
from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.force_error import BAND, charged, force_error, over_impact
from flexmotion.biomechanics.ground_reaction import GROUND, NO_FORCE, GroundSettings
from flexmotion.biomechanics.inverse_dynamics import effort, joint_torques
from flexmotion.biomechanics.segment_motion import segment_motion
from flexmotion.biomechanics.simulation.perturbation import (
    LOADED_SEGMENTS,
    PERTURBATIONS,
    Perturbation,
    PerturbationRanges,
    drawn,
)
from flexmotion.biomechanics.simulation.reference import Floor, carried_loads, reference
from flexmotion.biomechanics.simulation.tracking import COST, Tracked, TrackingCost, track
from flexmotion.biomechanics.simulation.tracking_model import TRACKING, TrackingModel, TrackingSettings, tracking_model
from flexmotion.biomechanics.smoothing import CUTOFF, smoothing_spline
from flexmotion.biomechanics.sole import COLUMNS, NEARNESS, POINTS, Nearness, sole_grid
from flexmotion.biomechanics.sole import REACH as SOLE_REACH
from flexmotion.configs.errors import FlexMotionError
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

WINDOW_S = 0.5
"""Length of the windows that are judged [s]."""

PULL = 0.02
"""Greatest force towards the floor, before projection, of a foot in a good frame [body weights]."""


class TrackingFailedError(FlexMotionError):
    """The simulated human fell, or lost the motion, before it recovered from the perturbation.

    Attributes:
        windows: whether each window was tracked.
    """

    def __init__(self, message: str, windows: Sequence[bool]) -> None:
        super().__init__(message)
        self.windows = tuple(windows)


@dataclass(frozen=True)
class WindowLimits:
    """Greatest values of a window in which the human tracks the motion.

    Attributes:
        position: root mean square distance of the pelvis from the reference [m].
        tilt: greatest rotation of the pelvis from the reference [rad].
        joints: root mean square deviation of joint angles [rad].
        assisted: share of the steps in which a component of the assistance is at its bound.
    """

    position: float = 0.15
    tilt: float = 0.5
    joints: float = 0.25
    assisted: float = 0.9


WINDOW_LIMITS = WindowLimits()


@dataclass(frozen=True)
class PerturbedMotion:
    """A tracked motion.

    Attributes:
        dynamics: motion, forces and loads at the frame rate; its `residual` is the low-passed assistance and what the
            projection took from the ground forces.
        pulled: whether the force of a foot pulled at the floor by over `PULL` before projection, (T,); no good frame.
        perturbation: push, carried load and slope.
        assistance: largest force on the root in each frame, and moment per metre of leg, (T, 2) [body weights].
        windows: whether each window of the whole simulation was tracked.
        simulation: every step of the frames that were kept.
        applied: joint torques of the actuators, low-passed, in the order of the tracking model, (T, 26) [N·m].
    """

    dynamics: Dynamics
    pulled: NDArray[np.bool_]
    perturbation: Perturbation
    assistance: Float
    windows: NDArray[np.bool_]
    simulation: Tracked
    applied: Float

    def description(self) -> dict[str, Any]:
        """For the entry of a set's manifest."""
        mean, largest = self.assistance.mean(axis=0), self.assistance.max(axis=0)
        return self.perturbation.description() | {
            "assistance": {
                "force_mean_bw": round(float(mean[0]), 5),
                "force_max_bw": round(float(largest[0]), 5),
                "moment_mean_bw_leg": round(float(mean[1]), 5),
                "moment_max_bw_leg": round(float(largest[1]), 5),
            },
        }


def perturbed(
    motion: Motion,
    seed: int,
    ranges: PerturbationRanges = PERTURBATIONS,
    *,
    perturbation: Perturbation | None = None,
    cutoff: float = CUTOFF,
    cost: TrackingCost = COST,
    settings: TrackingSettings = TRACKING,
    limits: WindowLimits = WINDOW_LIMITS,
    ground: GroundSettings = GROUND,
    nearness: Nearness = NEARNESS,
) -> PerturbedMotion:
    """Simulate the motion of a human under a perturbation.

    Args:
        motion: kinematics, and a body with the human's mass.
        seed: of the perturbation.
        ranges: of the perturbation.
        perturbation: instead of one drawn from the seed.
        cutoff: of the low-pass filter [Hz].
        cost: of deviations from the motion.
        settings: of the simulation.
        limits: of a tracked window; the motion ends a window before the first that is not.
        ground, nearness: of the ground forces of the reference.

    Raises:
        TrackingFailedError: the motion would end before `ranges.settle_s` after the push, or has no whole window.
    """
    count = min(len(motion), round(ranges.longest_s * motion.fps) + 1)
    found = dynamics(motion[:count], cutoff, ground, nearness)
    if perturbation is None:
        perturbation = drawn(found.motion.duration, motion.body.mass, np.random.default_rng(seed), ranges)
    settings = replace(settings, rate=motion.fps * max(1, round(settings.rate / motion.fps)))
    start = found.motion.root_position[0] * [1.0, 1.0, 0.0]
    floor = Floor(np.array(perturbation.slope), start)
    tracked = tracking_model(motion.body, settings).carrying(perturbation.masses).on_slope(floor.slope, start)
    followed = reference(tracked, found, floor, perturbation.masses, ground, nearness)
    time = np.arange(len(followed.qpos)) / settings.rate
    steps = track(tracked, followed, perturbation.push_force(time, motion.body.mass), cost)
    windows = tracked_windows(tracked, steps, len(followed.qpos) - 1, limits)
    whole = len(windows) if windows.all() else max(int(windows.argmin()) - 1, 0)
    last = len(steps) if windows.all() else whole * round(WINDOW_S * settings.rate)
    if not whole or last / settings.rate < perturbation.end_s + (ranges.settle_s if perturbation.push else 0.0):
        lost = windows.argmin() * WINDOW_S if not windows.all() else len(steps) / settings.rate
        raise TrackingFailedError(f"perturbed: the simulated human lost the motion at {lost:.1f} s", windows.tolist())
    kept = Tracked(**{name: value[:last] for name, value in vars(steps).items()})
    labels, applied, pulled = _labels(
        tracked, found.motion, floor, kept, perturbation, cutoff, followed.substeps, settings.contact.friction
    )
    return PerturbedMotion(
        dynamics=labels,
        pulled=pulled,
        perturbation=perturbation,
        assistance=_assistance(tracked, kept, followed.substeps),
        windows=windows,
        simulation=kept,
        applied=applied,
    )


def tracked_windows(tracked: TrackingModel, steps: Tracked, expected: int, limits: WindowLimits) -> NDArray[np.bool_]:
    """Whether each window was tracked; windows that the simulation did not reach were not.

    Args:
        tracked: the human.
        steps: of the simulation.
        expected: number of steps without a fall.
        limits: of a tracked window.
    """
    size = round(WINDOW_S / tracked.model.opt.timestep)
    count = max(expected // size, 1)
    result = np.zeros(count, bool)
    for number in range(count):
        # The last window takes what does not fill another one.
        window = slice(number * size, expected if number == count - 1 else (number + 1) * size)
        away, control = steps.deviation[window], steps.control[window]
        if len(away) < window.stop - window.start:
            break
        position = np.sqrt(np.mean(np.sum(away[:, :3] ** 2, axis=1)))
        tilt = np.linalg.norm(away[:, 3:6], axis=1).max()
        joints = np.sqrt(np.mean(away[:, 6:] ** 2))
        bound = (np.abs(control[:, :6]) >= 0.999 * tracked.limits[:6]).any(axis=1).mean()
        result[number] = (
            position <= limits.position and tilt <= limits.tilt and joints <= limits.joints and bound <= limits.assisted
        )
    return result


def _assistance(tracked: TrackingModel, steps: Tracked, substeps: int) -> Float:
    """Largest assistance within each frame: force, and moment per metre of leg, (T, 2) [body weights]."""
    weight, leg = tracked.body.mass * GRAVITY, tracked.body.segments.leg
    force = np.linalg.norm(steps.control[:, :3], axis=1) / weight
    moment = np.linalg.norm(steps.control[:, 3:6], axis=1) / (weight * leg)
    starts = np.arange(0, len(force), substeps)
    return np.stack([np.maximum.reduceat(force, starts), np.maximum.reduceat(moment, starts)], axis=1)


def _labels(
    tracked: TrackingModel,
    like: Motion,
    floor: Floor,
    steps: Tracked,
    perturbation: Perturbation,
    cutoff: float,
    substeps: int,
    friction: float,
) -> tuple[Dynamics, Float, NDArray[np.bool_]]:
    """Labels at the frame rate, the applied joint torques, low-passed, (T, 26), and `PerturbedMotion.pulled`."""
    rate, frames = 1 / tracked.model.opt.timestep, slice(None, None, substeps)

    def low(signal: Float, limit: float = cutoff) -> Float:
        return smoothing_spline(signal, rate, limit)[frames]

    qpos = steps.qpos.copy()
    for first in tracked.quaternions():
        qpos[:, first : first + 4] = continuous_quaternions(qpos[:, first : first + 4])
    qpos = low(qpos)
    for first in tracked.quaternions():
        qpos[:, first : first + 4] /= np.linalg.norm(qpos[:, first : first + 4], axis=1, keepdims=True)
    motion = tracked.motion(qpos, like)
    body, weight = motion.body, motion.body.mass * GRAVITY
    segments = segment_motion(motion)
    loads = _loads(tracked, segments_loads=carried_loads(segments, tracked, perturbation.masses), push=low(steps.push))

    index = human_model(body).body_index
    feet = [index[f"calcaneus_{side}"] for side in SIDES]
    grid = segments.position[:, feet, None] + np.einsum("tsij,pj->tspi", segments.rotation[:, feet], sole_grid(body))
    about_origin = low(steps.wrenches)
    wrenches, centres = projected(about_origin, floor, grid, friction)
    left = effort(segments, body, loads).about(segments.centre)
    for side in range(2):
        arm = centres[:, side] - segments.centre
        force = wrenches[:, side, :3]
        left -= np.concatenate([force, np.cross(arm, force) + wrenches[:, side, 3:]], axis=1)
    residual = np.linalg.norm(left.reshape(-1, 2, 3), axis=-1) / weight
    clipped = np.linalg.norm(about_origin[..., :3] - wrenches[..., :3], axis=-1) / weight
    removed = np.zeros_like(clipped)
    if cutoff < BAND:
        removed = over_impact((low(steps.wrenches, BAND) - about_origin)[..., :3] / weight, like.fps)
    sources = _error_sources(wrenches[..., :3] / weight, removed, residual[:, 0])
    pulled: NDArray[np.bool_] = np.any(about_origin[..., :3] @ floor.normal < -PULL * weight, axis=1)
    return (
        Dynamics(
            motion=replace(
                motion,
                torques=joint_torques(body, segments, wrenches, centres, loads),
                wrenches=wrenches,
                contacts=wrenches[..., 2] > CONTACT_SHARE * weight,
            ),
            segments=segments,
            centres=centres,
            point_forces=_point_forces(_on_floor(grid, floor), wrenches[..., :3], centres),
            residual=residual,
            error_sources=sources,
            force_error=np.hypot(force_error(sources), clipped),
            loads=loads,
        ),
        low(steps.control)[:, 6:],
        pulled,
    )


def _error_sources(forces: Float, removed: Float, residual: Float) -> Float:
    """Size of every source of error, (T, 2, 6), in the order of `FACTORS` [body weights].

    The simulation knows the share of the feet and the masses. It does not know a human's impacts, nor the ground
    forces of a human without assistance.
    """
    loaded = np.linalg.norm(forces, axis=-1) > 0
    nothing = np.zeros_like(removed)
    return np.stack([nothing, nothing, removed, nothing, nothing, charged(residual, loaded)], axis=-1)


def _loads(tracked: TrackingModel, segments_loads: tuple[ExternalLoad, ...], push: Float) -> tuple[ExternalLoad, ...]:
    """Loads on every segment of `LOADED_SEGMENTS`, with zeros where there is none."""
    force = {name: np.zeros_like(push) for name in LOADED_SEGMENTS}
    force["torso"] = force["torso"] + push
    for load in segments_loads:
        force[load.segment] = force[load.segment] + load.force
    return tuple(ExternalLoad(name, value) for name, value in force.items())


def _on_floor(grid: Float, floor: Floor) -> Float:
    """Points of the floor below points of the soles, (T, 2, 12, 3) [m]."""
    below = grid.copy()
    below[..., 2] = floor.height(grid)
    return below


def projected(about_origin: Float, floor: Floor, grid: Float, friction: float) -> tuple[Float, Float]:
    """Wrenches that feet can exert on the floor, about centres of pressure, (T, 2, 6) and (T, 2, 3).

    - A foot that pulls, or is above `SOLE_REACH`, has no force; its centre is below the middle of its sole.
    - The friction of a loaded foot is at most `friction` times its pressure, and along the floor's normal at most that
      times half the length of the sole [N·m].
    - Its centre is on the floor below the sole: beyond it, the nearest in the sole's own coordinates.
    """
    normal = floor.normal
    force, moment = about_origin[..., :3], about_origin[..., 3:]
    below = _on_floor(grid, floor)
    middle = below.mean(axis=2)
    pressure = force @ normal
    height = (grid[..., 2] - below[..., 2]).min(axis=-1)
    loaded = (pressure > NO_FORCE) & (height < SOLE_REACH)
    about_middle = moment - np.cross(middle, force)
    # The point of the plane about which the moment has no part in it.
    shift = np.cross(normal, about_middle) / np.where(loaded, pressure, 1.0)[..., None]
    found = middle + np.where(loaded[..., None], shift, 0.0)
    forward, side = _sole_shares(below, found)
    heel, toe, across = below[:, :, 0], below[:, :, -COLUMNS], below[:, :, COLUMNS - 1]
    inside = heel + forward[..., None] * (toe - heel) + side[..., None] * (across - heel)
    centres = np.where(loaded[..., None], inside, middle)

    along = force - pressure[..., None] * normal
    size = np.linalg.norm(along, axis=-1)
    most = friction * np.maximum(pressure, 0.0)
    along = along * np.minimum(1.0, most / np.maximum(size, NO_FORCE))[..., None]
    possible = np.where(loaded[..., None], pressure[..., None] * normal + along, 0.0)
    half = np.linalg.norm(grid[:, :, -COLUMNS] - grid[:, :, 0], axis=-1) / 2
    twist = np.clip((moment - np.cross(found, force)) @ normal, -most * half, most * half)
    return np.concatenate([possible, np.where(loaded, twist, 0.0)[..., None] * normal], axis=-1), centres


def _sole_shares(below: Float, points: Float) -> tuple[Float, Float]:
    """Coordinates of points in the soles' outlines on the floor, heel to toe and across, each (T, 2) in [0, 1]."""
    heel, toe, across = (below[:, :, point, :2] for point in (0, -COLUMNS, COLUMNS - 1))
    first, second, away = toe - heel, across - heel, points[..., :2] - heel
    area = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    # A sole seen from its edge has no area: any point of it is as good.
    area = np.where(np.abs(area) > 1e-6, area, np.inf)
    forward = (away[..., 0] * second[..., 1] - away[..., 1] * second[..., 0]) / area
    side = (first[..., 0] * away[..., 1] - first[..., 1] * away[..., 0]) / area
    return np.clip(forward, 0.0, 1.0), np.clip(side, 0.0, 1.0)


def _point_forces(below: Float, force: Float, centres: Float) -> Float:
    """Forces at the points of the soles, shared by the corners so that they act at the centre, (T, 2, 12, 3) [N]."""
    forward, side = _sole_shares(below, centres)
    found = np.zeros((*force.shape[:2], POINTS, 3))
    for point, share in (
        (0, (1 - forward) * (1 - side)),
        (COLUMNS - 1, (1 - forward) * side),
        (POINTS - COLUMNS, forward * (1 - side)),
        (POINTS - 1, forward * side),
    ):
        found[:, :, point] = share[..., None] * force
    return found
