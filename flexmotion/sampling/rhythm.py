"""`Rhythm`: gestures of strokes that are repeated (nods, claps, shrugs), over the human that a model samples.

A window of the model is one latent, and latents keep too little of such strokes: of nods 40 % of the angle, of claps
63 % of the way (docs/decisions.md). The model stands; the recipe from which its training clips of the gesture were made
moves head and arms. Forces are those of the motion that results.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.smoothing import CUTOFF, smoothing_spline
from flexmotion.gestures.moved import moved, moving
from flexmotion.gestures.plan import Plan, draw_plan
from flexmotion.gestures.recipes import Gesture, Pose, Step, usual
from flexmotion.gestures.tracks import Stroke
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.sampling.led_path import KNOWN, led_along
from flexmotion.sampling.made_gestures import made_gestures
from flexmotion.text.phrases import is_pose

Float = NDArray[np.float64]

TURNS = 4
"""Repetitions after which the strokes are the same again: their durations differ a little, as people's do."""

SIZES = 8
"""Draws of what a recipe leaves open of its poses. All last as long as the usual one: repetitions are counted alike."""

BETWEEN, PAUSE = "between", (0.3, 0.9)
"""Pose between two repetitions of a gesture of one pose (a shrug), and for how long it is held [s]."""

BEYOND_S = 0.23
"""Time on both sides of a window that its low-passed path is made from [s]: more changes it by less than .02°."""

SLOWEST = 0.3
"""Least factor on its speed."""


@dataclass(frozen=True, eq=False)
class Rhythm:
    """One gesture without an end.

    Attributes:
        plan: strokes of `TURNS` repetitions and of the first pose after them.
        rest: joint angles that it begins from, (26,) [rad].
        poses: of one repetition.
        usual: repetitions of it where a sequence does not say how many.
        shortest: least duration of a stroke [s].
        speed: factor on the speed of the recipe.
        frame: how many frames ago it began.
    """

    plan: Plan
    rest: Float
    poses: int
    usual: int
    shortest: float
    speed: float = 1.0
    frame: int = 0

    @classmethod
    def of(cls, kind: str, body: Body, rest: Float, size: int = 0) -> Rhythm:
        """The gesture of a kind.

        Args:
            kind: one of `rhythm_kinds`.
            body: of the human.
            rest: see `Rhythm`.
            size: which of its `SIZES`, any number.

        Raises:
            KeyError: it is another kind of motion.
        """
        gesture, side = _recipes()[kind]
        once = [name for step in gesture.steps for name in step.names]
        endless = gesture.model_copy(update=_endless(gesture))
        timed, sized = (
            draw_plan(own, body, side, np.random.default_rng(seed))
            for own, seed in ((usual(endless), 0), (endless, size % SIZES))
        )
        # Arms and head are to be the same again at the same time.
        plan = replace(timed, targets=sized.targets, lead=0.0)
        return cls(plan, rest, max(len(once), 2), sum(gesture.steps[0].count) // 2, gesture.shortest)

    def later(self, frames: int) -> Rhythm:
        """The gesture so many frames later."""
        return replace(self, frame=self.frame + frames)

    def paced(self, factor: float) -> Rhythm:
        """The gesture, faster or slower by a factor, as far as its strokes go."""
        briefest = min(stroke.end - stroke.start for stroke in self.plan.strokes)
        factor = min(max(factor, SLOWEST / self.speed), max(briefest / self.shortest, 1.0))
        start = self.plan.start
        strokes = tuple(
            Stroke(start + (stroke.start - start) / factor, start + (stroke.end - start) / factor)
            for stroke in self.plan.strokes
        )
        return replace(self, plan=replace(self.plan, strokes=strokes), speed=self.speed * factor)

    def seconds(self, times: int) -> float:
        """Time from its begin until it is done so often, once or more [s]."""
        turns, last = divmod(times - 1, TURNS)
        ends = self._reached((last + 1) * self.poses - 1) - self.plan.strokes[0].start
        return turns * self._period + ends

    def times(self, seconds: float) -> int:
        """How often it is done after a time [s]."""
        found = 0
        while self.seconds(found + 1) <= seconds:
            found += 1
        return found

    def kept(self, window: Motion, before: Motion) -> Motion:
        """A window with the gesture, over what its other joints do; angles and speeds go on from those before.

        Args:
            window: as sampled, standing.
            before: the motion up to the window, at least one frame.
        """
        columns = moving(self.plan)
        path = self._path(np.arange(1 - KNOWN, 1 + len(window)), window.fps)
        return led_along(window, before, path[:, columns], columns)

    def _path(self, frames: NDArray[np.int_], fps: float) -> Float:
        """Joint angles in frames from now on, low-passed as recorded motion is, (T,) -> (T, 26) [rad]."""
        beyond = ceil(BEYOND_S * fps)
        wider = np.arange(frames[0] - beyond, frames[-1] + beyond + 1)
        found: Float = _low_pass(len(wider), fps) @ self._angles((self.frame + wider) / fps)
        return found

    def _angles(self, since: Float) -> Float:
        """Joint angles at times since the begin, (T,) [s] -> (T, 26) [rad]."""
        first = self._reached(0)
        times = self.plan.strokes[0].start + since
        times = np.where(times < first, times, first + np.mod(times - first, self._period))
        return moved(np.tile(self.rest, (len(times), 1)), times, self.plan)

    @property
    def _period(self) -> float:
        """Time after which the strokes are the same again [s]."""
        return self._reached(TURNS * self.poses) - self._reached(0)

    def _reached(self, stroke: int) -> float:
        """When a stroke ends, in the time of the plan [s]."""
        return self.plan.strokes[stroke].end


@lru_cache(maxsize=8)
def _low_pass(frames: int, fps: float) -> Float:
    """Matrix of the filter of recorded motion, for all but `BEYOND_S` at both ends, (T - 2 B, T)."""
    beyond = ceil(BEYOND_S * fps)
    return smoothing_spline(np.eye(frames), fps, CUTOFF)[beyond:-beyond]


def _endless(gesture: Gesture) -> dict[str, Any]:
    """Poses and steps of a recipe that is repeated without an end."""
    first, *more = gesture.steps
    if first.repeat:
        return {"steps": (first.model_copy(update={"count": (TURNS + 1, TURNS + 1)}),)}
    between = () if more else (Step(pose=BETWEEN, hold=PAUSE),)
    return {"poses": gesture.poses | {BETWEEN: Pose()}, "steps": (*gesture.steps, *between) * (TURNS + 1)}


def is_rhythm(gesture: Gesture) -> bool:
    """Whether a gesture of arms and head ends by itself, so that it is done again and again: no pose that is held."""
    return not is_pose(gesture.kind) and all(pose.down is None for pose in gesture.poses.values())


@lru_cache
def _recipes() -> Mapping[str, tuple[Gesture, int]]:
    """Recipe and side of every rhythm by its kind, those to the left included."""
    return {kind: made for kind, made in made_gestures().items() if is_rhythm(made[0])}


def rhythm_kinds() -> frozenset[str]:
    """Kinds of every rhythm, those to the left included."""
    return frozenset(_recipes())
