"""Estimated standard error of the ground force on each foot: the root mean square length of the error vector.

The sources are independent, so their squares add up. With the total T of both feet's forces and a foot's part p of it:

- **Share.** Kinematics determine the sum of both forces, hardly the share of each: 2 T √(p (1 - p)) times `STEPPING`,
  or times `BOTH` where both feet do the same (standing, squats, jumps).
- **Removed.** Acceleration from the cut-off that was used to `BAND` is removed, whether it was an impact or noise: its
  content by √p, times `REMOVED`.
- **Let through.** A cut-off above the common 6 Hz, at landings or at the user's wish, lets noise through with impacts:
  the content from 6 Hz to that cut-off by √p, times `PASSED`.
- **Force.** Errors of masses and accelerations in proportion to a foot's force, times `FORCE`; twice that at the ends
  of a clip, where accelerations are known from one side.
- **Residual.** What the ground forces do not explain, times `RESIDUAL`: in full on every foot within reach of the
  floor, in equal parts (√½) on both where none is. Such a frame is a flight, with a small residual, or has other
  support (a rail, stairs), with one near the body's weight. A part beyond `RESIDUAL_FORCE` flags the foot.

The factors are fitted to three trials with force plates, two walks and a drop jump, at cut-offs of 6, 10 and 15 Hz.
The jump alone determines `BOTH` and `RESIDUAL`, and most of `REMOVED` and `PASSED`. The benchmark
`biomechanics/force_error` also fits them to two of the trials and reports the third.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from flexmotion.biomechanics.differentiation import second_derivative
from flexmotion.biomechanics.plausibility import RESIDUAL_FORCE
from flexmotion.biomechanics.smoothing import CUTOFF, smoothing_spline
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

FLAGGED = 0.13
"""A foot's force with a greater standard error is flagged: it may be wrong by over a fifth of body weight.

The drop jump set it: all frames with such an error at 6 Hz are of that one trial (4 at 30 frames/s, 13 at 100), and so
are all good frames that it flags. The two walks only say that nothing of level walking is near it.
"""

UNEXPLAINED = 0.15
"""Least standard error of a foot whose part of the residual is beyond `RESIDUAL_FORCE` [body weights]; flagged."""

STEPPING, BOTH, REMOVED, PASSED, FORCE, RESIDUAL = 0.05, 0.08, 0.15, 0.5, 0.03, 0.5
"""Standard error per unit of every source; see above."""

FACTORS = np.array([STEPPING, BOTH, REMOVED, PASSED, FORCE, RESIDUAL])

BAND = 15.0
"""Highest frequency of the removed content; above it lies noise of any recording [Hz]."""

SPREAD_S = 0.04
"""Standard deviation of its average over time, the width of a filtered impact [s]."""

END_S = 0.05
"""Time from the ends of a clip within which accelerations are less certain [s]."""

SMALLEST = 0.005
"""Least standard error, and a force that is small beside it in a foot's part [body weights]."""


def above_cutoff(motion: Motion, cutoff: float | Float) -> Float:
    """Acceleration of the centre of mass above the cut-off, and that which a raised cut-off lets through, (T, 2) [g].

    The first is the content from the used cut-off to `BAND`, the second that from the common cut-off to the used one.

    Args:
        motion: as recorded, not smoothed.
        cutoff: of the filter that was used, also one of every frame, (T,) [Hz].
    """
    if len(motion) < 2:
        return np.zeros((len(motion), 2))
    used = np.broadcast_to(np.minimum(cutoff, 0.5 * motion.fps), len(motion))
    path = forward(motion).com
    highest, lowest = np.maximum(used, min(BAND, 0.45 * motion.fps)), np.minimum(used, CUTOFF)
    above, kept, common = (smoothing_spline(path, motion.fps, edge) for edge in (highest, used, lowest))
    content = np.stack([above - kept, kept - common], axis=1)
    return over_impact(second_derivative(content, motion.fps), motion.fps) / GRAVITY


def over_impact(vectors: Float, fps: float) -> Float:
    """Root mean square length of vectors over the width of a filtered impact, (T, ..., 3) -> (T, ...)."""
    power = np.sum(vectors**2, axis=-1)
    found: Float = np.sqrt(gaussian_filter1d(power, SPREAD_S * fps, axis=0, mode="nearest"))
    return found


def charged(residual: Float, near: NDArray[np.bool_]) -> Float:
    """Residual that counts as an error of each foot, (T,) -> (T, 2): see the source `Residual` above.

    Args:
        residual: force that the ground forces do not explain, (T,).
        near: whether the ground may act on a foot, (T, 2).
    """
    found: Float = residual[:, None] * np.where(near.any(axis=1, keepdims=True), near, np.sqrt(0.5))
    return found


def error_sources(
    forces: Float, near: NDArray[np.bool_], alike: Float, content: Float, residual: Float, fps: float
) -> Float:
    """Size of every source of error on left and right foot, (T, 2, 6), in the order of `FACTORS` [body weights].

    Args:
        forces: on both feet, (T, 2, 3) [body weights].
        near: whether a foot is within reach of the floor, so that the ground may act on it, (T, 2).
        alike: likeness of the feet (`ground_reaction.SlowShare`), (T,).
        content: removed and let through (`above_cutoff`), (T, 2) [g].
        residual: force that the ground forces do not explain, (T,) [body weights].
        fps: frames per second.
    """
    size = np.linalg.norm(forces, axis=-1)
    total = size.sum(axis=1, keepdims=True)
    part = size / (total + SMALLEST)
    split = 2 * total * np.sqrt(part * (1 - part))
    frame = np.arange(len(forces))
    end = np.exp(-((np.minimum(frame, frame[::-1]) / fps / END_S) ** 2))
    return np.stack(
        [
            split * (1 - alike[:, None]),
            split * alike[:, None],
            content[:, :1] * np.sqrt(part),
            content[:, 1:] * np.sqrt(part),
            size * (1 + end[:, None]),
            charged(residual, near),
        ],
        axis=-1,
    )


def force_error(sources: Float, factors: Float = FACTORS) -> Float:
    """Standard error of the ground force on left and right foot, (T, 2) [body weights].

    Args:
        sources: of `error_sources`, (T, 2, 6).
        factors: standard error per unit of every source, (6,).
    """
    found: Float = np.sqrt(sources**2 @ factors**2 + SMALLEST**2)
    least = np.where(sources[..., -1] > RESIDUAL_FORCE, UNEXPLAINED, 0.0)
    return np.maximum(found, least)
