"""Gaps of the markers that a mapping uses: interpolated, reconstructed from the segment's others, or cut off."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flexmotion.configs.errors import MotionFormatError
from flexmotion.human.signals import runs
from flexmotion.importers.capture import Capture
from flexmotion.importers.rigid import cluster_pose, visible

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

GAP_S = 0.25
"""Longest gap of a marker that is interpolated on its own [s]."""

ARM_GAP_S = 1.0
"""Longest gap of a marker of arms or head that is interpolated, relative to the trunk [s]."""

NEIGHBOUR_GAP_S = 1.0
"""Longest gap of a marker that is approximated with the help of a marker of the next segment [s]."""

KEPT_SHARE = 0.5
"""Least share of a clip that must be left where frames with a missing marker are cut off."""


def without_gaps(
    capture: Capture,
    needed: Collection[str],
    optional: Collection[str] = (),
    segments: Sequence[Collection[str]] = (),
    spare: Collection[str] = (),
    anchor: Collection[str] = (),
) -> tuple[Capture, frozenset[str]]:
    """A capture whose used points have no gaps, cut to the frames in which all needed ones are known.

    Args:
        capture: positions are NaN where a point is missing; points without orientations only.
        needed: names of points without which nothing can be made of the clip.
        optional: names of points of arms and head, which a clip may lack.
        segments: names of points that move as one rigid body, each.
        spare: names of points that others can stand for; used only where they are complete.
        anchor: names of points in the middle of the body, relative to which optional ones are interpolated.

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
    scale = rough_scale(positions[:, [column[name] for name in names]])
    bridged = {name: _bridge(positions[:, column[name]], GAP_S * capture.fps) for name in names}
    for members in segments:
        here = [column[name] for name in members if name in column]
        for name, count in _from_segment(positions, here, scale, capture):
            notes.append(f"{name}: gaps are reconstructed from the other markers of its segment ({_in_frames(count)})")
        for name, count in _from_neighbours(positions, here, [column[name] for name in names], scale, capture):
            notes.append(
                f"{name}: gaps are approximated from two markers of its segment and one beside it ({_in_frames(count)})"
            )
    for name in names:
        bridged[name] += _bridge(positions[:, column[name]], GAP_S * capture.fps)
    if any(bridged.values()):
        filled = ", ".join(f"{name} ({_in_frames(count)})" for name, count in bridged.items() if count)
        notes.append(f"gaps of at most {GAP_S} s are interpolated: {filled}")
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
    middle = np.mean([positions[:, column[name]] for name in anchor or needed if name in column], axis=0)
    for name in optional:
        if name not in column:
            continue
        track = positions[:, column[name]]
        seen = visible(track)
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


def _in_frames(count: int) -> str:
    return f"{count} frame" if count == 1 else f"{count} frames"


def rough_scale(positions: Float) -> float:
    """Metres per unit of the file, nearly: the used points of a human spread over about a metre and a half.

    Other points, which may be angles or forces in columns of points, have another scale.
    """
    seen = positions[visible(positions).any(axis=1)]
    if not len(seen):
        return 1.0
    spread = (np.nanpercentile(seen, 98, axis=1) - np.nanpercentile(seen, 2, axis=1)).max(axis=1)
    return 1.5 / max(float(np.median(spread)), 1e-9)


def _longest(mask: Bool) -> int:
    return max((end - begin for begin, end in runs(mask)), default=0)


def _bridge(track: Float, frames: float) -> int:
    """Fill the gaps of one point, (T, 3), in place, between known frames and up to that many frames long.

    Returns:
        number of frames that were filled.
    """
    seen = visible(track)
    known = np.flatnonzero(seen)
    if seen.all() or len(known) < 4:
        return 0
    spline, count = CubicSpline(known, track[known]), 0
    for begin, end in runs(~seen):
        if begin > 0 and end < len(track) and end - begin <= frames:
            track[begin:end] = spline(np.arange(begin, end))
            count += end - begin
    return count


def _from_segment(positions: Float, columns: Sequence[int], scale: float, capture: Capture) -> list[tuple[str, int]]:
    """Fill gaps of points of one rigid body in place, from at least three others; names and frames of those filled."""
    tracks = positions[:, columns].copy()
    seen = visible(tracks)
    if seen.all() or len(columns) < 4:
        return []
    filled = [
        (capture.names[index], _moved_with(positions, index, scale * tracks, member, scale))
        for member, index in enumerate(columns)
        if not seen[:, member].all()
    ]
    return [(name, count) for name, count in filled if count]


def _from_neighbours(
    positions: Float, columns: Sequence[int], every: Sequence[int], scale: float, capture: Capture
) -> list[tuple[str, int]]:
    """Fill gaps up to `NEIGHBOUR_GAP_S` in place from two others of the segment and a point beside it.

    The point beside it is the one whose distance to the missing one changes least.

    Returns:
        names of the points that were filled, and their number of frames.
    """
    filled = []
    for index in columns:
        gaps = ~visible(positions[:, index])
        others = [own for own in columns if own != index and np.isfinite(positions[gaps, own]).all()]
        if not gaps.any() or gaps.all() or len(others) < 2 or _longest(gaps) > NEIGHBOUR_GAP_S * capture.fps:
            continue
        beside = [own for own in every if own not in columns and np.isfinite(positions[gaps, own]).all()]
        if not beside:
            continue
        distance = np.linalg.norm(positions[~gaps][:, beside] - positions[~gaps, None, index], axis=-1)
        nearest = beside[int(np.argmin(np.nanstd(distance, axis=0)))]
        tracks = scale * positions[:, [index, *others[:2], nearest]]
        count = _moved_with(positions, index, tracks, 0, scale)
        if count:
            filled.append((capture.names[index], count))
    return filled


def _moved_with(positions: Float, index: int, tracks: Float, member: int, scale: float) -> int:
    """Fill the gaps of one member of a cluster in place where the cluster has a pose; number of frames filled."""
    rotation, origin, shape = cluster_pose(tracks)
    model = (origin + rotation @ shape[member]) / scale
    posed = visible(model)
    seen = visible(positions[:, index])
    known, frames = np.flatnonzero(seen & posed), np.flatnonzero(~seen & posed)
    if not len(frames) or not len(known):
        return 0
    # The skin's movement at the edges of a gap is carried into it.
    rest = positions[known, index] - model[known]
    shift = np.stack([np.interp(frames, known, rest[:, axis]) for axis in range(3)], axis=1)
    positions[frames, index] = model[frames] + shift
    return len(frames)


def _complete(capture: Capture, positions: Float, columns: Sequence[int]) -> tuple[int, int]:
    """The longest stretch of frames in which these points are known."""
    known: Bool = np.asarray(visible(positions[:, columns]).all(axis=1))
    stretches = runs(known)
    begin, end = max(stretches, key=lambda run: run[1] - run[0], default=(0, 0))
    if end - begin < max(KEPT_SHARE * len(positions), 2):
        missing = {capture.names[c]: ~visible(positions[:, c]) for c in columns}
        worst = max(missing, key=lambda name: _longest(missing[name]))
        first, last = max(runs(missing[worst]), key=lambda run: run[1] - run[0])
        raise MotionFormatError(
            f"{capture.path}: marker {worst!r} is missing for {(last - first) / capture.fps:.2f} s from "
            f"{capture.start + first / capture.fps:.2f} s on; {GAP_S} s are interpolated, more needs three other "
            f"markers of its segment, and {100 * KEPT_SHARE:.0f} % of the clip must be left where frames are cut off"
        )
    return begin, end
