"""One stretch of human motion taking over from another that runs on the same frame clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]


def take_over(old: Motion, old_first: int, new: Motion, first: int, frames: int) -> Motion:
    """`new`, blended in from `old`: its first two frames are the old ones, `frames` later it is all new.

    Between the first two frames lies the moment at which motion changes hands, so pose and speed are continuous there.
    Forces, torques and activations that both have are mixed as their poses are, which holds as far as the two agree;
    moments of wrenches about different points are no more than near. What only the new motion has is taken as it is:
    the next motion takes over from this one and would otherwise never have it again. A foot is in contact as in the
    motion that has the greater weight.

    Args:
        old_first, first: index of either motion's first frame on their common clock.
        frames: length of the transition; shorter where `old` does not reach so far.

    Returns:
        As many frames as `new` has.
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
        activations=_both(before.activations, new.activations, weight),
        contacts=_nearer(before.contacts, new.contacts, weight),
    )


def _mixed(old: Float, new: Float, weight: Float) -> Float:
    """Linear mix of (K, ...) into the first K rows of (T, ...)."""
    mixed = new.copy()
    share = (1.0 - weight).reshape(-1, *[1] * (new.ndim - 1))
    mixed[: len(weight)] += share * (old - new[: len(weight)])
    return mixed


def _both(old: Float | None, new: Float | None, weight: Float) -> Float | None:
    """`_mixed` of what both have, else that of `new`."""
    return new if old is None or new is None else _mixed(old, new, weight)


def _nearer(old: Flags | None, new: Flags | None, weight: Float) -> Flags | None:
    """Flags (K, 2) into the first K rows of (T, 2) where they have the greater weight."""
    if old is None or new is None:
        return new
    taken = new.copy()
    taken[: len(weight)] = np.where((weight < 0.5)[:, None], old, new[: len(weight)])
    return taken


def nlerp(old: Float, new: Float, weight: Float) -> Float:
    """Normalised linear mix of unit quaternions (K, 4) into the first K rows of (T, 4), the short way round.

    For the few degrees between two draws of one motion it is the great-circle mix to within hundredths of a degree.
    The result has the signs of `old` where they overlap, and goes on without a jump.
    """
    count = len(weight)
    sign = np.where(np.sum(old * new[:count], axis=1, keepdims=True) < 0, -1.0, 1.0)
    mixed = (1.0 - weight[:, None]) * old + weight[:, None] * sign * new[:count]
    rest = sign[-1] * new[count:] if count else new
    return np.concatenate([mixed / np.linalg.norm(mixed, axis=1, keepdims=True), rest])
