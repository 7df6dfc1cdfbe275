"""`SessionState`: what a run tells about its newest tick, as values of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow

Float = NDArray[np.float64]


@dataclass(frozen=True)
class SessionState:
    """One tick of a run. Arrays over joints are (n,), in the order of the robot file; NaN where unknown.

    Attributes:
        tick: its number, from 0.
        time_s: time since the first tick, at the robot's rate [s].
        ladder: what the robot is doing.
        source_s: time of the source whose motion plays [s].
        target: id of the target that the plan follows; 0: none yet.
        q, qd: measured joint angles and speeds [rad, rad/s].
        q_ref: joint angles of the plan [rad].
        q_cmd: goals that were sent to the servos [rad].
        torque: torques that the servos made, from the simulation or from their current [N·m].
        tilt: estimated roll and pitch of the torso, (2,) [rad].
        torso: true pose of the torso in the world, position [m] and quaternion w x y z, (7,); only in simulation.
        contacts: planned contact of the left and the right foot, (2,).
    """

    tick: int
    time_s: float
    ladder: State
    source_s: float
    target: int
    q: Float
    qd: Float
    q_ref: Float
    q_cmd: Float
    torque: Float
    tilt: Float
    torso: Float
    contacts: NDArray[np.bool_]

    @classmethod
    def of(cls, row: TickRow, rate_hz: float) -> SessionState:
        """From a single row."""
        simulated = bool(np.isfinite(row.true_torque).any())
        return cls(
            tick=int(row.tick),
            time_s=int(row.tick) / rate_hz,
            ladder=State(int(row.state)),
            source_s=float(row.source_s),
            target=int(row.target),
            q=row.q,
            qd=row.qd,
            q_ref=row.q_ref,
            q_cmd=row.q_cmd,
            torque=row.true_torque if simulated else row.effort,
            tilt=row.tilt,
            torso=row.true_base,
            contacts=row.contact_ref,
        )
