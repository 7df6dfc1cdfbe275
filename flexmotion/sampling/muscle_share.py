"""`with_muscles`: activations that are asked in place of the predicted ones, at unchanged muscle torques.

Muscles are many more than joints: what some of them do is free as long as the others make up for it. The activations
that are asked are taken as they are, and in each frame the others change least,

    change = argmin |change|²  with  arms · change = -arms · (asked - predicted),

within 0 and 1. Muscles that reach a bound are fixed there, and the rest is solved again; frames that still lack torque
are solved as a whole (least squares within bounds). What remains is what the free muscles cannot give, and is left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from flexmotion.biomechanics.muscle_arms import MuscleArms
from flexmotion.human.motion import Motion

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROUNDS = 6
"""Times that the free muscles are solved for."""

SMALL = 1e-6
"""Regularisation, relative to the mean of the normal matrix: of joints that no free muscle moves."""

LACKS = 0.1
"""Torque of the muscle models' human from which on a frame is solved as a whole [N·m]."""

CHANGED = 1e-3
"""Weight of a change of activations beside a torque of one N·m, there."""

SPREAD = 5.0
"""Frames before and after an asked one over which a change of activation begins and ends."""


def with_muscles(motion: Motion, asked: Float, mask: Flags) -> Motion:
    """A motion with asked activations.

    Args:
        motion: with activations, (T, M).
        asked: activations, in [0, 1] or clipped to it, (T, M).
        mask: which of them are asked, (T, M).

    Raises:
        ValueError: the muscles are not those of `MuscleArms`.
    """
    arms = MuscleArms.shipped()
    if motion.activations is None or motion.activations.shape[1] != arms.muscles:
        raise ValueError(f"expected the activations of {arms.muscles} muscles")
    found = motion.activations.copy()
    told: Flags = np.asarray(mask.any(axis=0))
    found[:, told] += _spread(np.clip(asked, 0.0, 1.0) - found, mask)[:, told]
    found[:, told] = np.clip(found[:, told], 0.0, 1.0)
    begin = 0
    for part in arms.at(motion):
        own = slice(begin, begin + part.shape[2])
        begin = own.stop
        if told[own].any():
            missing = np.einsum("tjm,tm->tj", part, motion.activations[:, own] - found[:, own])
            found[:, own] = _balanced(found[:, own], part, missing, ~told[own])
    return motion.changed(activations=found)


def _spread(change: Float, mask: Flags) -> Float:
    """Changes in asked frames, and less and less of them in the frames around, (T, M)."""
    frames = np.arange(len(change))
    apart = np.abs(frames[:, None] - frames)
    near = np.where(apart < SPREAD, np.cos(0.5 * np.pi * apart / SPREAD) ** 2, 0.0)
    weight = near @ mask.astype(float)
    around = (near @ np.where(mask, change, 0.0)) / np.maximum(weight, 1.0)
    found: Float = np.where(mask, change, around)
    return found


def _balanced(activations: Float, arms: Float, missing: Float, free: Flags) -> Float:
    """Activations whose free muscles give the torques that are missing, (T, M).

    Args:
        activations: (T, M).
        arms: (T, J, M).
        missing: torques, (T, J).
        free: muscles that may change, (M,).
    """
    found = activations.copy()
    loose = np.broadcast_to(free, found.shape).copy()
    eye = np.eye(arms.shape[1])
    for _ in range(ROUNDS):
        own = arms * loose[:, None]
        normal = own @ own.swapaxes(1, 2)
        scale = np.trace(normal, axis1=1, axis2=2) / len(eye)
        normal += np.maximum(SMALL * scale, SMALL)[:, None, None] * eye
        change = np.einsum("tjm,tj->tm", own, np.linalg.solve(normal, missing[..., None])[..., 0])
        moved = np.clip(found + change, 0.0, 1.0)
        missing = missing - np.einsum("tjm,tm->tj", arms, moved - found)
        stopped = loose & (moved != found + change)
        found, loose = moved, loose & ~stopped
        if not stopped.any():
            break
    for frame in np.flatnonzero(np.abs(missing).max(axis=1) > LACKS):
        own, begun = arms[frame][:, free], activations[frame, free]
        if not own.size:
            continue
        wanted = missing[frame] + own @ found[frame, free]
        system = np.concatenate([own, CHANGED * np.eye(own.shape[1])])
        solved = lsq_linear(system, np.concatenate([wanted, CHANGED * begun]), bounds=(0.0, 1.0))
        found[frame, free] = np.clip(solved.x, 0.0, 1.0)
    return found
