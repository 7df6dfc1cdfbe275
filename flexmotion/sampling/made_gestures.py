"""`made_gesture`: the recipe from which the training clips of a kind of motion were made."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from flexmotion.gestures.recipes import Gesture, recipes
from flexmotion.human.skeleton import LEFT, RIGHT
from flexmotion.text.sides import mirrored


def made_gesture(kind: str) -> tuple[Gesture, int] | None:
    """Recipe of a kind, and its side, `LEFT` or `RIGHT`; None of a kind that was recorded."""
    return made_gestures().get(kind)


def sinks(kind: str) -> bool:
    """Whether a kind was made by a recipe that moves the legs: squats, crouches."""
    made = made_gesture(kind)
    return made is not None and moves_legs(made[0])


def moves_legs(gesture: Gesture) -> bool:
    """Whether a recipe moves the legs."""
    return any(pose.down is not None for pose in gesture.poses.values())


@lru_cache
def made_gestures() -> Mapping[str, tuple[Gesture, int]]:
    """Recipe and side of every kind that was made, those to the left included."""
    return {
        kind: (gesture, side)
        for gesture in recipes()
        for kind, side in ((mirrored(gesture.kind), LEFT), (gesture.kind, RIGHT))
    }
