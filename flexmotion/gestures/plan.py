"""`draw_plan`: one gesture of a recipe, with everything drawn: poses, speeds, holds, number of repetitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.get_up import MINIMUM_JERK_PEAK
from flexmotion.gestures.arm import ArmAngles, arm_angles, hand_in_torso
from flexmotion.gestures.recipes import ArmPose, Gesture, HeadPose, Pose, Span, TrunkPose
from flexmotion.gestures.tracks import Stroke
from flexmotion.human.body import Body
from flexmotion.human.skeleton import LEFT, RIGHT
from flexmotion.spatial.transitions import minimum_jerk

Float = NDArray[np.float64]

BEFORE, AFTER = (0.5, 2.0), (0.5, 1.4)
"""Time in the base before and after a gesture [s]."""

LEAD = (0.0, 0.12)
"""By how much the head is ahead of the arms [s]."""

UNEVEN = 0.12
"""Greatest relative difference of a stroke's speed from the drawn one."""

HANGING = ArmAngles(Rotation.identity(), float(np.radians(15.0)), None)
"""Pose of an arm of the base, for the durations of strokes."""

SAMPLES = 17


@dataclass(frozen=True)
class Targets:
    """What each stroke of a gesture reaches; None for the base.

    Attributes:
        arms: of left and right arm.
        head, trunk: angles beside the base's: extension, bending, rotation, (3,) [rad].
        down: lowering of the pelvis [leg lengths] and its tilt [rad], (2,).
    """

    arms: tuple[tuple[ArmAngles | None, ...], tuple[ArmAngles | None, ...]]
    head: tuple[Float | None, ...]
    trunk: tuple[Float | None, ...]
    down: tuple[Float | None, ...]


@dataclass(frozen=True)
class Plan:
    """A drawn gesture.

    Attributes:
        gesture: its recipe.
        side: `LEFT` or `RIGHT`.
        strokes: in their order; the last one returns to the base.
        targets: of the strokes.
        lead: by how much the head is ahead [s].
        repeats: number of repetitions that were drawn; 1 without any.
        duration: with the time before and after [s].
    """

    gesture: Gesture
    side: int
    strokes: tuple[Stroke, ...]
    targets: Targets
    lead: float
    repeats: int
    duration: float

    @property
    def start(self) -> float:
        """When the body leaves the base [s]."""
        return self.strokes[0].start - self.lead

    @property
    def left(self) -> float:
        """When the body begins to return to the base [s]."""
        return self.strokes[-1].start - self.lead

    @property
    def end(self) -> float:
        """When it is back in the base [s]."""
        return self.strokes[-1].end


def draw_plan(gesture: Gesture, body: Body, side: int, rng: np.random.Generator) -> Plan:
    """Draw everything that a recipe leaves open.

    Args:
        gesture: the recipe.
        body: of the human.
        side: of the gesture, `LEFT` or `RIGHT`.
        rng: random generator.
    """
    drawn = {name: _Drawn(pose, body, side, rng) for name, pose in gesture.poses.items()}
    order: list[tuple[str, float]] = []
    repeats = 1
    for step in gesture.steps:
        times = int(rng.integers(step.count[0], step.count[1] + 1))
        if step.repeat:
            repeats = times
        order += [(name, _within(step.hold, rng)) for _ in range(times) for name in step.names]
    poses: list[_Drawn | None] = [drawn[name] for name, _ in order]
    holds = [hold for _, hold in order]
    poses.append(None)
    speeds = _Speeds(gesture, rng)
    at = _within(BEFORE, rng)
    strokes = []
    for before, after, hold in zip([None, *poses[:-1]], poses, [*holds, 0.0], strict=True):
        duration = speeds.duration(before, after, body) * rng.uniform(1.0, 1.0 + UNEVEN)
        strokes.append(Stroke(at, at + duration))
        at += duration + hold
    targets = Targets(
        arms=(
            tuple(None if pose is None else pose.arms[LEFT] for pose in poses),
            tuple(None if pose is None else pose.arms[RIGHT] for pose in poses),
        ),
        head=tuple(None if pose is None else pose.head for pose in poses),
        trunk=tuple(None if pose is None else pose.trunk for pose in poses),
        down=tuple(None if pose is None else pose.down for pose in poses),
    )
    return Plan(gesture, side, tuple(strokes), targets, _within(LEAD, rng), repeats, at + _within(AFTER, rng))


class _Drawn:
    """A pose with everything drawn."""

    def __init__(self, pose: Pose, body: Body, side: int, rng: np.random.Generator) -> None:
        own, other = pose.arm or pose.both_arms, pose.other_arm or pose.both_arms
        cone = rng.normal(size=3)

        def angles(arm: ArmPose | None, to: int) -> ArmAngles | None:
            if arm is None:
                return None
            # Symmetrical for both arms: the mirror image of a rotation vector in the sagittal plane.
            vector = cone if to == RIGHT else cone * [-1.0, 1.0, -1.0]
            size = np.radians(arm.spread) * min(1.0, float(np.linalg.norm(cone)) / 2.0)
            return arm_angles(arm, body, to, Rotation.from_rotvec(size * vector / max(np.linalg.norm(cone), 1e-9)))

        left, right = (own, other) if side == LEFT else (other, own)
        self.arms = (angles(left, LEFT), angles(right, RIGHT))
        out = 1.0 if side == LEFT else -1.0
        self.head = None if pose.head is None else _neck(pose.head, out, rng)
        self.trunk = None if pose.trunk is None else _lumbar(pose.trunk, out, rng)
        self.down = (
            None if pose.down is None else np.array([_within(pose.down, rng), np.radians(_within(pose.tilt, rng))])
        )


def _neck(head: HeadPose, out: float, rng: np.random.Generator) -> Float:
    """Extension, bending to the right, rotation to the left [rad]."""
    return np.radians([_within(head.up, rng), -out * _within(head.tilt, rng), out * _within(head.turn, rng)])


def _lumbar(trunk: TrunkPose, out: float, rng: np.random.Generator) -> Float:
    return np.radians([-_within(trunk.lean, rng), -out * _within(trunk.bend, rng), out * _within(trunk.turn, rng)])


def _within(span: Span, rng: np.random.Generator) -> float:
    return float(rng.uniform(*span))


class _Speeds:
    """Drawn greatest speeds, and the durations of strokes that follow."""

    def __init__(self, gesture: Gesture, rng: np.random.Generator) -> None:
        self._hand = _within(gesture.hand_speed, rng)
        self._head = np.radians(_within(gesture.head_speed, rng))
        self._trunk = np.radians(_within(gesture.trunk_speed, rng))
        self._sink = _within(gesture.sink_speed, rng)
        self._shortest = gesture.shortest

    def duration(self, before: _Drawn | None, after: _Drawn | None, body: Body) -> float:
        """Duration of a stroke [s], so that no part passes its greatest speed."""
        found = [self._shortest]
        for side in (LEFT, RIGHT):
            ends = [None if pose is None else pose.arms[side] for pose in (before, after)]
            if ends[0] is not None or ends[1] is not None:
                found.append(_greatest_speed(ends, body, side) / self._hand)
        trunk_and_pelvis = [self._sink, self._trunk]
        for name, speed in (("head", self._head), ("trunk", self._trunk), ("down", trunk_and_pelvis)):
            first, second = (None if pose is None else getattr(pose, name) for pose in (before, after))
            way = np.asarray(0.0 if second is None else second) - (0.0 if first is None else first)
            found.append(MINIMUM_JERK_PEAK * float(np.linalg.norm(way / np.asarray(speed))))
        return max(found)


def _greatest_speed(ends: Sequence[ArmAngles | None], body: Body, side: int) -> float:
    """Greatest speed of the hand in a stroke of one second [m/s]."""
    first, second = (HANGING if end is None else end for end in ends)
    passed = np.linspace(0.0, 1.0, SAMPLES)
    done = minimum_jerk(passed)
    arc = (first.humerus.inv() * second.humerus).as_rotvec()
    humerus = first.humerus * Rotation.from_rotvec(done[:, None] * arc)
    hands = hand_in_torso(humerus, first.elbow + done * (second.elbow - first.elbow), body, side)
    steps = np.linalg.norm(np.diff(hands, axis=0), axis=1)
    return float(steps.max() / (passed[1] - passed[0]))
