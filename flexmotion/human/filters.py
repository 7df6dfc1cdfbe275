"""Recursive filters of sampled signals.

    y[t] + back[0] y[t-1] + back[1] y[t-2] + ...  =  feed[0] x[t] + feed[1] x[t-1] + ...

As `scipy.signal.lfilter`, whose import loads scipy.stats and takes as long as all else that a run loads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.compiled import ANY, FLOATS, compiled

Float = NDArray[np.float64]


def recursive(feed: Sequence[float], back: Sequence[float], signal: Float, state: Float | None = None) -> Float:
    """A signal (T, ...), filtered along its first axis.

    Args:
        feed: weights of the input, from that of the present sample on.
        back: weights of the output before, from that of the last sample on, none of which is that of the present one.
        state: what the samples before add to the first outputs, (at most the filter's order, ...); None: nothing.
    """
    width = math.prod(signal.shape[1:])
    columns = np.asarray(signal, np.float64).reshape(len(signal), width)
    before = np.empty((0, width)) if state is None else np.asarray(state, np.float64).reshape(len(state), width)
    return _recursive(np.array(feed, np.float64), np.array(back, np.float64), columns, before).reshape(signal.shape)


@compiled(*[FLOATS[1]] * 2, *[ANY[2]] * 2)
def _recursive(feed: Float, back: Float, signal: Float, state: Float) -> Float:
    """`recursive` of columns, (T, C)."""
    rows, columns = signal.shape
    out = np.zeros((rows, columns))
    for row in range(rows):
        for lag in range(min(len(feed), row + 1)):
            for column in range(columns):
                out[row, column] += feed[lag] * signal[row - lag, column]
        if row < len(state):
            for column in range(columns):
                out[row, column] += state[row, column]
        for lag in range(min(len(back), row)):
            for column in range(columns):
                out[row, column] -= back[lag] * out[row - lag - 1, column]
    return out


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
