"""Left and right points of a recording that were exchanged, from some frame on or throughout, put right.

Tracking software exchanges two markers where one is hidden behind the other. Both then jump to where the other was; the
distances to other points of the same side tell which of the two is which.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.signals import runs
from flexmotion.importers.capture import Capture
from flexmotion.importers.rigid import visible

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

APART = 0.04
"""Least distance of two points that are exchanged [m]; nearer ones are told from each other by nothing, and matter
little."""

SWAPPED = 0.5
"""Two points are exchanged where the other's predicted position explains theirs with less than this share of the error
of their own."""

HELD = 0.8
"""The same share where points are predicted to stay: hands that meet and part are predicted to pass through each
other."""

GAP_S = 0.25
"""Longest time without one of the points over which their positions are compared [s]."""

LOOSE = 0.01
"""Least standard deviation of the distance to a point of the same segment that shows wrong sides throughout a clip [m];
skin moves less."""

TIGHTER, NEARER = 0.5, 0.85
"""Points belong to the side to which their distance varies, or is, less than this share of that to the other side."""


def without_swaps(
    capture: Capture, pairs: Sequence[tuple[str, str]], mates: Mapping[str, Sequence[str]], scale: float
) -> Capture:
    """A capture with exchanged left and right points put right, and a warning for each pair.

    Args:
        capture: positions are NaN where a point is missing.
        pairs: names of left and right points.
        mates: name of a point -> names of others of its side at a nearly constant distance.
        scale: metres per unit of the positions.
    """
    positions = capture.positions.copy()
    column = {name: index for index, name in enumerate(capture.names)}
    found = [np.zeros(len(capture), bool) for _ in pairs]
    # Jumps first: points that are exchanged for a time would make others seem to be so throughout. Of the latter,
    # those with many mates first: one that is exchanged is loose against all of them, another against that one only.
    for judged in (_with_jumps, _throughout):
        for pair, swapped in sorted(zip(pairs, found, strict=True), key=lambda item: -len(mates.get(item[0][0], ()))):
            both = [column[name] for name in pair]
            near = [[column[name] for name in mates.get(own, ()) if name in column] for own in pair]
            turned = judged(scale * positions, both, near, capture.fps)
            frames = np.flatnonzero(turned)[:, None]
            positions[frames, both] = positions[frames, both[::-1]]
            swapped ^= turned
    notes = [
        f"{left} and {right} are exchanged {_when(swapped, capture)}: put right"
        for (left, right), swapped in zip(pairs, found, strict=True)
        if swapped.any()
    ]
    if not notes:
        return capture
    return replace(capture, positions=positions, warnings=(*capture.warnings, *notes))


def _when(swapped: Bool, capture: Capture) -> str:
    if swapped.all():
        return "throughout"
    spans = [(capture.start + begin / capture.fps, capture.start + end / capture.fps) for begin, end in runs(swapped)]
    return ", ".join(f"from {begin:.2f} to {end:.2f} s" for begin, end in spans)


def _with_jumps(positions: Float, both: list[int], near: list[list[int]], fps: float) -> Bool:
    """Frames in which two points are exchanged that were so for a time, (T,).

    Args:
        positions: of all points, (T, J, 3) [m].
        both: columns of the left and the right point.
        near: columns of the points near the left and the right one.
    """
    tracks = positions[:, both]
    seen = np.flatnonzero(visible(tracks).all(axis=1))
    swapped = np.zeros(len(positions), bool)
    if len(seen) < 3:
        return swapped
    breaks = np.flatnonzero(np.diff(seen) > GAP_S * fps) + 1
    for frames in np.split(seen, breaks):
        turned = _parity(tracks, frames)
        if turned.any():
            swapped[frames] = turned ^ _other_way(positions[frames], both, near, turned)
    # Within a gap a point keeps the side that it had before it.
    before = np.maximum.accumulate(np.where(np.isin(np.arange(len(swapped)), seen), np.arange(len(swapped)), seen[0]))
    return swapped[before]


def _parity(tracks: Float, frames: NDArray[np.intp]) -> Bool:
    """Whether two points, (T, 2, 3), are exchanged against the first of some frames, for each of them."""
    here = tracks[frames]
    apart = np.linalg.norm(here[1:, 0] - here[1:, 1], axis=-1) > APART
    candidates = 1 + np.flatnonzero(apart & (_exchanged(here[1:], here[:-1]) < HELD))
    jumps = np.zeros(len(frames), bool)
    for index in candidates:
        last = index - 1
        speed = np.zeros((2, 3))
        if last > 0 and not jumps[last]:
            speed = (here[last] - here[last - 1]) / (frames[last] - frames[last - 1])
        expected = here[last] + (frames[index] - frames[last]) * speed
        jumps[index] = _exchanged(here[index], expected) < SWAPPED
    return np.logical_xor.accumulate(jumps)


def _exchanged(now: Float, expected: Float) -> Float:
    """Error of two points, (..., 2, 3), if they are exchanged, as a share of that if they are not, (...)."""
    own = np.linalg.norm(now - expected, axis=-1).sum(axis=-1)
    share: Float = np.linalg.norm(now - expected[..., ::-1, :], axis=-1).sum(axis=-1) / np.maximum(own, 1e-9)
    return share


def _other_way(here: Float, both: list[int], near: list[list[int]], turned: Bool) -> bool:
    """Whether the frames that are not `turned`, (T,), are the exchanged ones."""
    as_turned, opposite = (_distances(here, both, near, each) for each in (turned, ~turned))
    if as_turned.size:
        for share, of in ((TIGHTER, np.nanstd), (NEARER, np.nanmean)):
            value, other = float(of(as_turned, axis=0).mean()), float(of(opposite, axis=0).mean())
            if other < share * value:
                return True
            if value < share * other:
                return False
    return bool(turned.mean() > 0.5)


def _throughout(positions: Float, both: list[int], near: list[list[int]], fps: float) -> Bool:
    """All frames of a clip in which two points are exchanged from beginning to end, else none, (T,)."""
    none = np.zeros(len(positions), bool)
    spread, other = (np.nanstd(_distances(positions, both, near, each), axis=0) for each in (none, ~none))
    return none | bool(spread.size and (spread > LOOSE).all() and (other < TIGHTER * spread).all())


def _distances(here: Float, both: list[int], near: list[list[int]], turned: Bool) -> Float:
    """Distances of two points to the points near each, (T, M), if they are exchanged in some frames."""
    ends = [np.where(turned[:, None], here[:, other], here[:, own]) for own, other in (both, both[::-1])]
    found = [
        np.linalg.norm(end - here[:, mate], axis=-1) for end, mates in zip(ends, near, strict=True) for mate in mates
    ]
    table = np.stack(found, axis=1) if found else np.empty((len(here), 0))
    return table[:, np.isfinite(table).any(axis=0)]
