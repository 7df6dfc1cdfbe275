"""`FrameCheck`: which live frames cannot be the person that was seen before, and why."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmotion.importers.mapping import REQUIRED_POINTS, SIDED_POINTS
from flexmotion.importers.units import LEG

Float = NDArray[np.float64]

FASTEST = 12.0
"""Greatest speed of a joint, and of the hips in the room [m/s]. Fists of boxers reach 9 m/s, sprinters 12 m/s."""
SLACK_M, SHORTEST_S = 0.05, 1.0 / 30.0
"""Room for noise of a camera [m], and least time between two frames that counts: stamps jitter [s]."""
SAME_BODY = 0.3
"""Greatest relative difference of the legs' length from that measured. MediaPipe's vary by 20 % with the view."""
EXCHANGED_M, EXCHANGED = 0.12, 0.4
"""Left and right joints are exchanged where they both jump further than the first [m] and are, exchanged, nearer than
the second share of that to where they were."""

UPRIGHT = 0.7
"""A person is followed while the shoulders are at least so high above the lower ankle, over the length of the legs.
130 clips of both collections: less where somebody climbs, sits on the floor or dances with a hand on it, .8 in the
deepest crouch. With another axis up, or upside down, their medians are less (one walk: .85)."""

CHAIN = ("hip", "knee", "ankle")


def leg_length(points: Mapping[str, Float]) -> float:
    """Hip to ankle over the knee in one frame, mean of both sides [m]."""
    bones = [
        points[f"{b}_{side}"] - points[f"{a}_{side}"]
        for a, b in zip(CHAIN[:-1], CHAIN[1:], strict=True)
        for side in "lr"
    ]
    return float(np.linalg.norm(bones, axis=-1).sum()) / 2


class FrameCheck:
    """Compares each frame with the last one that was taken.

    Attributes:
        leg: length of the measured person's legs [m]; None before it is measured.
    """

    def __init__(self) -> None:
        self.leg: float | None = None
        self._last: tuple[float, Mapping[str, Float]] | None = None

    def forget(self) -> None:
        """The next frame may be anywhere."""
        self._last = None

    def take(self, time_s: float, points: Mapping[str, Float]) -> None:
        """A frame has been taken."""
        self._last = time_s, points

    def fault(self, time_s: float, points: Mapping[str, Float]) -> str | None:
        """Why a frame is not taken; None where nothing speaks against it.

        Args:
            time_s: of the frame; not before that of the last one [s].
            points: of a mapping, (3,) each, z up [m].
        """
        if not np.isfinite([points[name] for name in REQUIRED_POINTS]).all():
            return "a leg is not seen"
        length = leg_length(points)
        if not LEG.holds(length):
            return "no human"
        if self.leg is not None and abs(length / self.leg - 1.0) > SAME_BODY:
            return "another body"
        if not _upright(points, length):
            return "not upright"
        if self._last is None:
            return None
        since, before = time_s - self._last[0], self._last[1]
        if _exchanged(points, before):
            return "sides exchanged"
        reach = FASTEST * max(since, SHORTEST_S) + SLACK_M
        travelled = _hips(points) - _hips(before)
        moved = np.array([points[name] - before[name] for name in points if name in before]) - travelled
        fastest = np.nanmax(np.linalg.norm([travelled, *moved], axis=-1))
        return "a jump" if fastest > reach else None


def _upright(points: Mapping[str, Float], leg: float) -> bool:
    """Whether the shoulders are above the feet; of shoulders that are not seen nothing is known."""
    shoulders = [points[name][2] for name in ("shoulder_l", "shoulder_r") if name in points]
    over = float(np.mean(shoulders or [np.nan])) - min(float(points[f"ankle_{side}"][2]) for side in "lr")
    return not over < UPRIGHT * leg


def _hips(points: Mapping[str, Float]) -> Float:
    middle: Float = (points["hip_l"] + points["hip_r"]) / 2
    return middle


def _exchanged(points: Mapping[str, Float], before: Mapping[str, Float]) -> bool:
    pairs = [(f"{name}_l", f"{name}_r") for name in SIDED_POINTS]
    both = [pair for pair in pairs if points.keys() >= set(pair) <= before.keys()]
    now, then = (np.array([[where[side] for side in pair] for pair in both]) for where in (points, before))
    own, other = (np.linalg.norm(now - was, axis=-1) for was in (then, then[:, ::-1]))
    exchanged = (own.min(axis=1) > EXCHANGED_M) & (other.sum(axis=1) < EXCHANGED * own.sum(axis=1))
    return bool(exchanged.any())
