"""Poses, frame by frame: what counts as looking, pointing, holding a hand out, standing bowed or squatting.

Directions are seen from the pelvis: x ahead where it faces, y left, z up. Angles are in degrees, distances in metres,
or in leg and arm lengths where it says so. Every pose is a function of a motion, its kinematics, and what a prompt's
check asks for; it returns the frames in which the human is in it, (T,).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.judges import SIDES
from flexmotion.gestures.arm import landmark
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.human.motion import Motion
from flexmotion.human.vectors import unit
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXTENDED = 0.9
"""Least distance of shoulder and fist of an arm that points, in its length."""

PALM = 0.5
"""Least share of a palm's direction that faces ahead."""

OPEN = (40.0, 130.0)
"""Elbow flexion of open arms: forearms away from hanging and from a pointing arm [degrees]."""


def gaze(human: HumanKinematics) -> Float:
    """Turning to the left, pitch up and tilt to the right of the head against the pelvis' heading, (T, 3) [degrees].

    Turning is that of head and trunk together and goes on beyond half a turn.
    """
    head = from_pelvis(human, human.head_rotation.transpose(0, 2, 1))
    ahead, left = head[:, 0], head[:, 1]
    turn = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    pitch = np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0))
    return np.degrees(np.stack([turn, pitch, np.arcsin(np.clip(left[:, 2], -1.0, 1.0))], axis=1))


def from_pelvis(human: HumanKinematics, vectors: Float) -> Float:
    """World vectors (T, K, 3) in level axes that face where the pelvis does."""
    yaw = continuous_matrix_heading(human.pelvis_rotation)[:, None]
    x, y = np.cos(yaw), np.sin(yaw)
    return np.stack(
        [
            x * vectors[..., 0] + y * vectors[..., 1],
            x * vectors[..., 1] - y * vectors[..., 0],
            vectors[..., 2],
        ],
        axis=-1,
    )


def looking(motion: Motion, human: HumanKinematics, wanted: Mapping[str, float]) -> Mask:
    """The head is beyond angles against its first frame: `turn` left, `up`, `tilt` right [degrees]."""
    angles = gaze(human)
    moved = angles - angles[0]
    mask = np.ones(len(moved), np.bool_)
    for column, name in enumerate(("turn", "up", "tilt")):
        limit = wanted.get(name, 0.0)
        if limit:
            mask &= moved[:, column] >= limit if limit > 0 else moved[:, column] <= limit
    return mask


def arm_line(human: HumanKinematics, side: int) -> Float:
    """From a shoulder to its fist, seen from the pelvis, (T, 3) [m]."""
    return from_pelvis(human, (human.hand[:, side] - human.shoulder[:, side])[:, None])[:, 0]


def pointing(motion: Motion, human: HumanKinematics, wanted: Mapping[str, Any]) -> Mask:
    """The arms of a side (`hand`) are straight in a direction (`to`) within an angle (`within`).

    `to` is [ahead, outward, up]; outward is away from the midline. The other hand hangs where only one points.
    """
    size, mask = motion.body.segments, np.ones(len(motion), np.bool_)
    for side in SIDES[wanted["hand"]]:
        line = arm_line(human, side)
        to = unit(np.asarray(wanted["to"], np.float64) * [1.0, 1.0 if side == 0 else -1.0, 1.0])
        mask &= np.linalg.norm(line, axis=1) >= EXTENDED * (size.arm + size.hand)
        mask &= unit(line) @ to >= np.cos(np.radians(wanted["within"]))
    return mask & others_low(human, wanted["hand"])


def holding_out(motion: Motion, human: HumanKinematics, wanted: str) -> Mask:
    """A hand is held out: half an arm's length before its shoulder, between hip and shoulder in height."""
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES[wanted]:
        mask &= arm_line(human, side)[:, 0] >= 0.5 * motion.body.segments.arm
        mask &= human.hand[:, side, 2] < human.shoulder[:, side, 2]
        mask &= human.hand[:, side, 2] > human.pelvis_position[:, 2]
    return mask & others_low(human, wanted)


def hand_at(motion: Motion, human: HumanKinematics, wanted: Mapping[str, Any]) -> Mask:
    """The fists of a side (`hand`) are near a landmark (`of`, see `arm.landmark`), `within` [m].

    `bent`: least flexion of the elbows [degrees]; a hanging hand is near the hip as well.
    """
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES[wanted["hand"]]:
        place = landmark(wanted["of"], motion.body, 1.0 if side == 0 else -1.0)
        # Landmarks are in the axes of the torso, whose origin is the lumbar joint.
        middle = human.shoulder.mean(axis=1)
        size = motion.body.segments
        origin = middle - human.torso_rotation @ np.array([size.shoulder_forward, 0.0, size.shoulder_height])
        there = origin + human.torso_rotation @ place
        mask &= np.linalg.norm(human.hand[:, side] - there, axis=1) <= wanted["within"]
        mask &= elbow_bend(human, side) >= wanted.get("bent", 0.0)
    return mask & others_low(human, wanted["hand"])


def elbow_bend(human: HumanKinematics, side: int) -> Float:
    """Flexion of an elbow, (T,) [degrees]."""
    upper, forearm = human.elbow[:, side] - human.shoulder[:, side], human.wrist[:, side] - human.elbow[:, side]
    return np.degrees(np.arccos(np.clip(np.sum(unit(upper) * unit(forearm), axis=1), -1.0, 1.0)))


def showing_palm(motion: Motion, human: HumanKinematics, wanted: str) -> Mask:
    """A hand is before its shoulder, above its elbow, with the palm ahead."""
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES[wanted]:
        palm = from_pelvis(human, human.hand_rotation[:, side, None, :, 0])[:, 0]
        mask &= (palm[:, 0] >= PALM) & (human.hand[:, side, 2] > human.elbow[:, side, 2])
        mask &= arm_line(human, side)[:, 0] >= 0.5 * motion.body.segments.arm
    return mask & others_low(human, wanted)


def opening(motion: Motion, human: HumanKinematics, wanted: float) -> Mask:
    """Both fists are outside their elbows by a distance [m], on bent arms below the shoulders."""
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES["both"]:
        out = 1.0 if side == 0 else -1.0
        forearm = from_pelvis(human, (human.hand[:, side] - human.elbow[:, side])[:, None])[:, 0]
        bend = elbow_bend(human, side)
        mask &= (out * forearm[:, 1] >= wanted) & (bend > OPEN[0]) & (bend < OPEN[1])
        mask &= human.hand[:, side, 2] < human.shoulder[:, side, 2]
    return mask


def others_low(human: HumanKinematics, hand: str) -> Mask:
    """Frames in which the hands that are not named are below the chest, (T,)."""
    mask = np.ones(len(human), np.bool_)
    for side in set(SIDES["both"]) - set(SIDES[hand]):
        mask &= human.hand[:, side, 2] < 0.5 * (human.shoulder[:, side, 2] + human.pelvis_position[:, 2])
    return mask


def leaning(motion: Motion, human: HumanKinematics, wanted: float) -> Mask:
    """The torso leans by an angle, in whatever direction [degrees]."""
    return np.asarray(human.torso_rotation[:, 2, 2] <= np.cos(np.radians(wanted)))


def raising(motion: Motion, human: HumanKinematics, wanted: str) -> Mask:
    """Each wanted wrist is above its shoulder."""
    sides = list(SIDES[wanted])
    return np.asarray((human.wrist[:, sides, 2] > human.shoulder[:, sides, 2]).all(axis=1))


def sinking(motion: Motion, human: HumanKinematics, wanted: float) -> Mask:
    """The pelvis is lower than in the first frame by a share of the leg's length."""
    height = human.pelvis_position[:, 2]
    return np.asarray((height[0] - height) / motion.body.leg >= wanted)


POSES: dict[str, Callable[[Motion, HumanKinematics, Any], Mask]] = {
    "looks": looking,
    "points": pointing,
    "holds_out": holding_out,
    "hand_at": hand_at,
    "shows_palm": showing_palm,
    "opens": opening,
    "leans": leaning,
    "rises": raising,
    "sinks": sinking,
}
"""By the names of the checks that `prompts.yaml` and `gesture_prompts.yaml` use; other checks ask for motion."""
