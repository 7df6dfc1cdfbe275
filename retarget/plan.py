"""`Plan`: this robot's next second or so of motion, one row a control tick, ending in a balanced stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.retarget.steps import Step

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What the retargeter hands to the control loop: references, never servo goals.

    World frame of the robot's plan (x forward and y left of where it started), n joints in the robot's order,
    feet left then right.

    Attributes:
        start_tick: loop tick of row 0.
        stop_row: first row of the stop tail; rows before it follow the human.
        source_s: time of the source that each row follows, (T,) [s]; negative in the lead-in before it, NaN in the
            stop tail.
        q, qd, qdd: joint reference, (T, n) [rad, rad/s, rad/s²].
        torque: joint torque of the reference under its planned ground forces, (T, n) [N·m].
        contacts: which feet carry load, (T, 2) bool.
        feet: sole centres and yaw, (T, 2, 4) [m, m, m, rad].
        base: torso position and quaternion w x y z, (T, 7).
        com: centre of mass, (T, 3) [m]; com_velocity (T, 3) [m/s].
        zmp, dcm: planned zero-moment point and divergent component of motion, (T, 2) [m].
        load_share: share of the weight on the right foot, (T,) in [0, 1].
        states: the retargeter's state at each row, (T, S); a new plan resumes from one of them.
        hand_error: distance of each hand from where the human's hand maps to, (T, 2) [m]; NaN out of reach.
        repairs: how often a reference had to be bent to the robot's limits, by kind.
        steps: footsteps that lift within the plan, each with the human steps left out before it.
        human: the human frames that the plan was made from, on the source's clock from frame `human_first_frame` on, so
            that its successor can blend in from them; None for a stop, and where a plan was handed on without them.
    """

    start_tick: int
    stop_row: int
    source_s: Float
    q: Float
    qd: Float
    qdd: Float
    torque: Float
    contacts: NDArray[np.bool_]
    feet: Float
    base: Float
    com: Float
    com_velocity: Float
    zmp: Float
    dcm: Float
    load_share: Float
    states: Float
    hand_error: Float
    repairs: dict[str, NDArray[np.int64]]
    steps: list[Step]
    human: Motion | None = None
    human_first_frame: int = 0

    def __len__(self) -> int:
        return len(self.q)

    @property
    def end_tick(self) -> int:
        """First tick that the plan no longer covers."""
        return self.start_tick + len(self)
