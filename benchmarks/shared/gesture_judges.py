"""What counts as a nod, as clapping, as a squat: geometric judges of gestures; poses (`poses.py`) are held a moment.

Directions, angles and distances are as in `poses.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.judges import SIDES, reversals
from benchmarks.shared.poses import POSES, arm_line, gaze
from flexmotion.human.kinematics import HumanKinematics
from flexmotion.human.motion import Motion
from flexmotion.human.signals import runs

Float = NDArray[np.float64]

HELD_S = 0.3
"""A pose counts from this duration on [s]."""

NOD, SHAKE = 8.0, 14.0
"""Least change of the head's pitch, of its turning, between two reversals [degrees]."""

CLAP, APART = 0.25, 0.05
"""Greatest distance of clapping fists; least change of it between two reversals [m]."""

BECKON = 0.1
"""Least change of the distance of shoulder and fist between two reversals of a beckoning hand [m]."""

SHAKEN = 0.05
"""Least change of a fist's height between two reversals of a handshake [m]."""


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


def looks_around(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the head turns by an angle to both sides [degrees]."""
    turn = gaze(human)[:, 0]
    return bool((turn - turn[0]).max() >= wanted and (turn - turn[0]).min() <= -wanted)


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


def sinks(motion: Motion, human: HumanKinematics, wanted: float) -> bool:
    """Whether the pelvis goes down by a share of the leg's length, above feet that stay."""
    stays = np.ptp(human.ankle[:, :, :2], axis=0).max() < 0.5 * motion.body.leg
    return bool(POSES["sinks"](motion, human, wanted).any() and stays)


def _held(name: str) -> Callable[[Motion, HumanKinematics, Any], bool]:
    """Whether a pose is held for `HELD_S`."""
    return lambda motion, human, wanted: held(POSES[name](motion, human, wanted), motion.fps)


GESTURE_CHECKS: dict[str, Callable[[Motion, HumanKinematics, Any], bool]] = {
    "nods": nods,
    "shakes": shakes,
    "looks_around": looks_around,
    "claps": claps,
    "beckons": beckons,
    "shakes_hand": shakes_hand,
    "sinks": sinks,
    **{name: _held(name) for name in ("looks", "points", "holds_out", "hand_at", "shows_palm", "opens")},
}
"""By the names that `gesture_prompts.yaml` uses."""
