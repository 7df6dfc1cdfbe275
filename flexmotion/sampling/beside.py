"""`Beside`: a gesture of arms or head, made beside what the rest of the body does: a wave on the way.

People make such gestures on a walk as they make them standing: arms and head are those of a human who stands and makes
the gesture, all else is the walk's. Forces are those of the motion that results.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES
from flexmotion.sampling.led_path import led_along
from flexmotion.text.phrases import STAND, is_sudden, limbs, seen_parts
from flexmotion.text.sides import LEFT, RIGHT, sides

Float = NDArray[np.float64]

HEAD = [place for place, name in enumerate(JOINTS) if name.startswith("neck_")]

_UPPER = frozenset(["arm", "head"])


@dataclass(frozen=True, eq=False)
class Beside:
    """The gesture of one window.

    Attributes:
        joints: angles of the standing human who makes the gesture, from `led_path.KNOWN` frames before the window on,
            (KNOWN + T, 26) [rad].
        columns: joints that it is made with.
    """

    joints: Float
    columns: tuple[int, ...]

    def kept(self, window: Motion, before: Motion) -> Motion:
        """A window with the gesture.

        Args:
            window: as sampled.
            before: the motion up to the window, at least one frame.
        """
        return led_along(window, before, self.joints[:, self.columns], self.columns)


def columns_of(kind: str) -> tuple[int, ...]:
    """Joints that a gesture is made with beside something else: the arm of its side, or both arms, or the neck.

    Args:
        kind: of which `fits_beside` something.
    """
    used, side = limbs(kind) or (), sides(kind)
    found = list(HEAD) if "head" in used else []
    if "arm" in used:
        named = [name for name, word in zip(SIDES, (LEFT, RIGHT), strict=True) if not side or word in side]
        found += [JOINTS.index(f"{joint}_{name}") for name in named for joint in ARM_JOINTS]
    return tuple(found)


def fits_beside(gesture: str, kind: str) -> bool:
    """Whether a gesture may be made beside a kind of motion: by arms or head, which that one leaves free.

    Blows and bows are no such gestures: they are made with the whole body.
    """
    used, taken = limbs(gesture), frozenset[str]() if kind == STAND else limbs(kind)
    if used is None or taken is None or is_sudden(gesture):
        return False
    return used | seen_parts(gesture) <= _UPPER and not used & taken
