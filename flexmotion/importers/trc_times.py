"""`frame_numbers`: which frame each row of a TRC file is, by its column Time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import MotionFormatError

Float = NDArray[np.float64]

SAME_RATE = 0.01
"""Greatest relative difference between DataRate and the rate of the times."""
UNEVEN = 0.25
"""Greatest difference of a step from whole frames, beside the rounding of the times [frames]."""
FINEST = 6
"""Decimals of times that are looked at."""


def frame_numbers(path: str, times: Float, lines: Sequence[int], fps: float) -> tuple[NDArray[np.intp], list[str]]:
    """Number of each row's frame from 0, (T,), with the numbers of frames that are left out skipped; and warnings.

    Args:
        path: of the file, for messages.
        times: of the rows, (T,) [s]; NaN where a field is empty.
        lines: of the rows in the file, (T,).
        fps: by the header, DataRate.

    Raises:
        MotionFormatError: times do not ascend, have another rate than the header says, or leave out more frames than
            there are.
    """
    even, known = np.arange(len(times)), np.isfinite(times)
    if len(times) < 2:
        return even, []
    if not known.any() or np.ptp(times[known]) == 0.0:
        return even, [f"Time does not advance, from line {lines[0]} on: rows are taken as {_seconds(1.0 / fps)} apart"]
    times = np.interp(even, even[known], times[known])
    rounding, steps = _rounding(times, 1.0 / fps), np.diff(times)
    coarse = rounding > 0.5 / fps
    wrong = np.flatnonzero((steps < 0.0) if coarse else (steps <= 0.0))
    if len(wrong):
        at = int(wrong[0])
        raise MotionFormatError(
            f"{path}, line {lines[at + 1]}: Time is {_seconds(times[at + 1])} after {_seconds(times[at])}, expected"
            f" rows {_seconds(1.0 / fps)} apart (DataRate {fps:g})"
        )
    frame = float(np.mean(steps) if coarse else np.median(steps))
    counts = np.ones(len(steps), np.intp) if coarse else np.maximum(np.round(steps / frame), 1).astype(np.intp)
    duration = float(times[-1] - times[0])
    rate = float(counts.sum()) / duration
    if abs(rate / fps - 1.0) > SAME_RATE + 2.0 * rounding / duration:
        raise MotionFormatError(
            f"{path}, line 3: DataRate is {fps:g}, but from line {lines[0]} on Time advances by"
            f" {_seconds(1.0 / rate)} a row ({rate:.4g} rows a second): correct the wrong one"
        )
    if coarse:
        return even, []
    if counts.sum() > 2 * len(times):
        at = int(np.argmax(steps))
        raise MotionFormatError(
            f"{path}, line {lines[at + 1]}: Time goes from {_seconds(times[at])} to {_seconds(times[at + 1])}, expected"
            f" rows {_seconds(1.0 / fps)} apart (DataRate {fps:g})"
        )
    numbers = np.concatenate([[0], np.cumsum(counts)])
    return numbers, _notes(times, counts, lines, fps, rounding)


def _notes(times: Float, counts: NDArray[np.intp], lines: Sequence[int], fps: float, rounding: float) -> list[str]:
    steps, notes = np.diff(times), []
    missing = np.flatnonzero(counts > 1)
    if len(missing):
        at, more = int(missing[0]), len(missing) - 1
        notes.append(
            f"line {lines[at + 1]}: Time goes from {_seconds(times[at])} to {_seconds(times[at + 1])}:"
            f" frames left out: {counts[at] - 1}{f'; further such places: {more}' if more else ''}"
        )
    uneven = np.flatnonzero(np.abs(steps * fps - counts) > UNEVEN + rounding * fps)
    if len(uneven):
        at, more = int(uneven[0]), len(uneven) - 1
        notes.append(
            f"line {lines[at + 1]}: Time advances by {_seconds(steps[at])}, expected {_seconds(1.0 / fps)}; it is taken"
            f" as {counts[at] / fps:.4g} s{f'; further such rows: {more}' if more else ''}"
        )
    return notes


def _rounding(times: Float, step: float) -> float:
    """Unit to which times are rounded [s]; 0 where a step of frames needs no rounding to it."""
    for decimals in range(FINEST):
        if np.allclose(times, np.round(times, decimals), rtol=0.0, atol=1e-9):
            return 0.0 if abs(step - round(step, decimals)) < 1e-9 else float(10.0**-decimals)
    return float(10.0**-FINEST)


def _seconds(value: float) -> str:
    return f"{value:.6g} s"
