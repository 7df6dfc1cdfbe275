"""`arrived`: whether a part is there, as measured: what its answer says once its time has come."""

from __future__ import annotations

from flexmotion.streamer.motion.heard import Heard

ARRIVES_S = 0.5
"""A part that is not within its tolerance this long after it is due is not there: something holds it away [s]."""
LEAST_M, LEAST_RAD = 0.02, 0.05
"""Least tolerance of what is measured [m, rad]: joints sag under load, by up to a degree each."""


def arrived(heard: Heard, off: float | None, tolerance: float, told: str, *, last: bool) -> Heard:
    """The answer to a target for a part that is due, with `there` or `missed` where that is known.

    Args:
        heard: the answer so far.
        off: how far the part is from its place as measured, in the unit of `tolerance`; None: not known.
        tolerance: within which it is there.
        told: `off` in words.
        last: it has had its time.
    """
    if heard.there is not None or heard.missed is not None:
        return heard
    if off is not None and off <= tolerance:
        return heard.model_copy(update={"there": told})
    return heard.model_copy(update={"missed": told}) if last else heard
