"""Gaps of the markers that a mapping uses: interpolated, reconstructed from the segment's others, or cut off."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flexmotion.configs.errors import MotionFormatError
from flexmotion.importers.capture import Capture
from flexmotion.importers.rigid import cluster_pose

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

GAP_S = 0.25
"""Longest gap of a marker that is interpolated on its own [s]."""

ARM_GAP_S = 1.0
"""Longest gap of a marker of arms or head that is interpolated, relative to the trunk [s]."""

KEPT_SHARE = 0.5
"""Least share of a clip that must be left where frames with a missing marker are cut off."""


def without_gaps(
    capture: Capture,
    needed: Collection[str],
    optional: Collection[str] = (),
    segments: Sequence[Collection[str]] = (),
    spare: Collection[str] = (),
) -> tuple[Capture, frozenset[str]]:
    """A capture whose used points have no gaps, cut to the frames in which all needed ones are known.

    Args:
        capture: positions are NaN where a point is missing; points without orientations only.
        needed: names of points without which nothing can be made of the clip.
        optional: names of points of arms and head, which a clip may lack.
        segments: names of points that move as one rigid body, each.
        spare: names of points that others can stand for; used only where they are complete.

    Returns:
        the capture, with a warning for everything that was reconstructed or cut off, and the optional and spare
        points that are missing for too long.

    Raises:
        MotionFormatError: a needed point is missing for so long that less than half of the clip is left; names the
            point and the time.
    """
    names = [name for name in capture.names if name in needed or name in optional or name in spare]
    positions = capture.positions.copy()
    column = {name: index for index, name in enumerate(capture.names)}
    if np.isfinite(positions[:, [column[name] for name in names]]).all():
        return capture, frozenset()
    notes = list(capture.warnings)
    scale = _scale(positions)
    for name in names:
        _bridge(positions[:, column[name]], GAP_S * capture.fps)
    for members in segments:
        here = [column[name] for name in members if name in column]
        for name in _from_segment(positions, here, scale, capture):
            notes.append(f"{name}: gaps are reconstructed from the other markers of its segment")
    for name in names:
        _bridge(positions[:, column[name]], GAP_S * capture.fps)
    begin, end = _complete(capture, positions, [column[name] for name in needed if name in column])
    if (begin, end) != (0, len(capture)):
        blame = [n for n in needed if n in column and not np.isfinite(positions[:, column[n]]).all()]
        first, last = (capture.start + frame / capture.fps for frame in (begin, end - 1))
        notes.append(f"only {first:.2f} to {last:.2f} s are used: {', '.join(sorted(blame))} missing before or after")
    positions = positions[begin:end]
    lost = set()
    for name in spare:
        if name in column and not np.isfinite(positions[:, column[name]]).all():
            lost.add(name)
            notes.append(f"{name}: missing for too long, is not used")
    middle = np.mean([positions[:, column[name]] for name in needed if name in column], axis=0)
    for name in optional:
        if name not in column:
            continue
        track = positions[:, column[name]]
        seen = np.isfinite(track).all(axis=1)
        if seen.all():
            continue
        if _longest(~seen) > ARM_GAP_S * capture.fps or seen.sum() < 4:
            lost.add(name)
            notes.append(f"{name}: missing for {_longest(~seen) / capture.fps:.2f} s, is not used")
            continue
        # Relative to the body the point moves little within the gap; at the clip's ends it is held.
        local, frames = track - middle, np.arange(len(track))
        for axis in range(3):
            track[~seen, axis] = middle[~seen, axis] + np.interp(frames[~seen], frames[seen], local[seen, axis])
        notes.append(f"{name}: gaps up to {_longest(~seen) / capture.fps:.2f} s are interpolated")
    start = capture.start + begin / capture.fps
    return replace(capture, positions=positions, start=start, warnings=tuple(notes)), frozenset(lost)


def _scale(positions: Float) -> float:
    """Metres per unit of the file, nearly: a human's markers spread over about a metre and a half vertically."""
    spread = np.nanmax(np.nanpercentile(positions, 98, axis=1) - np.nanpercentile(positions, 2, axis=1))
    return 1.5 / max(float(spread), 1e-9)


def _runs(mask: Bool) -> list[tuple[int, int]]:
    """Beginning and end (exclusive) of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _longest(mask: Bool) -> int:
    return max((end - begin for begin, end in _runs(mask)), default=0)


def _bridge(track: Float, frames: float) -> None:
    """Fill the gaps of one point, (T, 3), in place, between known frames and up to that many frames long."""
    seen = np.isfinite(track).all(axis=1)
    known = np.flatnonzero(seen)
    if seen.all() or len(known) < 4:
        return
    spline = CubicSpline(known, track[known])
    for begin, end in _runs(~seen):
        if begin > 0 and end < len(track) and end - begin <= frames:
            track[begin:end] = spline(np.arange(begin, end))


def _from_segment(positions: Float, columns: Sequence[int], scale: float, capture: Capture) -> list[str]:
    """Fill gaps of points of one rigid body in place, from at least three others; names of those filled."""
    tracks = positions[:, columns]
    seen = np.isfinite(tracks).all(axis=-1)
    if seen.all() or len(columns) < 4:
        return []
    rotation, origin, shape = cluster_pose(scale * tracks)
    filled = []
    for member, index in enumerate(columns):
        model = (origin + rotation @ shape[member]) / scale
        possible = ~seen[:, member] & np.isfinite(model).all(axis=1)
        if not possible.any() or not seen[:, member].any():
            continue
        # The skin's movement at the edges of a gap is carried into it.
        known = np.flatnonzero(seen[:, member] & np.isfinite(model).all(axis=1))
        frames = np.flatnonzero(possible)
        rest = tracks[known, member] - model[known]
        shift = np.stack([np.interp(frames, known, rest[:, axis]) for axis in range(3)], axis=1)
        positions[frames, index] = model[frames] + shift
        filled.append(capture.names[index])
    return filled


def _complete(capture: Capture, positions: Float, columns: Sequence[int]) -> tuple[int, int]:
    """The longest stretch of frames in which these points are known."""
    known = np.isfinite(positions[:, columns]).all(axis=(1, 2))
    runs = _runs(known)
    begin, end = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
    if end - begin < max(KEPT_SHARE * len(positions), 2):
        missing = {capture.names[c]: ~np.isfinite(positions[:, c]).all(axis=1) for c in columns}
        worst = max(missing, key=lambda name: _longest(missing[name]))
        first, last = max(_runs(missing[worst]), key=lambda run: run[1] - run[0])
        raise MotionFormatError(
            f"{capture.path}: marker {worst!r} is missing for {(last - first) / capture.fps:.2f} s from "
            f"{capture.start + first / capture.fps:.2f} s on; {GAP_S} s are interpolated, more needs three other "
            f"markers of its segment, and {100 * KEPT_SHARE:.0f} % of the clip must be left where frames are cut off"
        )
    return begin, end
