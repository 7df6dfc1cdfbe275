"""`unhurried`: shoulders turn no faster than people turn theirs; the same way takes them more time.

A decoder that is to leave a pose for one that never followed it in the data mixes the two. Where the columns of their
rotations cancel the mix turns over: of an arm that pointed up and was to hang in a dash the shoulder turned by 102° in
a frame, and the hand went 17 m/s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.features.feature_loops import turns
from flexmotion.features.joint_groups import BALLS, PELVIS_SIZE, six
from flexmotion.features.layout import Layout
from flexmotion.spatial.rotations import matrices, matrix_quaternions, rotation_vectors, vector_quaternions

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

FASTEST, CALM = 13.0, 5.5
"""Fastest turns of an upper arm [rad/s]: 1 in 1,000 recorded frames of the liveliest manners and of dashes is faster
(12.4 to 13.3), and of gestures in the normal manner (waves 5.3 to 5.6, raised hands 5.3, arms that point 4.5)."""

SPIN = 1.4
"""A shoulder as a whole, its turn about the upper arm included, may turn this much faster (waves 7.3, raises 7.4)."""

SHOULDERS = tuple(number for number, ball in enumerate(BALLS) if ball[0].startswith("shoulder"))
"""Their numbers among `BALLS`, one after the other."""


def unhurried(frames: Float32, history: Float32, layout: Layout, fastest: float) -> Float32:
    """The window in which shoulders that turn too fast take more time for their way.

    Args:
        frames: features of the window that continue the history, not normalised, (W, layout.size), W >= 2.
        history: features of the frames before, likewise, (H, layout.size); with fewer than two the speed is unknown
            and the window is unchanged.
        layout: of both.
        fastest: turn of an upper arm that is not too fast [rad/s].

    Returns:
        The window itself where none turns too fast; of the others the rotation of the shoulder alone is changed.
    """
    if len(history) < 2:
        return frames
    first = layout.blocks["rotations"].start + PELVIS_SIZE
    columns = [slice(first + 6 * ball, first + 6 * ball + 6) for ball in SHOULDERS]
    both = slice(columns[0].start, columns[-1].stop)
    # The third axis is along the upper arm.
    turned, arm, whole = turns(np.concatenate([history[-2:, both], frames[:, both]], dtype=np.float64))
    most = fastest / layout.fps
    if (arm[:, 1:] >= np.cos(most)).all() and (whole[:, 1:] >= np.cos(SPIN * most)).all():
        return frames
    found = frames.copy()
    efforts = np.maximum(_angle(arm), _angle(whole) / SPIN)
    for own, rotations, effort in zip(columns, turned, efforts, strict=True):
        if effort[1:].max() > most:
            found[:, own] = six(_slowed(rotations[1:], effort, most)[1:])
    return found


def _angle(cosine: Float) -> Float:
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _slowed(rotations: Float, efforts: Float, most: float) -> Float:
    """A joint's rotations on the same way in more time, in which speeds go on at both ends, (K, 3, 3).

    The time is taken on both sides of what is too fast, as much as it needs, and all that there is where that is less.

    Args:
        rotations: in the last known frame and in the window, (K, 3, 3).
        efforts: from each frame to the next, of which `most` is not too fast, and of the two known frames first, (K,).
        most: see `efforts`.
    """
    way = np.concatenate([[0.0], np.cumsum(efforts[1:])])
    fast = np.flatnonzero(efforts[1:] > most)
    first, last = int(fast[0]), int(fast[-1]) + 1
    while True:
        slowed = _eased(way, first, last, efforts)
        if np.diff(slowed).max() <= most or (first == 0 and last == len(way) - 1):
            break
        first, last = max(first - 1, 0), min(last + 1, len(way) - 1)
    frames = np.arange(first, last + 1)
    at = np.interp(slowed, way[frames], frames)
    before = np.minimum(at.astype(np.intp), len(rotations) - 2)
    steps = rotation_vectors(matrix_quaternions(rotations[before].swapaxes(-1, -2) @ rotations[before + 1]))
    found = rotations.copy()
    found[frames] = rotations[before] @ matrices(vector_quaternions((at - before)[:, None] * steps))
    return found


def _eased(way: Float, first: int, last: int, efforts: Float) -> Float:
    """A way from one frame to another by a cubic that begins and ends at the speeds there, (last - first + 1,)."""
    count = last - first
    s = np.arange(count + 1) / count
    length, begins = way[last] - way[first], efforts[first] * count
    ends = (efforts[last + 1] if last + 1 < len(efforts) else efforts[last]) * count
    # A cubic does not turn back while neither speed is above three times the mean.
    begins, ends = min(begins, 3.0 * length), min(ends, 3.0 * length)
    return way[first] + s * (begins + s * (3.0 * length - 2.0 * begins - ends + s * (begins + ends - 2.0 * length)))
