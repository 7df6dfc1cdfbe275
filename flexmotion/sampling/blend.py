"""Transition between two human motions on one frame clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]


def take_over(old: Motion, old_first: int, new: Motion, first: int, frames: int) -> Motion:
    """`new`, blended in from `old`: its first two frames are those of `old`, and from `frames` later on those of `new`.

    The switch lies between the first two frames, so pose and speed are continuous there. Forces, torques and
    activations that both motions have are mixed with the weights of the poses, which is accurate as far as the motions
    agree, and approximate for moments about different points. What only `new` has is kept. Contacts are those of the
    motion with the greater weight.

    Args:
        old_first, first: index of the first frame of `old` and of `new` on the common clock.
        frames: length of the transition; shorter where `old` ends before.

    Returns:
        The blended motion, as long as `new`.
    """
    offset = first - old_first
    overlap = min(len(old) - offset, len(new))
    if frames < 1 or offset < 0 or overlap < 2:
        return new
    weight = np.clip((np.arange(overlap) - 1.0) / min(frames, overlap - 1), 0.0, 1.0)
    before = old[offset : offset + overlap]
    return replace(
        new,
        root_position=_mixed(before.root_position, new.root_position, weight),
        root_quaternion=nlerp(before.root_quaternion, new.root_quaternion, weight),
        joints=_mixed(before.joints, new.joints, weight),
        torques=_both(before.torques, new.torques, weight),
        wrenches=_both(before.wrenches, new.wrenches, weight),
        pressure_centres=_both(before.pressure_centres, new.pressure_centres, weight),
        activations=_both(before.activations, new.activations, weight),
        joint_contact=_both(before.joint_contact, new.joint_contact, weight),
        contacts=_nearer(before.contacts, new.contacts, weight),
    )


def _mixed(old: Float, new: Float, weight: Float) -> Float:
    """Linear mix of (K, ...) into the first K rows of (T, ...)."""
    mixed = new.copy()
    share = (1.0 - weight).reshape(-1, *[1] * (new.ndim - 1))
    mixed[: len(weight)] += share * (old - new[: len(weight)])
    return mixed


def _both(old: Float | None, new: Float | None, weight: Float) -> Float | None:
    """`_mixed` where both are known, else `new`."""
    return new if old is None or new is None else _mixed(old, new, weight)


def _nearer(old: Flags | None, new: Flags | None, weight: Float) -> Flags | None:
    """Flags (T, 2) with the first K rows taken from `old`, (K, 2), where it has the greater weight."""
    if old is None or new is None:
        return new
    taken = new.copy()
    taken[: len(weight)] = np.where((weight < 0.5)[:, None], old, new[: len(weight)])
    return taken


def nlerp(old: Float, new: Float, weight: Float) -> Float:
    """Normalised linear mix of unit quaternions (K, 4) into the first K rows of (T, 4), by the shorter rotation.

    For the few degrees between two samples of one motion it differs from spherical interpolation by hundredths of a
    degree. The result has the signs of `old` where they overlap, and is continuous.
    """
    count = len(weight)
    sign = np.where(np.sum(old * new[:count], axis=1, keepdims=True) < 0, -1.0, 1.0)
    mixed = (1.0 - weight[:, None]) * old + weight[:, None] * sign * new[:count]
    rest = sign[-1] * new[count:] if count else new
    return np.concatenate([mixed / np.linalg.norm(mixed, axis=1, keepdims=True), rest])
