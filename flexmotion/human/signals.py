"""Filtering and interpolation of sampled motion: plain signals, unit quaternions, rotation matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

PASS_BAND = 0.4
"""Cut-off of the anti-alias filter as a share of the new frame rate (its Nyquist frequency is at one half)."""

SAME_RATE = 1e-3
"""Frame rates with a smaller relative difference are equal: files round their frame time."""


def resample_signal(signal: Float, fps: float, new_fps: float) -> Float:
    """A signal at another frame rate, first and last frame in place, (T, ...) -> (T', ...).

    To a lower rate it is low-passed first (fourth-order Butterworth, forward and backward: zero phase).
    """
    if same_rate(fps, new_fps) or len(signal) < 2:
        return signal
    flat = signal.reshape(len(signal), -1)
    if new_fps < fps:
        flat = low_pass(flat, fps, PASS_BAND * new_fps)
    times = np.arange(len(signal)) / fps
    # The last frame is kept although files round their frame time.
    count = int(np.floor(times[-1] * new_fps + 0.01)) + 1
    return CubicSpline(times, flat)(np.arange(count) / new_fps).reshape(count, *signal.shape[1:])


def low_pass(signal: Float, fps: float, cutoff: float) -> Float:
    """Zero-phase fourth-order Butterworth low-pass over the first axis; `cutoff` [Hz] is where it has -6 dB."""
    if cutoff >= fps / 2:
        return signal
    # It loads scipy.stats, which takes as long as all else that a run loads, and few runs resample.
    from scipy.signal import butter, sosfiltfilt

    sections = butter(4, cutoff, fs=fps, output="sos")
    # The ends are padded point-symmetrically by a few periods of the cut-off frequency.
    pad = min(len(signal) - 1, int(3 * fps / cutoff))
    filtered: Float = sosfiltfilt(sections, signal, axis=0, padlen=pad)
    return filtered


def resample_quaternions(quaternions: Float, fps: float, new_fps: float) -> Float:
    """Unit quaternions (T, ..., 4) at another frame rate, continuous in sign."""
    resampled = resample_signal(continuous_quaternions(quaternions), fps, new_fps)
    return resampled / np.linalg.norm(resampled, axis=-1, keepdims=True)


def resample_rotations(rotations: Float, fps: float, new_fps: float) -> Float:
    """Rotation matrices (T, 3, 3) at another frame rate."""
    if same_rate(fps, new_fps):
        return rotations
    quaternions = Rotation.from_matrix(rotations).as_quat()
    return Rotation.from_quat(resample_quaternions(quaternions, fps, new_fps)).as_matrix()


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Beginning and end (exclusive) of every run of true values, (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def same_rate(fps: float, new_fps: float) -> bool:
    """Whether two frame rates differ by rounding only."""
    return abs(fps / new_fps - 1) < SAME_RATE


def fill(values: Float, weight: Float, sigma: float) -> Float:
    """Values (T, n), filled in over time from frames of large weight.

    A Gaussian average over time with a standard deviation of `sigma` frames, weighted by `weight` (T,); far from every
    weighted frame it tends to the mean of all.
    """
    total = max(weight.sum(), 1e-9)
    mean = (weight[:, None] * values).sum(axis=0) / total
    both = np.concatenate([weight[:, None] * values, weight[:, None]], axis=1)
    near = gaussian_filter1d(both, sigma, axis=0, mode="constant")
    trace = 1e-3
    return (near[:, :-1] + trace * mean) / (near[:, -1:] + trace)
