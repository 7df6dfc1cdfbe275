"""`planted`: the root is moved so that loaded feet neither slide nor leave the floor.

Errors of a degree at every joint of a leg move its foot by centimetres, and the root is no more accurate. Loaded feet
are therefore held in place, except for sideways gliding, and the body moves instead. The legs correct the rest, where
the two feet disagree or a foot lands sooner than the body is lowered.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from flexmotion.compiled import doubles
from flexmotion.human.filters import recursive
from flexmotion.human.kinematics import HumanKinematics, foot_points, forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.kept_feet import LIFTED, kept, resting
from flexmotion.sampling.leg_length import lowered
from flexmotion.sampling.leg_reach import shifted
from flexmotion.sampling.planted_loops import Holds, made_up, remaining, slips, wanted_lifts

Float = NDArray[np.float64]

ROLLING = 0.01
"""Heel and toe are weighted by the exponential of minus their height over this [m]."""

CHOOSING = 0.2
"""The slower of two feet stands: they are weighted by the exponential of minus their speed over this [m/s]."""
MISJUDGED, NEAR = 0.1, 0.05
"""Weight of an unloaded foot that is lower than the second [m] while the other is loaded."""
PLANTED, SWINGING = 1.5, 2.5
"""A foot slower than the first is held, one faster than the second is free, whatever its load [m/s]. Higher than the
limits of a contact detector: the whole body may glide at walking speed."""
GLIDING = 0.3
"""Sideways, feet are held less and less up to this speed, and are free above it [m/s]: the data hold hardly any
sidesteps, and models move sideways by gliding. A robot steps after them."""

ABOVE, BELOW = 0.015, 0.0
"""Range of height of the lower of heel and toe of a standing foot [m]; above 0 as in clips, whose shoes have soles."""

REACHED, SUNK = 0.02, 0.003
"""The leg lowers a loaded foot that remains higher than the first, and raises any foot deeper than the second [m]."""
MOST = 0.03
"""Greatest correction by a leg [m]: it turns a nearly straight knee by 30°."""

SMOOTH, ALONG = (1 / 4, 2 / 4, 1 / 4), (1 / 9, 2 / 9, 3 / 9, 2 / 9, 1 / 9)
"""Filters over frames: of the root's shift, and of the correction by the legs."""

SETTLING_S = 0.05
"""Time constant with which the body is raised or lowered. A window begins at the height where the last one ended, and
reaches the model's height within a few tenths of a second."""

_HOLDS = Holds(ROLLING, CHOOSING, MISJUDGED, NEAR, PLANTED, SWINGING, GLIDING)


def planted(motion: Motion, past: Motion) -> Motion:
    """The motion with its loaded feet in place.

    Args:
        motion: with contacts; without them it is returned as it is.
        past: the motion before it, of the same body and frame rate, at least one frame.
    """
    return planted_slip(motion, foot_points(past[len(past) - 1 :]))[0]


def planted_slip(motion: Motion, before: Float, staying_from: Float | None = None) -> tuple[Motion, Slip | None]:
    """`planted`, and how its feet slipped before; None where nothing is planted.

    Args:
        motion: see `planted`.
        before: heel and toe of both feet in the frame before it, in the world, (1, 2, 2, 3) [m].
        staying_from: joint angles of that frame, (26,) [rad], where the body stays where it is and legs keep feet that
            rest; None: it travels.
    """
    if motion.contacts is None or not len(motion):
        return motion, None
    human = forward(motion)
    feet = np.concatenate([before, _feet(human)])
    height = feet[1:, ..., 2].min(axis=2)
    stays = staying_from is not None
    slip = Slip.of(feet, motion.contacts, human.pelvis_rotation, motion.fps, stays)

    position = motion.root_position.copy()
    position[:, :2] -= np.cumsum(slip.made_up_for, axis=0) / motion.fps
    lift = lifted(height, motion.contacts, motion.fps)
    position[:, 2] += lift
    height += lift[:, None]
    found = motion.changed(root_position=position)
    if staying_from is None:
        return lowered(found, _remaining(height, motion.contacts), human.hip, human.ankle), slip
    feet[1:] += (position - motion.root_position)[:, None, None]
    rests = resting(feet, motion.contacts, motion.fps)
    down = _remaining(height, rests, LIFTED)
    away = np.concatenate([kept(feet, rests, motion.fps), -down[..., None]], axis=-1)
    # Knees that bend backward are straightened first.
    return shifted(lowered(found, np.zeros_like(down), human.hip, human.ankle), away, staying_from), slip


def lifted(height: Float, contacts: NDArray[np.bool_], fps: float) -> Float:
    """How far the body is raised for its loaded feet to stand on the floor, (T,) [m].

    Args:
        height: of the lower of heel and toe of both feet, (T, 2) [m].
        contacts: feet that carry load, (T, 2).
        fps: frames per second.
    """
    return _settled(wanted_lifts(np.ascontiguousarray(height), np.ascontiguousarray(contacts), BELOW, ABOVE), fps)


@dataclass(frozen=True)
class Slip:
    """How the feet of a motion slip at each of T frames, and how much of it the root makes up for.

    Attributes:
        velocity: of both feet along the floor, (T, 2, 2) [m/s].
        parts: weights of heel and toe in it, (T, 2, 2, 1).
        firm: weights of the feet, (T, 2).
        stands: share of a foot's slip that is made up for at its speed, (T, 2).
        facing: heading of the pelvis, (T, 1, 2).
        holds: share of its sideways part, (T, 2, 1).
    """

    velocity: Float
    parts: Float
    firm: Float
    stands: Float
    facing: Float
    holds: Float

    @classmethod
    def of(cls, feet: Float, contacts: NDArray[np.bool_], pelvis: Float, fps: float, stays: bool = False) -> Slip:
        """Of a motion that is not planted yet.

        Args:
            feet: heel and toe of both feet in the frame before, then in each frame, (T + 1, 2, 2, 3) [m].
            contacts: feet that carry load, (T, 2).
            pelvis: rotation, (T, 3, 3).
            fps: frames per second.
            stays: whether the body stays where it is: loaded feet are alike, and none glides.
        """
        own = doubles
        return cls(*slips(own(feet), np.ascontiguousarray(contacts), own(pelvis), fps, stays, _HOLDS))

    @property
    def made_up_for(self) -> Float:
        """Velocity that the root makes up for, (T, 2) [m/s]."""
        return made_up(self.velocity, self.firm, self.stands, self.facing, self.holds, np.array(SMOOTH))

    @property
    def holding(self) -> Holding:
        """The same as a linear map of the feet's places."""
        firm = self.firm / np.maximum(self.firm.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        along = self.facing[..., None] * self.facing[..., None, :]
        held = (firm * self.stands)[..., None, None] * (along + self.holds[..., None] * (np.eye(2) - along))
        return Holding((self.parts / self.parts.sum(axis=2, keepdims=True))[..., 0], held)


@dataclass(frozen=True)
class Holding:
    """How far each foot is held in place at each of T frames.

    Attributes:
        parts: shares of heel and toe in a foot's slip, (T, 2, 2).
        held: part of a foot's slip that the root makes up for, (T, 2, 2, 2): from forward and left of the foot's slip
            to forward and left of the root.
    """

    parts: Float
    held: Float

    def turned(self, yaw: float) -> Holding:
        """The same in axes from which those of the motion are turned by an angle about the vertical [rad]."""
        cosine, sine = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        return Holding(self.parts, turn @ self.held @ turn.T)

    @property
    def gains(self) -> Float:
        """From displacements of heel and toe of both feet to what the root makes up for at once, (T, 2, 8)."""
        found = self.held[:, :, None] * self.parts[..., None, None]  # (T, foot, end, 2, 2)
        return np.moveaxis(found, 3, 1).reshape(len(found), 2, -1)

    def shift(self, feet: Float) -> Float:
        """Displacement of the feet that the root makes up for, (T, 2) [m].

        Args:
            feet: heel and toe of both feet in the frame before, then in each frame, (T + 1, 2, 2, 2 or more) [m].
        """
        moved = np.diff(feet[:, :, :, :2], axis=0)
        return self.summed((self.gains @ moved.reshape(len(moved), -1, 1))[..., 0])

    def summed(self, steps: NDArray) -> NDArray:
        """The displacement up to each frame, of what the root makes up for at each, both (T, ...)."""
        found: NDArray = _summing(len(steps)).astype(steps.dtype) @ steps.reshape(len(steps), -1)
        return found.reshape(steps.shape)


@lru_cache(maxsize=16)
def _filter(weights: tuple[float, ...], frames: int) -> Float:
    """A filter over frames that takes what is beyond both ends as even, (T, T)."""
    found: Float = convolve1d(np.eye(frames), weights, axis=0, mode="nearest")
    return found


@lru_cache(maxsize=8)
def _summing(frames: int) -> Float:
    """Filters displacements over frames as `Slip.made_up_for` does, and sums them, (T, T)."""
    return np.cumsum(_filter(SMOOTH, frames), axis=0)


def _remaining(height: Float, loaded: NDArray[np.bool_], most: float = MOST) -> Float:
    """Distances by which the legs lower the feet: loaded feet to the floor, all feet out of it, (T, 2) [m]."""
    return remaining(
        np.ascontiguousarray(height), np.ascontiguousarray(loaded), REACHED, SUNK, most, MOST, np.array(ALONG)
    )


def _feet(human: HumanKinematics) -> Float:
    """Heel and toe of both feet, (T, 2, 2, 3) [m]."""
    return np.stack([human.heel, human.toe], axis=2)


def _settled(wanted: Float, fps: float) -> Float:
    """`wanted` filtered by a critically damped spring from 0, (T,)."""
    found: Float = _settling(len(wanted), fps) @ wanted
    return found


@lru_cache(maxsize=16)
def _settling(frames: int, fps: float) -> Float:
    """The filter of `_settled`, (T, T)."""
    step = 2.0 / (SETTLING_S * fps)
    # Implicit integration: stable at any frame rate.
    kept, pull = 1.0 / (1.0 + step) ** 2, (step / (1.0 + step)) ** 2
    return recursive([pull], [pull - kept - 1.0, kept], np.eye(frames))
