"""`RunRecord`: what one run did, tick by tick; the loop fills it, the report, plots and log read it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Event:
    """Something worth a line in the log: a change of state, a fault, a warning."""

    tick: int
    kind: str
    message: str


@dataclass(frozen=True)
class PlanEvent:
    """One plan: when it was asked for and joined (ticks), and what it cost on the wall clock [s]."""

    asked_tick: int
    join_tick: int
    sample_s: float
    retarget_s: float


@dataclass
class RunRecord:
    """Arrays with one row a tick (row count = `ticks`, filled up to `used`), n = number of joints.

    Attributes:
        rate_hz: ticks per second.
        joint_names: the robot's joints in column order.
        state: the safety ladder's state, (T,) int (`streamer.ladder.State` values).
        source_s: time of the source (clip) that the reference of this tick comes from, (T,) [s]; NaN when none plays.
        q_ref, qd_ref, torque_ref: reference from the plan, (T, n) [rad, rad/s, N·m].
        q_cmd: goal that was sent, (T, n) [rad]; NaN when nothing was sent.
        q, qd: measured, (T, n).
        com_ref, com, dcm_ref, dcm, zmp_ref: horizontal plane of the planned world, (T, 2) [m]; `com`/`dcm` are
            estimates from encoders, IMU and the stance foot.
        foot_ref: planned sole centre and yaw of the left and right foot, (T, 2, 4) [m, m, m, rad].
        contact_ref: planned contact of left and right foot, (T, 2) bool.
        base_ref: planned torso position and quaternion (w x y z), (T, 7).
        hand_error: distance of each hand's reference from where the human's hand maps to, (T, 2) [m]; NaN where out
            of reach or between two frames of the source.
        true_*: ground truth from a simulation (see `drivers.interface.Truth`), NaN elsewhere:
            true_base (T, 7), true_q (T, n), true_foot (T, 2, 3), true_foot_velocity (T, 2, 3),
            true_foot_force (T, 2, 3), true_torque (T, n), true_saturated (T, n), true_com (T, 3),
            true_self_contact (T,) bool.
        work_s, lateness_s: time the tick's work took and how late it woke, (T,) [s].
        events, plans: in order of tick.
        repairs: count of repairs by kind (position, speed, acceleration, torque), of planner and loop together.
        steps_planned, steps_inserted, human_steps: footsteps that the robot made, those of them that it made to set
            its feet right, and those that the human made.
        missed_deadlines, underruns, violations_sent: counts.
    """

    rate_hz: float
    joint_names: tuple[str, ...]
    ticks: int
    used: int = 0
    events: list[Event] = field(default_factory=list)
    plans: list[PlanEvent] = field(default_factory=list)
    repairs: dict[str, int] = field(default_factory=lambda: {"position": 0, "speed": 0, "acceleration": 0, "torque": 0})
    steps_planned: int = 0
    steps_inserted: int = 0
    human_steps: int = 0
    missed_deadlines: int = 0
    underruns: int = 0
    violations_sent: int = 0

    def __post_init__(self) -> None:
        t, n = self.ticks, len(self.joint_names)

        def rows(*shape: int) -> Float:
            return np.full((t, *shape), np.nan)

        self.state = np.zeros(t, np.int64)
        self.source_s = rows()
        self.q_ref, self.qd_ref, self.torque_ref = rows(n), rows(n), rows(n)
        self.q_cmd, self.q, self.qd = rows(n), rows(n), rows(n)
        self.com_ref, self.com, self.dcm_ref, self.dcm, self.zmp_ref = (rows(2) for _ in range(5))
        self.foot_ref, self.contact_ref = rows(2, 4), np.zeros((t, 2), np.bool_)
        self.base_ref = rows(7)
        self.hand_error = rows(2)
        self.true_base, self.true_q, self.true_com = rows(7), rows(n), rows(3)
        self.true_foot, self.true_foot_velocity, self.true_foot_force = rows(2, 3), rows(2, 3), rows(2, 3)
        self.true_torque, self.true_saturated = rows(n), rows(n)
        self.true_self_contact = np.zeros(t, np.bool_)
        self.work_s, self.lateness_s = rows(), rows()

    def trimmed(self) -> dict[str, Any]:
        """Every array cut to the rows in use, by name."""
        return {name: value[: self.used] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
