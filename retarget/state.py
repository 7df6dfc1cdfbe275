"""`RetargetState`: all that the retargeter must remember to go on from a tick, as one fixed-size vector.

A state per tick travels with each plan (and later through shared memory), so that the next plan can resume from
whichever tick it joins at.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.contacts import STATE_SIZE
from flexmotion.retarget.footsteps import Step
from flexmotion.retarget.whole_body import POSTURE

Float = NDArray[np.float64]

FROZEN_STEPS, STEP_SIZE = 3, 16
"""While a foot is in the air the other's next step may be frozen already, and an inserted one after that."""


class StateLayout:
    """Names slices of the state vector of a robot with `joints` joints, `followed` of them in the upper body."""

    def __init__(self, joints: int, followed: int) -> None:
        channels = len(POSTURE) + followed
        sizes: dict[str, tuple[int, ...]] = {
            "feet": (2, 4),  # where both soles are: x, y, z, yaw
            "human_feet": (2, 2),  # where the human's feet stood that these stand for: x, y; NaN where there are none
            "com": (2,),
            "dcm": (2,),
            "com_offset": (2,),  # centre of mass minus torso one row before: first guess of the base shift
            "position": (channels,),  # followers of trunk and upper body, one row before
            "velocity": (channels,),
            "q": (2, joints),  # the two rows before this one, newest first: for derivatives
            "base": (2, 7),  # torso position and quaternion w x y z of those rows
            "steps": (FROZEN_STEPS, STEP_SIZE),  # steps under way or frozen, in order, as `pack_steps` writes them
            "consumed": (2,),  # source time up to which human swings of each foot are done with
            "landed": (),  # tick of the last touch-down
            "stance": (),  # the foot that carried the robot until then
            "source_tick": (),  # loop tick of source time 0; NaN before the first human frame
            "heading": (),  # robot yaw minus human yaw; NaN before the first human frame
            "yaws": (3,),  # last unwrapped yaw of left foot, right foot, pelvis; NaN before the first frame
            "detector": (STATE_SIZE,),
        }
        self._slices: dict[str, tuple[slice, tuple[int, ...]]] = {}
        start = 0
        for name, shape in sizes.items():
            end = start + int(np.prod(shape, dtype=int))
            self._slices[name] = (slice(start, end), shape)
            start = end
        self.size = start

    def get(self, vector: Float, name: str) -> Float:
        """A field of one state (S,) or of many (T, S)."""
        cut, shape = self._slices[name]
        return vector[..., cut].reshape((*vector.shape[:-1], *shape))

    def scalar(self, vector: Float, name: str) -> float:
        """A field without axes, of one state (S,)."""
        return float(vector[self._slices[name][0]][0])

    def set(self, vector: Float, name: str, value: Float | float, rows: NDArray[np.bool_] | None = None) -> None:
        """Write a field of one state (S,), or of many (T, S), all or those that `rows` (T,) marks.

        Where `rows` is given, `value` belongs to one state and is written to each.
        """
        cut, _ = self._slices[name]
        flat = np.asarray(value, dtype=float)
        if rows is not None:
            vector[rows, cut] = flat.reshape(-1)
        elif vector.ndim == 1:
            vector[cut] = flat.reshape(-1)
        else:
            vector[:, cut] = flat.reshape(len(vector), -1)

    def steps(self, vector: Float) -> list[Step]:
        """The steps that are under way or frozen in one state, in order."""
        return [unpack_step(packed) for packed in self.get(vector, "steps") if packed[0] >= 0]


def pack_steps(steps: list[Step]) -> Float:
    """Steps as a state holds them, (FROZEN_STEPS, STEP_SIZE).

    A row is side (-1: none), lift, land, start (4), target (4), consumed_s, inserted, notice_s, human (2).

    Raises:
        ValueError: more steps than fit.
    """
    if len(steps) > FROZEN_STEPS:
        raise ValueError(f"{len(steps)} steps are settled at once, expected at most {FROZEN_STEPS}")
    packed = np.full((FROZEN_STEPS, STEP_SIZE), -1.0)
    for row, step in zip(packed, steps, strict=False):
        row[:3] = step.side, step.lift, step.land
        row[3:7], row[7:11] = step.start, step.target
        row[11:14] = step.consumed_s, step.inserted, step.notice_s
        row[14:] = step.human
    return packed


def unpack_step(packed: Float) -> Step:
    """The step that a row of `pack_steps` holds, (STEP_SIZE,)."""
    side, lift, land = (int(value) for value in packed[:3])
    consumed_s, inserted, notice_s = packed[11:14]
    return Step(
        side,
        lift,
        land,
        packed[3:7].copy(),
        packed[7:11].copy(),
        float(consumed_s),
        inserted=bool(inserted),
        notice_s=float(notice_s),
        human=packed[14:].copy(),
    )
