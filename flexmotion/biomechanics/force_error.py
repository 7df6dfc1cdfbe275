"""Estimated standard error of the ground force on each foot: the expected length of the error vector.

The sources are independent, so their squares add up. With the total T of both feet's forces and a foot's part p of it:

- **Share.** Kinematics determine the sum of both forces, hardly the share of each: 2 T √(p (1 - p)) times `STEPPING`,
  or times `BOTH` where both feet do the same (standing, squats, jumps).
- **Impacts.** Acceleration above the filter's cut-off is removed, whether it was an impact or noise: its content up to
  `BAND` Hz, by √p, times `CONTENT`.
- **Force.** Errors of masses and accelerations in proportion to a foot's force, times `FORCE`; twice that at the ends
  of a clip, where accelerations are known from one side.
- **Residual.** What the ground forces do not explain, by √p, times `RESIDUAL`.

The factors are fitted to three trials with force plates, two walks and a drop jump; the benchmark
`biomechanics/force_error` also fits them to two of the trials and reports the third.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from flexmotion.biomechanics.differentiation import second_derivative
from flexmotion.biomechanics.smoothing import smoothing_spline
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]

FLAGGED = 0.13
"""A foot's force with a greater standard error is flagged: it may be wrong by over a fifth of body weight."""

STEPPING, BOTH, CONTENT, FORCE, RESIDUAL = 0.05, 0.09, 0.25, 0.03, 0.5
"""Standard error per unit of every source; see above."""

FACTORS = np.array([STEPPING, BOTH, CONTENT, FORCE, RESIDUAL])

BAND = 15.0
"""Highest frequency of the removed content; above it lies noise of any recording [Hz]."""

SPREAD_S = 0.04
"""Standard deviation of its average over time, the width of a filtered impact [s]."""

END_S = 0.05
"""Time from the ends of a clip within which accelerations are less certain [s]."""

SMALLEST = 0.005
"""Least standard error, and a force that is small beside it in a foot's part [body weights]."""


def removed_content(motion: Motion, cutoff: float) -> Float:
    """Acceleration of the centre of mass that the low-pass filter removes, up to `BAND`, (T,) [g].

    Args:
        motion: as recorded, not smoothed.
        cutoff: of the filter [Hz].
    """
    band = min(BAND, 0.45 * motion.fps)
    if cutoff >= band or len(motion) < 2:
        return np.zeros(len(motion))
    path = forward(motion).com
    removed = smoothing_spline(path, motion.fps, band) - smoothing_spline(path, motion.fps, cutoff)
    power = np.sum(second_derivative(removed, motion.fps) ** 2, axis=-1)
    found: Float = np.sqrt(gaussian_filter1d(power, SPREAD_S * motion.fps, mode="nearest")) / GRAVITY
    return found


def error_sources(forces: Float, alike: Float, removed: Float, residual: Float, fps: float) -> Float:
    """Size of every source of error on left and right foot, (T, 2, 5), in the order of `FACTORS` [body weights].

    Args:
        forces: on both feet, (T, 2, 3) [body weights].
        alike: likeness of the feet (`ground_reaction.SlowShare`), (T,).
        removed: content that the filter removed (`removed_content`), (T,) [g].
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
            removed[:, None] * np.sqrt(part),
            size * (1 + end[:, None]),
            residual[:, None] * np.sqrt(part),
        ],
        axis=-1,
    )


def force_error(sources: Float, factors: Float = FACTORS) -> Float:
    """Standard error of the ground force on left and right foot, (T, 2) [body weights]."""
    found: Float = np.sqrt(sources**2 @ factors**2 + SMALLEST**2)
    return found
