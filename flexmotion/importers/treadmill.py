"""Velocity of a treadmill's belt: detected in a recording, and removed before it is differentiated.

On a belt both feet move with one constant horizontal velocity whenever they are on it, take turns, come back in swing,
and are never at rest while they are low; the pelvis stays where it is. Feet that slide over the ground move with the
pelvis, and rest at other times. All of it is required: a velocity of the ground that is not there falsifies every
force, a belt that is missed only that clip. Where a clip is too short to show both feet on the belt, one foot that
passes all other tests is reported (`suspected_velocity`), and nothing is removed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from flexmotion.human.signals import runs
from flexmotion.human.vectors import unit
from flexmotion.importers.landmarks import Landmarks

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

SLOWEST = 0.25
"""Slowest belt that is detected [m/s]; the feet of a standing human slide more slowly."""

LOW, STRIDE_S = 0.06, 1.2
"""Greatest height of a toe joint above its lowest within a stride while the foot may be on the floor [m]. Floors of
recordings are not level, so the lowest is taken over the time of a stride [s], before and after."""

TOLERANCE, TOLERANCE_SHARE = 0.08, 0.12
"""Greatest difference between velocities of a foot on the belt and of the belt: a constant [m/s] and a share of the
belt's speed. Feet brake belts by some per cent, and toes roll."""

STANCE_S = 0.1
"""Shortest contact that counts [s]; runners at 6 m/s have the forefoot down for .15 s."""

AT_REST, REST_SHARE = 0.3, 0.15
"""A low foot is at rest while it is slower than this share of the belt for the time of a contact. Greatest ratio of
that time to the time that it moves with the belt."""

FLAT_SHARE = 0.6
"""Share of a contact after which the heel rises and the toe joint rolls forward against the belt."""

COVERED = 0.25
"""Least share of the clip with a foot on the belt; runners spend .3 to .6 of the time on it."""

BOTH_SHARE = 0.6
"""Greatest share of the contact time in which both feet move with the belt at once; walkers spend .15 to .4 so."""

PELVIS_SHARE = 0.4
"""Greatest mean speed of the pelvis as a share of the belt's: it drifts on a belt, and cannot leave it."""

BACK_SHARE = 0.3
"""Least speed of a foot in swing against the belt, as a share of the belt's."""

SMOOTH_S = 0.05
"""Time over which positions are averaged before they are differentiated [s]."""


@dataclass(frozen=True)
class Contact:
    """Time for which one foot moves with the belt: frames from `begin` to before `end`."""

    side: str
    begin: int
    end: int


def belt_velocity(found: Landmarks) -> Float:
    """Horizontal velocity of a treadmill's belt in a recording, (2,) [m/s]; zero where none is detected.

    Args:
        found: joint centres at the rate of the file, at least about 20 Hz.
    """
    velocity, feet = _shared_velocity(found, np.minimum)
    return velocity if feet == 2 else np.zeros(2)


def suspected_velocity(found: Landmarks) -> Float:
    """Velocity of one foot alone that moves as if it were on a belt, (2,) [m/s]; zero where none does.

    Args:
        found: joint centres of a recording without a detected belt, at the rate of the file, at least about 20 Hz.
    """
    for side in (np.minimum, np.maximum):
        velocity, feet = _shared_velocity(found, side)
        if feet == 1:
            return velocity
    return np.zeros(2)


def feet_rest(found: Landmarks, speed: float) -> bool:
    """Whether both feet are at rest while they are low, for whole contacts, against a belt of this speed [m/s]."""
    if len(found) < 4 or len(found) < 3 * STANCE_S * found.fps:
        return False
    toes, speeds, low = _feet(found)
    limit = min(SLOWEST, AT_REST * abs(speed))
    on = {side: low[side] & (np.linalg.norm(speeds[side], axis=-1) < limit) for side in toes}
    contacts = {side: _contacts(side, on[side], found.fps) for side in toes}
    rest = np.zeros(len(found), bool)
    for contact in (*contacts["l"], *contacts["r"]):
        rest[contact.begin : contact.end] = True
    return bool(all(contacts.values()) and rest.mean() >= COVERED)


def _shared_velocity(found: Landmarks, side_of: np.ufunc) -> tuple[Float, int]:
    """Velocity that low feet share as on a belt, (2,) [m/s], and the number of feet that have it; zeros if none has.

    Args:
        side_of: see `_common`.
    """
    none = np.zeros(2), 0
    if len(found) < 4 or len(found) < 3 * STANCE_S * found.fps:
        return none
    toes, speeds, low = _feet(found)
    guess = _common(speeds, low, side_of)
    if guess is None or np.linalg.norm(guess) < SLOWEST:
        return none
    contacts = [
        contact for side in "lr" for contact in _contacts(side, low[side] & _near(speeds[side], guess), found.fps)
    ]
    if not contacts:
        return none
    velocity = _measured(contacts, toes, found.fps)
    if np.linalg.norm(velocity) < SLOWEST:
        return none
    pelvis = _smooth((found.points["hip_l"] + found.points["hip_r"]) / 2, found.fps)[:, :2]
    if not _is_belt(velocity, contacts, speeds, low, pelvis, found.fps):
        return none
    return velocity, len({contact.side for contact in contacts})


def _feet(found: Landmarks) -> tuple[dict[str, Float], dict[str, Float], dict[str, Bool]]:
    """Smoothed toe joints (T, 3) [m], their horizontal velocities (T, 2) [m/s], and where they are low, (T,)."""
    toes = {side: _smooth(found.points[f"toe_{side}"], found.fps) for side in "lr"}
    speeds = {side: np.gradient(toe[:, :2], axis=0) * found.fps for side, toe in toes.items()}
    return toes, speeds, {side: _low(toe[:, 2], found.fps) for side, toe in toes.items()}


def without_belt(found: Landmarks, velocity: Float) -> Landmarks:
    """The same over ground: the belt's velocity (2,) [m/s] is removed from every point."""
    away = np.zeros((len(found), 3))
    away[:, :2] = np.arange(len(found))[:, None] / found.fps * velocity
    return replace(found, points={name: point - away for name, point in found.points.items()})


def backwards(found: Landmarks, speed: float) -> Float:
    """Velocity of a belt of this speed that runs opposite to the median heading of the pelvis, (2,) [m/s]."""
    left = unit((found.points["hip_l"] - found.points["hip_r"])[:, :2])
    forward = unit(np.median(np.stack([left[:, 1], -left[:, 0]], axis=1), axis=0))
    return -speed * forward


def backward_speed(found: Landmarks, velocity: Float) -> float:
    """Speed of a belt opposite to the median heading of the pelvis [m/s]; negative where it runs forwards."""
    return float(velocity @ backwards(found, 1.0))


def _smooth(point: Float, fps: float) -> Float:
    smoothed: Float = uniform_filter1d(point, max(1, round(SMOOTH_S * fps)), axis=0, mode="nearest")
    return smoothed


def _low(height: Float, fps: float) -> Bool:
    low: Bool = height - minimum_filter1d(height, 2 * round(STRIDE_S * fps) + 1, mode="nearest") < LOW
    return low


def tolerance(velocity: Float) -> float:
    """Greatest difference between the velocity of a belt, (2,), and that of a foot on it [m/s]."""
    return float(TOLERANCE + TOLERANCE_SHARE * np.linalg.norm(velocity))


def _near(speeds: Float, velocity: Float) -> Bool:
    near: Bool = np.linalg.norm(speeds - velocity, axis=-1) < tolerance(velocity)
    return near


def _common(speeds: dict[str, Float], low: dict[str, Bool], side_of: np.ufunc) -> Float | None:
    """The velocity that low feet have most often, (2,) [m/s].

    Args:
        side_of: minimum, to count on the side where it is rarer, or maximum, where it is more frequent.
    """
    own = {side: speeds[side][low[side]] for side in speeds}
    if not all(len(values) for values in own.values()):
        return None
    pooled = np.concatenate(list(own.values()))
    candidates = pooled[:: max(1, len(pooled) // 300)]
    width = TOLERANCE + TOLERANCE_SHARE * np.linalg.norm(candidates, axis=-1)
    counts = [
        (np.linalg.norm(values[None] - candidates[:, None], axis=-1) < width[:, None]).sum(axis=1)
        for values in own.values()
    ]
    best = candidates[int(np.argmax(side_of(*counts)))]
    for _ in range(3):
        best = np.median(pooled[_near(pooled, best)], axis=0)
    return best


def _contacts(side: str, on: Bool, fps: float) -> list[Contact]:
    return [Contact(side, begin, end) for begin, end in runs(on) if end - begin >= max(3, STANCE_S * fps)]


def _slopes(contacts: list[Contact], toes: dict[str, Float], fps: float) -> Float:
    """Mean velocity of the foot over the middle of each contact, (contacts, 2) [m/s]."""
    slopes = []
    for contact in contacts:
        length = contact.end - contact.begin
        middle = slice(contact.begin + length // 6, contact.begin + max(length // 6 + 2, round(FLAT_SHARE * length)))
        path = toes[contact.side][middle, :2]
        slopes.append(np.polyfit(np.arange(len(path)) / fps, path, 1)[0])
    return np.array(slopes)


def _measured(contacts: list[Contact], toes: dict[str, Float], fps: float) -> Float:
    """Velocity of the belt as the mean over contacts, weighted by their length, (2,) [m/s]."""
    weights = np.array([contact.end - contact.begin for contact in contacts], float)
    mean: Float = np.average(_slopes(contacts, toes, fps), axis=0, weights=weights)
    return mean


def _is_belt(
    velocity: Float,
    contacts: list[Contact],
    speeds: dict[str, Float],
    low: dict[str, Bool],
    pelvis: Float,
    fps: float,
) -> bool:
    speed = float(np.linalg.norm(velocity))
    along = velocity / speed
    on = {side: np.zeros(len(pelvis), bool) for side in speeds}
    for contact in contacts:
        on[contact.side][contact.begin : contact.end] = True
    either, both = on["l"] | on["r"], on["l"] & on["r"]
    slow = {side: np.linalg.norm(own, axis=-1) < AT_REST * speed for side, own in speeds.items()}
    rests = any(
        sum(rest.end - rest.begin for rest in _contacts(side, low[side] & slow[side], fps))
        > REST_SHARE * on[side].sum()
        for side in speeds
    )
    stays = np.linalg.norm(pelvis[-1] - pelvis[0]) * fps / (len(pelvis) - 1) < PELVIS_SHARE * speed
    returns = max(float(np.max(-(own @ along))) for own in speeds.values()) > BACK_SHARE * speed
    return bool(
        not rests and stays and returns and either.mean() >= COVERED and both.sum() <= BOTH_SHARE * either.sum()
    )
