"""`StepProgress`: what the robot has done in one step of a program, from the loop's rows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.programs import Step
from flexmotion.streamer.planning.repetitions import Repetitions
from flexmotion.streamer.planning.robot_size import RobotSize
from flexmotion.streamer.planning.standstill import STILL_S, Closing, Standstill

Float = NDArray[np.float64]

_REST_RAD = 0.08
"""Joints that move less than this within `STILL_S` are at rest [rad]."""
_HOME_RAD = 0.25
"""A gesture is over when all joints are this close to where they began [rad]."""
_RAISED_RAD = 0.35
"""Arms further than this from the stand pose are raised [rad]."""


@dataclass
class StepProgress:
    """What the robot has done in a step.

    Attributes:
        begin_tick, act_tick: of the step, and of its present attempt or phase.
        place: where the robot stood, as of `measure`.
        ahead, aside, turned: way in the torso's own directions [m], turn [rad].
        joints: measured angles at the step's begin (n,) [rad].
        size: of the robot.
        footsteps: of the walk in its direction so far, those included whose foot is on its way.
        lifted: where each foot lifted off, planned, x and y [m]; None: it stands.
        counts: whether each foot's present step is counted.
        begin_s: time of the human's motion at the step's begin [s]; NaN: none was played.
        played_s: how much of it was played since, which is less than the time where a plan is eased [s].
        acted_from: value at the begin of the attempt, in the amount's unit; of a gesture the number done.
        attempts: number of the present attempt.
        repetitions: gestures begun and done; looked_tick: when they were counted last, None: never.
        deviation: greatest angle of a joint from where it began [rad].
        closing: when the amount is reached.
        standstill: of a robot that was told to stand; None: it was not.
        rested: tick and joints since which the joints have not moved.
    """

    begin_tick: int
    place: Float
    joints: Float
    act_tick: int
    size: RobotSize
    footsteps: int = 0
    lifted: list[Float | None] = field(default_factory=lambda: [None, None])
    counts: list[bool] = field(default_factory=lambda: [False, False])
    begin_s: float = math.nan
    played_s: float = 0.0
    acted_from: float = 0.0
    ahead: float = 0.0
    aside: float = 0.0
    turned: float = 0.0
    attempts: int = 1
    repetitions: Repetitions = field(default_factory=Repetitions)
    looked_tick: int | None = None
    deviation: float = 0.0
    closing: Closing = field(default_factory=Closing)
    standstill: Standstill | None = None
    rested: tuple[int, Float] | None = None

    @classmethod
    def begun(cls, row: TickRow, place: Float, size: RobotSize) -> StepProgress:
        """The progress of a step that begins now."""
        tick = int(row.tick)
        joints, begins = np.array(row.q, float), float(row.source_s)
        return cls(tick, place.copy(), joints, tick, size, begin_s=begins)

    def measure(self, step: Step, row: TickRow, place: Float, *, resting: bool) -> None:
        """Add what the robot did since the last row.

        Args:
            place: where it stands if it stops now (`stopping_place`).
            resting: whether it comes to its stand.
        """
        if math.isfinite(row.source_s):
            self.begin_s = float(row.source_s) if math.isnan(self.begin_s) else self.begin_s
            self.played_s = float(row.source_s) - self.begin_s
        dx, dy, turn = place - self.place
        yaw = 0.5 * (place[2] + self.place[2])
        self.ahead += math.cos(yaw) * dx + math.sin(yaw) * dy
        self.aside += math.cos(yaw) * dy - math.sin(yaw) * dx
        self.turned += turn
        self.place = place
        self._count_footsteps(step, row, resting)
        if np.isfinite(row.q).all():
            self.deviation = float(np.abs(row.q - self.joints).max())

    def steps(self, step: Step) -> int:
        """Steps of a walk; each one sideways is a step of one foot and one of the other."""
        return self.footsteps // 2 if step.axis[1] else self.footsteps

    def arms_rest(self, row: TickRow, rate_hz: float) -> bool:
        """Whether all joints are back where they were, or have not moved for a while."""
        tick, joints = int(row.tick), np.array(row.q, float)
        if self.rested is None or np.abs(joints - self.rested[1]).max() > _REST_RAD:
            self.rested = (tick, joints)
        return self.deviation < _HOME_RAD or (tick - self.rested[0]) / rate_hz >= STILL_S

    def _count_footsteps(self, step: Step, row: TickRow, resting: bool) -> None:
        """Count the steps that carry a foot in the direction of the walk; those of a turn count all.

        Most steps of a robot that comes to a stand only correct its feet. A step counts as soon as its foot is on its
        way: the one after it is fixed soon after. The step with which a walk ends brings the feet together, and is none
        of those that were asked for: while the robot comes to its stand, a step ahead or back passes the other foot.
        """
        for side in (0, 1):
            if bool(row.contact_ref[side]):
                self.lifted[side], self.counts[side] = None, False
                continue
            foot = np.array(row.foot_ref[side], float)
            lifted = self.lifted[side]
            if lifted is None:
                self.lifted[side] = lifted = foot[:2]
            dx, dy = foot[:2] - lifted
            cos, sin = math.cos(foot[3]), math.sin(foot[3])
            carried = step.axis[0] * (cos * dx + sin * dy) + step.axis[1] * (cos * dy - sin * dx)
            if resting and step.axis[0]:
                px, py = foot[:2] - np.array(row.foot_ref[1 - side], float)[:2]
                carried = min(carried, step.axis[0] * (cos * px + sin * py))
            if not self.counts[side] and (step.axis == (0, 0) or carried > self.size.step):
                self.footsteps, self.counts[side] = self.footsteps + 1, True


def is_raised(row: TickRow, home: Float | None) -> bool:
    """Whether an arm is away from the stand pose `home`, (n,) [rad]: NaN where a joint does not count."""
    return home is not None and bool(np.isfinite(row.q).all() and np.nanmax(np.abs(row.q - home)) > _RAISED_RAD)
