"""Whether a part is there, as measured."""

from __future__ import annotations

import pytest

from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.planning.arrival import arrived

DUE = Heard(id=1, asked="left hand", state="accepted", tick=5, holds="part")


@pytest.mark.parametrize(
    ("off", "there"), [(0.01, True), (0.05, True), (0.06, False), (None, False), (float("nan"), False)]
)
def test_within_its_tolerance_it_is_there_and_else_it_has_time(off: float | None, there: bool) -> None:
    early, late = (arrived(DUE, off, 0.05, "x", last=last) for last in (False, True))
    assert (early.there, early.missed) == ("x" if there else None, None)
    assert (late.there, late.missed) == (("x", None) if there else (None, "x"))


@pytest.mark.parametrize("known", ["there", "missed"])
def test_it_is_told_once(known: str) -> None:
    told = DUE.model_copy(update={known: "y"})
    assert arrived(told, 0.0, 0.05, "x", last=True) is told
