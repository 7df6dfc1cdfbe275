"""Recursive filters of sampled signals.

    y[t] + back[0] y[t-1] + back[1] y[t-2] + ...  =  feed[0] x[t] + feed[1] x[t-1] + ...

As `scipy.signal.lfilter`, whose import loads scipy.stats and takes as long as all else that a run loads.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

Float = NDArray[np.float64]


def recursive(feed: Sequence[float], back: Sequence[float], signal: Float, state: Float | None = None) -> Float:
    """A signal (T, ...), filtered along its first axis.

    Args:
        feed: weights of the input, from that of the present sample on.
        back: weights of the output before, from that of the last sample on, none of which is that of the present one.
        state: what the samples before add to the first outputs, (at most the filter's order, ...); None: nothing.
    """
    if not signal.size:
        return signal.astype(np.float64)
    added = np.zeros((len(signal), signal[0].size))
    columns = signal.reshape(added.shape)
    for lag, weight in enumerate(feed):
        added[lag:] += weight * columns[: max(len(columns) - lag, 0)]
    if state is not None:
        first = state[: len(signal)]
        added[: len(first)] += first.reshape(len(first), -1)
    # The recursion is the solution of a triangular system of as many bands, with ones on its diagonal.
    bands = np.repeat(np.array([1.0, *back])[:, None], len(signal), axis=1)
    found, _ = dtbtrs(bands, added, uplo="L", diag="U")
    filtered: Float = np.ascontiguousarray(found).reshape(signal.shape)
    return filtered


def butterworth(cutoff: float, fps: float) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """`feed` and `back` of a low-pass of second order, -3 dB at `cutoff` [Hz]; bilinear.

    Raises:
        ValueError: the cut-off is not between 0 and half of `fps`: the filter would not be stable.
    """
    if not 0.0 < cutoff < 0.5 * fps:
        raise ValueError(f"cut-off {cutoff:g} Hz at {fps:g} values a second, expected between 0 and {0.5 * fps:g} Hz")
    warped = float(np.tan(np.pi * cutoff / fps))
    scale = 1.0 / (1.0 + np.sqrt(2.0) * warped + warped**2)
    gain = scale * warped**2
    back = (2.0 * scale * (warped**2 - 1.0), scale * (1.0 - np.sqrt(2.0) * warped + warped**2))
    return (gain, 2.0 * gain, gain), back
