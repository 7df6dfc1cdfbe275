"""`RetargetState`: all that the retargeter needs to continue from a tick, as one vector of fixed size.

Each row of a plan carries such a state (through shared memory as well), so that the next plan can resume from any row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.tension import LIMBS
from flexmotion.human.contacts import STATE_SIZE, ContactDetector
from flexmotion.records import Record, column
from flexmotion.retarget.steps import StepRecord, pack_steps

Float = NDArray[np.float64]

SETTLED_STEPS = 3
"""Most steps settled at once: while one foot is in the air, the next step of the other foot may be settled already, and
an inserted step after that."""
LONG_AGO = -1e9
"""Tick of the last touch-down of a robot that has not stepped yet."""


class RetargetState(Record):
    """A view of one state (S,), or of those of all rows of a plan (T, S)."""

    feet: Float = column("f8", 2, 4)
    """Poses of both soles: x, y, z, yaw [m, m, m, rad]."""
    human_feet: Float = column("f8", 2, 2)
    """Positions of the human's feet that the robot's feet represent: x, y [m]; NaN where there are none."""
    com: Float = column("f8", 2)
    dcm: Float = column("f8", 2)
    com_offset: Float = column("f8", 2)
    """Centre of mass minus torso one row before [m]: first guess of the torso's shift."""
    position: Float = column("f8", "channels")
    """Filtered trunk channels and upper-body joints one row before [m, rad]."""
    velocity: Float = column("f8", "channels")
    q: Float = column("f8", 2, "joints")
    """Joint angles of the two rows before this one, newest first [rad]: for derivatives."""
    base: Float = column("f8", 2, 7)
    """Torso position and quaternion w x y z of those rows."""
    steps: StepRecord = column(StepRecord, SETTLED_STEPS)
    """Steps that are under way or settled, in order."""
    consumed: Float = column("f8", 2)
    """Source time up to which the human swings of each foot are used up [s]."""
    landed: Float = column("f8")
    """Tick of the last touch-down."""
    stance: Float = column("f8")
    """The foot that was on the ground before it."""
    source_tick: Float = column("f8")
    """Loop tick of source time 0; NaN before the first human frame."""
    heading: Float = column("f8")
    """Robot yaw minus human yaw [rad]; NaN before the first human frame."""
    yaws: Float = column("f8", 3)
    """Last unwrapped yaw of left foot, right foot and pelvis [rad]; NaN before the first human frame."""
    detector: Float = column("f8", STATE_SIZE)
    """State of the contact detector."""
    ease: Float = column("f8", 2)
    """Pace of the human's clock and size of its motion with which the next plan begins; 1 and 1: nothing is eased."""
    drift: Float = column("f8")
    """Turn of the robot beyond its plans that `heading` takes account of [rad]; NaN before the first human frame."""
    part: Float = column("f8", "channels")
    """Number of the goal whose path each channel follows; 0: none. See `part_paths.PartPaths`."""
    part_from: Float = column("f8", "channels")
    """Where that path begins [rad]."""
    part_speed: Float = column("f8", "channels")
    """Speed at its begin [rad/s]."""
    part_to: Float = column("f8", "channels")
    """The goal [rad]."""
    part_begins: Float = column("f8", "channels")
    """Tick at which it begins."""
    part_due: Float = column("f8", "channels")
    """Tick at which it is at the goal."""
    part_until: Float = column("f8", "channels")
    """Tick until which it holds."""
    part_bound: Float = column("f8", "channels")
    """Bound on the acceleration on the way there and back [rad/s²]; infinite: that of the filter."""
    planted: Float = column("f8", 2)
    """1 where a foot is to stay on the ground where it is, whatever the human does; else 0."""
    tension: Float = column("f8", len(LIMBS))
    """Tension of the human's limbs one row before, in the order of `LIMBS`, in [0, 1]."""
    asked_tension: Float = column("f8", len(LIMBS))
    """Tension that is asked of a limb by itself; NaN: none."""
    placed: Float = column("f8", 5)
    """Where a foot is to be: the fields of `FootGoal` in order; -1: no foot is to be anywhere."""
    astride: Float = column("f8")
    """1 where the feet stay as they have landed, though no human is followed; else 0."""
    part_back: Float = column("f8", "channels")
    """Least time of the way back [s]."""
    upright: Float = column("f8")
    """Tick before which no foot lifts, because hips and trunk are at a place of their own, or on their way back;
    infinite while that holds, -infinite where they follow none."""


@dataclass(frozen=True)
class StateLayout:
    """Sizes of one robot's state.

    Args:
        joints: number of the robot's joints.
        channels: number of trunk channels and upper-body joints.
    """

    joints: int
    channels: int

    @property
    def size(self) -> int:
        """Length of the vector."""
        return RetargetState.dtype(joints=self.joints, channels=self.channels).itemsize // 8

    def view(self, vectors: Float) -> RetargetState:
        """The fields of one state (S,) or of many (T, S); writing a field writes the vectors.

        Raises:
            ValueError: the vectors are not of this size.
        """
        return RetargetState.over(vectors, joints=self.joints, channels=self.channels)

    def initial(self) -> Float:
        """A state without steps, touch-down and human, (S,); pose and balance are 0."""
        vector = np.zeros(self.size)
        state = self.view(vector)
        state.human_feet[...] = np.nan
        state.steps = pack_steps([], SETTLED_STEPS)
        state.consumed[...] = -np.inf
        state.landed[...] = LONG_AGO
        state.source_tick[...] = state.heading[...] = state.yaws[...] = np.nan
        state.detector[...] = ContactDetector().initial()
        state.tension[...] = state.ease[...] = 1.0
        state.part_until[...], state.part_bound[...] = -np.inf, np.inf
        state.placed[...] = -1.0
        state.upright[...] = -np.inf
        state.drift[...] = state.asked_tension[...] = np.nan
        return vector
