"""`perturbed`: a motion as the simulated human does it under a push, with a load, on a slope; with its forces.

All values come from the simulation, low-passed like every motion of a set, so that the equations of motion hold between
them: what is left is the assistance at the root.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.dynamics import LOADED, Dynamics, dynamics
from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.force_error import FACTORS, force_error
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
from flexmotion.biomechanics.sole import COLUMNS, POINTS, sole_grid
from flexmotion.configs.errors import FlexMotionError
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

WINDOW_S = 0.5
"""Length of the windows that are judged [s]."""


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
        dynamics: motion, forces and loads at the frame rate; its `residual` is what the assistance leaves.
        perturbation: what it met.
        assistance: largest force on the root in each frame, and moment per metre of leg, (T, 2) [body weights].
        windows: whether each window of the whole simulation was tracked.
        simulation: every step of the frames that were kept.
        applied: joint torques of the actuators, low-passed, in the order of the tracking model, (T, 26) [N·m].
    """

    dynamics: Dynamics
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
) -> PerturbedMotion:
    """Simulate a human who does the motion under a perturbation.

    Args:
        motion: kinematics, and a body with the human's mass.
        seed: of the perturbation.
        ranges: of the perturbation.
        perturbation: instead of one drawn from the seed.
        cutoff: of the low-pass filter [Hz].
        cost: of deviations from the motion.
        settings: of the simulation.
        limits: of a tracked window; the motion ends a window before the first that is not.

    Raises:
        TrackingFailedError: the motion would end before `ranges.settle_s` after the push, or has no whole window.
    """
    count = min(len(motion), round(ranges.longest_s * motion.fps) + 1)
    found = dynamics(motion[:count], cutoff)
    if perturbation is None:
        perturbation = drawn(found.motion.duration, motion.body.mass, np.random.default_rng(seed), ranges)
    settings = replace(settings, rate=motion.fps * max(1, round(settings.rate / motion.fps)))
    start = found.motion.root_position[0] * [1.0, 1.0, 0.0]
    floor = Floor(np.array(perturbation.slope), start)
    tracked = tracking_model(motion.body, settings).carrying(perturbation.masses).on_slope(floor.slope, start)
    followed = reference(tracked, found, floor, perturbation.masses)
    time = np.arange(len(followed.qpos)) / settings.rate
    steps = track(tracked, followed, perturbation.push_force(time, motion.body.mass), cost)
    windows = tracked_windows(tracked, steps, len(followed.qpos) - 1, limits)
    whole = len(windows) if windows.all() else max(int(windows.argmin()) - 1, 0)
    last = len(steps) if windows.all() else whole * round(WINDOW_S * settings.rate)
    if not whole or last / settings.rate < perturbation.end_s + (ranges.settle_s if perturbation.push else 0.0):
        lost = windows.argmin() * WINDOW_S if not windows.all() else len(steps) / settings.rate
        raise TrackingFailedError(f"perturbed: the simulated human lost the motion at {lost:.1f} s", windows.tolist())
    kept = Tracked(**{name: value[:last] for name, value in vars(steps).items()})
    labels, applied = _labels(tracked, found.motion, floor, kept, perturbation, cutoff, followed.substeps)
    return PerturbedMotion(
        dynamics=labels,
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
) -> tuple[Dynamics, Float]:
    """Labels at the frame rate, and the applied joint torques, low-passed, (T, 26)."""
    rate, frames = 1 / tracked.model.opt.timestep, slice(None, None, substeps)

    def low(signal: Float) -> Float:
        return smoothing_spline(signal, rate, cutoff)[frames]

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
    wrenches, centres = _at_centres(about_origin, floor, grid.mean(axis=2), weight)
    left = effort(segments, body, loads).about(segments.centre)
    for side in range(2):
        arm = centres[:, side] - segments.centre
        force = wrenches[:, side, :3]
        left -= np.concatenate([force, np.cross(arm, force) + wrenches[:, side, 3:]], axis=1)
    # The forces are those of the simulation, not estimated from kinematics.
    sources = np.zeros((len(motion), 2, len(FACTORS)))
    return (
        Dynamics(
            motion=replace(
                motion,
                torques=joint_torques(body, segments, wrenches, centres, loads),
                wrenches=wrenches,
                contacts=wrenches[..., 2] > LOADED * weight,
            ),
            segments=segments,
            centres=centres,
            point_forces=_point_forces(grid, wrenches[..., :3], centres),
            residual=np.linalg.norm(left.reshape(-1, 2, 3), axis=-1) / weight,
            error_sources=sources,
            force_error=force_error(sources),
            loads=loads,
        ),
        low(steps.control)[:, 6:],
    )


def _loads(tracked: TrackingModel, segments_loads: tuple[ExternalLoad, ...], push: Float) -> tuple[ExternalLoad, ...]:
    """Loads on every segment of `LOADED_SEGMENTS`, with zeros where there is none."""
    force = {name: np.zeros_like(push) for name in LOADED_SEGMENTS}
    force["torso"] = force["torso"] + push
    for load in segments_loads:
        force[load.segment] = force[load.segment] + load.force
    return tuple(ExternalLoad(name, value) for name, value in force.items())


def _at_centres(about_origin: Float, floor: Floor, soles: Float, weight: float) -> tuple[Float, Float]:
    """Wrenches about centres of pressure on the floor, (T, 2, 6) and (T, 2, 3).

    The centre of a foot that is not loaded is below the middle of its sole.
    """
    normal = floor.normal
    force, moment = about_origin[..., :3], about_origin[..., 3:]
    middle = soles.copy()
    middle[..., 2] = floor.height(soles)
    about_middle = moment - np.cross(middle, force)
    pressure = force @ normal
    loaded = pressure > LOADED * weight
    # The point of the plane about which the moment has no part in it.
    shift = np.cross(normal, about_middle) / np.where(loaded, pressure, 1.0)[..., None]
    centres = middle + np.where(loaded[..., None], shift, 0.0)
    return np.concatenate([force, moment - np.cross(centres, force)], axis=-1), centres


def _point_forces(grid: Float, force: Float, centres: Float) -> Float:
    """Forces at the points of the soles, shared by the corners so that they act at the centre, (T, 2, 12, 3) [N]."""
    heel, toe, across = grid[:, :, 0], grid[:, :, -COLUMNS], grid[:, :, COLUMNS - 1]
    shares = []
    for end in (toe, across):
        along = end - heel
        shares.append(np.clip(np.sum((centres - heel) * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0))
    forward, side = shares
    found = np.zeros((*force.shape[:2], POINTS, 3))
    for point, share in (
        (0, (1 - forward) * (1 - side)),
        (COLUMNS - 1, (1 - forward) * side),
        (POINTS - COLUMNS, forward * (1 - side)),
        (POINTS - 1, forward * side),
    ):
        found[:, :, point] = share[..., None] * force
    return found
