"""What counts as a nod, as pointing, as a squat: geometric judges of gestures.

Directions are seen from the pelvis: x ahead where it faces, y left, z up. Angles are in degrees, distances in metres,
or in leg and arm lengths where it says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.judges import SIDES, at_least, reversals
from flexmotion.dataset.gestures.arm import landmark
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.human.motion import Motion
from flexmotion.human.signals import runs
from flexmotion.human.vectors import unit
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

HELD_S = 0.3
"""A pose counts from this duration on [s]."""

NOD, SHAKE = 8.0, 14.0
"""Least change of the head's pitch, of its turning, between two reversals [degrees]."""

EXTENDED = 0.9
"""Least distance of shoulder and fist of an arm that points, in its length."""

CLAP, APART = 0.25, 0.05
"""Greatest distance of clapping fists; least change of it between two reversals [m]."""

BECKON = 0.1
"""Least change of the distance of shoulder and fist between two reversals of a beckoning hand [m]."""

SHAKEN = 0.05
"""Least change of a fist's height between two reversals of a handshake [m]."""

PALM = 0.5
"""Least share of a palm's direction that faces ahead."""

OPEN = (40.0, 130.0)
"""Elbow flexion of open arms: forearms away from hanging and from a pointing arm [degrees]."""


def gaze(human: HumanKinematics) -> Float:
    """Turning to the left, pitch up and tilt to the right of the head against the pelvis' heading, (T, 3) [degrees].

    Turning is that of head and trunk together and goes on beyond half a turn.
    """
    head = _from_pelvis(human, human.head_rotation.transpose(0, 2, 1))
    ahead, left = head[:, 0], head[:, 1]
    turn = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    pitch = np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0))
    return np.degrees(np.stack([turn, pitch, np.arcsin(np.clip(left[:, 2], -1.0, 1.0))], axis=1))


def _from_pelvis(human: HumanKinematics, vectors: Float) -> Float:
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


def held(mask: NDArray[np.bool_], fps: float) -> bool:
    """Whether something lasts for `HELD_S`, (T,)."""
    return any(end - first >= HELD_S * fps for first, end in runs(mask))


def neck(human: HumanKinematics) -> Float:
    """Turning to the left and pitch up of the head against the trunk, (T, 2) [degrees]: a walk turns both."""
    ahead = np.einsum("tji,tj->ti", human.torso_rotation, human.head_rotation[:, :, 0])
    angles = [np.arctan2(ahead[:, 1], ahead[:, 0]), np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0))]
    return np.degrees(np.stack(angles, axis=1))


def nods(motion: Motion, human: HumanKinematics, wanted: int) -> bool:
    """Whether the head's pitch turns back at least so often."""
    return reversals(neck(human)[:, 1], NOD) >= wanted


def shakes(motion: Motion, human: HumanKinematics, wanted: int) -> bool:
    """Whether the head's turning turns back at least so often."""
    return reversals(neck(human)[:, 0], SHAKE) >= wanted


def looks(motion: Motion, human: HumanKinematics, wanted: Mapping[str, float]) -> bool:
    """Whether the head is held beyond angles against its first frame: `turn` left, `up`, `tilt` right [degrees]."""
    angles = gaze(human)
    moved = angles - angles[0]
    mask = np.ones(len(moved), np.bool_)
    for column, name in enumerate(("turn", "up", "tilt")):
        limit = wanted.get(name, 0.0)
        if limit:
            mask &= moved[:, column] >= limit if limit > 0 else moved[:, column] <= limit
    return held(mask, motion.fps)


def looks_around(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the head turns by an angle to both sides [degrees]."""
    turn = gaze(human)[:, 0]
    return bool((turn - turn[0]).max() >= wanted and (turn - turn[0]).min() <= -wanted)


def arm_line(human: HumanKinematics, side: int) -> Float:
    """From a shoulder to its fist, seen from the pelvis, (T, 3) [m]."""
    return _from_pelvis(human, (human.hand[:, side] - human.shoulder[:, side])[:, None])[:, 0]


def points(motion: Motion, human: HumanKinematics, wanted: Mapping[str, Any]) -> bool:
    """Whether the arms of a side (`hand`) are held straight in a direction (`to`) within an angle (`within`).

    `to` is [ahead, outward, up]; outward is away from the midline. The other hand hangs where only one points.
    """
    size, mask = motion.body.segments, np.ones(len(motion), np.bool_)
    for side in SIDES[wanted["hand"]]:
        line = arm_line(human, side)
        to = unit(np.asarray(wanted["to"], np.float64) * [1.0, 1.0 if side == 0 else -1.0, 1.0])
        mask &= np.linalg.norm(line, axis=1) >= EXTENDED * (size.arm + size.hand)
        mask &= unit(line) @ to >= np.cos(np.radians(wanted["within"]))
    return held(mask & _others_low(human, wanted["hand"]), motion.fps)


def holds_out(motion: Motion, human: HumanKinematics, wanted: str) -> bool:
    """Whether a hand is held out: half an arm's length before its shoulder, between hip and shoulder in height."""
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES[wanted]:
        mask &= arm_line(human, side)[:, 0] >= 0.5 * motion.body.segments.arm
        mask &= human.hand[:, side, 2] < human.shoulder[:, side, 2]
        mask &= human.hand[:, side, 2] > human.pelvis_position[:, 2]
    return held(mask & _others_low(human, wanted), motion.fps)


def hand_at(motion: Motion, human: HumanKinematics, wanted: Mapping[str, Any]) -> bool:
    """Whether the fists of a side (`hand`) are held near a landmark (`of`, see `arm.landmark`), `within` [m].

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
    return held(mask & _others_low(human, wanted["hand"]), motion.fps)


def elbow_bend(human: HumanKinematics, side: int) -> Float:
    """Flexion of an elbow, (T,) [degrees]."""
    upper, forearm = human.elbow[:, side] - human.shoulder[:, side], human.wrist[:, side] - human.elbow[:, side]
    return np.degrees(np.arccos(np.clip(np.sum(unit(upper) * unit(forearm), axis=1), -1.0, 1.0)))


def shows_palm(motion: Motion, human: HumanKinematics, wanted: str) -> bool:
    """Whether a hand is held before its shoulder, above its elbow, with the palm ahead."""
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES[wanted]:
        palm = _from_pelvis(human, human.hand_rotation[:, side, None, :, 0])[:, 0]
        mask &= (palm[:, 0] >= PALM) & (human.hand[:, side, 2] > human.elbow[:, side, 2])
        mask &= arm_line(human, side)[:, 0] >= 0.5 * motion.body.segments.arm
    return held(mask & _others_low(human, wanted), motion.fps)


def claps(motion: Motion, human: HumanKinematics, wanted: int) -> bool:
    """Whether the fists come together at least so often, before the trunk."""
    apart = np.linalg.norm(human.hand[:, 0] - human.hand[:, 1], axis=1)
    ahead = np.minimum(arm_line(human, 0)[:, 0], arm_line(human, 1)[:, 0]) > 0.1
    return any(
        np.min(apart[first:end], initial=np.inf) <= CLAP and reversals(apart[first:end], APART) >= 2 * wanted - 1
        for first, end in runs(ahead)
    )


def beckons(motion: Motion, human: HumanKinematics, wanted: Mapping[str, Any]) -> bool:
    """Whether a hand (`hand`) before the body comes nearer to its shoulder and back at least `times`."""
    (side,) = SIDES[wanted["hand"]]
    line = arm_line(human, side)
    ahead = (line[:, 0] > 0.1) & (human.hand[:, side, 2] > human.pelvis_position[:, 2])
    found = [reversals(np.linalg.norm(line[first:end], axis=1), BECKON) for first, end in runs(ahead)]
    return max(found, default=0) >= 2 * wanted["times"] - 1


def shakes_hand(motion: Motion, human: HumanKinematics, wanted: Mapping[str, Any]) -> bool:
    """Whether a hand (`hand`) is held out and goes up and down at least `times`."""
    (side,) = SIDES[wanted["hand"]]
    out = arm_line(human, side)[:, 0] >= 0.4 * motion.body.segments.arm
    found = [reversals(human.hand[first:end, side, 2], SHAKEN) for first, end in runs(out)]
    return max(found, default=0) >= 2 * wanted["times"] - 1


def opens(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether both fists are held outside their elbows by a distance [m], on bent arms below the shoulders."""
    mask = np.ones(len(motion), np.bool_)
    for side in SIDES["both"]:
        out = 1.0 if side == 0 else -1.0
        forearm = _from_pelvis(human, (human.hand[:, side] - human.elbow[:, side])[:, None])[:, 0]
        upper = unit(human.elbow[:, side] - human.shoulder[:, side])
        bend = np.degrees(
            np.arccos(np.clip(np.sum(upper * unit(human.wrist[:, side] - human.elbow[:, side]), axis=1), -1, 1))
        )
        mask &= (out * forearm[:, 1] >= wanted) & (bend > OPEN[0]) & (bend < OPEN[1])
        mask &= human.hand[:, side, 2] < human.shoulder[:, side, 2]
    return held(mask, motion.fps)


def sinks(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the pelvis goes down by a share of the leg's length, above feet that stay."""
    height = human.pelvis_position[:, 2]
    stays = np.ptp(human.ankle[:, :, :2], axis=0).max() < 0.5 * motion.body.leg
    return at_least(float((height[0] - height.min()) / motion.body.leg), wanted) and bool(stays)


def _others_low(human: HumanKinematics, hand: str) -> NDArray[np.bool_]:
    """Frames in which the hands that are not named are below the chest, (T,)."""
    mask = np.ones(len(human), np.bool_)
    for side in set(SIDES["both"]) - set(SIDES[hand]):
        mask &= human.hand[:, side, 2] < 0.5 * (human.shoulder[:, side, 2] + human.pelvis_position[:, 2])
    return mask


GESTURE_CHECKS: dict[str, Callable[[Motion, HumanKinematics, Any], bool]] = {
    "nods": nods,
    "shakes": shakes,
    "looks": looks,
    "looks_around": looks_around,
    "points": points,
    "holds_out": holds_out,
    "hand_at": hand_at,
    "shows_palm": shows_palm,
    "claps": claps,
    "beckons": beckons,
    "shakes_hand": shakes_hand,
    "opens": opens,
    "sinks": sinks,
}
"""By the names that `gesture_prompts.yaml` uses."""
