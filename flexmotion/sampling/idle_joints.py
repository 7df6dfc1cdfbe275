"""`idle_joints`: joints above the legs that a kind of motion leaves alone."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from flexmotion.gestures.moved import moving
from flexmotion.gestures.plan import draw_plan
from flexmotion.human.body import Body
from flexmotion.sampling.at_rest import ARMS, UPPER
from flexmotion.sampling.beside import columns_of, fits_beside
from flexmotion.sampling.made_gestures import made_gesture
from flexmotion.text.phrases import STAND


@lru_cache(maxsize=128)
def idle_joints(kind: str) -> frozenset[int]:
    """Those that hang or rest while it is done; none of motions that the whole body does.

    A gesture that was made by a recipe moves what that moves. In recorded ones arms of the other side are idle: the
    trunk leans along.
    """
    if kind == STAND:
        return UPPER
    if not fits_beside(kind, STAND):
        return frozenset()
    made = made_gesture(kind)
    if made is not None:
        gesture, side = made
        return UPPER.difference(moving(draw_plan(gesture, Body(), side, np.random.default_rng(0))))
    return frozenset(ARMS).difference(columns_of(kind))
