"""`Plan`: about a second of this robot's motion, one row a control tick, ending in a balanced stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.retarget.easing import Eased
from flexmotion.retarget.steps import Step

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """References for the control loop, never servo goals.

    In the world frame of the robot's plans (origin and x axis: where it started and faced), n joints in the robot's
    order, feet left then right.

    Attributes:
        start_tick: loop tick of row 0.
        stop_row: first row of the stop tail; rows before it follow the human.
        source_s: source time of each row, (T,) [s]; negative in the lead-in before the source starts, NaN in the stop
            tail.
        q, qd, qdd: joint reference, (T, n) [rad, rad/s, rad/s²].
        torque: joint torque of the reference under its planned ground forces, (T, n) [N·m].
        stiffness: of each joint as a share of the robot file's, (T, n) in (0, 1]; 1: all of it.
        contacts: which feet carry load, (T, 2) bool.
        feet: sole centres and yaw, (T, 2, 4) [m, m, m, rad].
        base: torso position and quaternion w x y z, (T, 7).
        com: centre of mass, (T, 3) [m]; com_velocity (T, 3) [m/s].
        zmp, dcm: planned zero-moment point and divergent component of motion, (T, 2) [m].
        load_share: share of the weight on the right foot, (T,) in [0, 1].
        states: the retargeter's state at each row, (T, S); a new plan resumes from one of them.
        hand_error: distance of each hand from its target, (T, 2) [m]; NaN out of reach and between source frames.
        repairs: number of references that were bounded to the robot's limits, by kind, (T,) each.
        steps: footsteps that lift within the plan, each with the number of human steps left out before it.
        withheld: steps of the human that are not made because a foot is to stay where it is; 0 for a plan from shared
            memory.
        torque_cap: greatest torque that goals of arms and head may imply, (n,) [N·m]; infinite where there is none.
        asked_cap: the same as it was asked for, of all joints, (n,) [N·m]; those of legs bind the plan alone.
        eased: what it was eased to, and why; None where plans are not judged, and for a plan from shared memory.
        human: the human frames that the plan was made from, from source frame `human_first_frame` on, so that the next
            plan can blend from them; None for a stop, and for a plan from shared memory.
    """

    start_tick: int
    stop_row: int
    source_s: Float
    q: Float
    qd: Float
    qdd: Float
    torque: Float
    stiffness: Float
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
    torque_cap: Float
    asked_cap: Float
    withheld: int = 0
    eased: Eased | None = None
    human: Motion | None = None
    human_first_frame: int = 0

    def __len__(self) -> int:
        return len(self.q)

    @property
    def end_tick(self) -> int:
        """First tick after the plan."""
        return self.start_tick + len(self)
