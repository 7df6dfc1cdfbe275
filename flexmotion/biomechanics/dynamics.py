"""`dynamics`: ground forces, joint torques and residuals of the equations of motion, from kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.external_load import ExternalLoad
from flexmotion.biomechanics.floor_drift import on_level_floor
from flexmotion.biomechanics.force_error import above_cutoff, error_sources, force_error
from flexmotion.biomechanics.ground_reaction import GROUND, GroundSettings, ground_reaction, slow_share
from flexmotion.biomechanics.inverse_dynamics import effort, joint_torques
from flexmotion.biomechanics.landing import landing_cutoff
from flexmotion.biomechanics.residual_reduction import shifted
from flexmotion.biomechanics.segment_motion import SegmentMotion, segment_motion
from flexmotion.biomechanics.smoothing import CUTOFF, smooth
from flexmotion.biomechanics.sole import NEARNESS, Nearness, sole_points
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

CONTACT_SHARE = 0.05
"""Least share of body weight on a foot in contact."""


@dataclass(frozen=True)
class Dynamics:
    """A motion with its dynamics.

    Attributes:
        motion: smoothed, over a level floor, with `torques`, `wrenches` (moments about `centres`) and `contacts`.
        segments: motion of the masses.
        centres: centres of pressure of left and right foot on the floor, (T, 2, 3) [m].
        point_forces: ground forces at the points of the soles (see `sole.sole_grid`), (T, 2, 12, 3) [N].
        loads: external forces other than the ground's.
        residual: force [body weights] and moment about the centre of mass [body weights x m] that ground forces cannot
            explain, (T, 2): from stairs, chairs, contact with others, or a bad recording.
        error_sources: of the ground force on left and right foot, (T, 2, 6) [body weights]; see `force_error`.
        force_error: estimated standard error of that force, (T, 2) [body weights]; one greater than
            `force_error.FLAGGED` is flagged.
    """

    motion: Motion
    segments: SegmentMotion
    centres: Float
    point_forces: Float
    residual: Float
    error_sources: Float
    force_error: Float
    loads: tuple[ExternalLoad, ...] = ()


def dynamics(
    motion: Motion,
    cutoff: float = CUTOFF,
    settings: GroundSettings = GROUND,
    nearness: Nearness = NEARNESS,
    reductions: int = 2,
    loads: Sequence[ExternalLoad] = (),
) -> Dynamics:
    """Ground forces and joint torques of a clip.

    Args:
        motion: kinematics, and a body with the human's mass.
        cutoff: of the low-pass filter, except around landings and take-offs (`landing`) [Hz].
        settings, nearness: of the quadratic programme for the ground forces.
        loads: external forces other than the ground's.
        reductions: number of residual reductions of the path.
    """
    level = on_level_floor(smooth(motion, cutoff))
    raised = landing_cutoff(level, cutoff)
    if raised is not None:
        level = on_level_floor(smooth(motion, raised))
    pelvis = human_model(level.body).body_index["pelvis"]
    weight = level.body.mass * GRAVITY
    slow = None
    for attempt in range(1 + reductions):
        segments = segment_motion(level)
        sole = sole_points(level.body, segments, level.fps, nearness)
        needed = effort(segments, level.body, loads)
        ground = ground_reaction(segments, needed, sole, segments.rotation[:, pelvis, :, 1], settings, slow)
        slow = slow_share(ground, sole, level.fps, settings)
        if attempt < reductions:
            level = shifted(level, ground.residual[:, :3])
    residual = np.linalg.norm(ground.residual.reshape(-1, 2, 3), axis=-1) / weight
    assert slow is not None
    sources = error_sources(
        ground.wrenches[..., :3] / weight,
        np.any(sole.nearness > 0, axis=-1),
        slow.alike,
        above_cutoff(motion, cutoff if raised is None else raised),
        residual[:, 0],
        level.fps,
    )
    return Dynamics(
        motion=replace(
            level,
            torques=joint_torques(level.body, segments, ground.wrenches, ground.centres, loads),
            wrenches=ground.wrenches,
            contacts=ground.wrenches[..., 2] > CONTACT_SHARE * weight,
        ),
        segments=segments,
        centres=ground.centres,
        point_forces=ground.point_forces,
        residual=residual,
        error_sources=sources,
        force_error=force_error(sources),
        loads=tuple(loads),
    )
