"""What the loop tells about one tick: a row of fixed size that the ring, the log, the viewer and the report share."""

from __future__ import annotations

from typing import Any

import numpy as np

REPAIRS = ("position", "speed", "acceleration", "torque")
"""Kinds of repair, in the order of the column `repairs`."""


def tick_dtype(n: int) -> np.dtype[Any]:
    """The row of a robot with `n` joints; fields in SI units, NaN where unknown or not sent.

    Wide fields come first, so that the row's bytes are also what a log of plain arrays holds.

    ```
    tick, stamp_ns           number of the tick; time.perf_counter_ns at which it woke
    state                    flexmotion.streamer.control.ladder.State
    plan, plan_start, plan_end, offer     id of the plan that plays (0: none), its ticks, id of the newest one looked at
    pending                  id of the plan that waits for its tick (0: none)
    asked_tick, target       of the plan that plays: tick at which it was asked for; id of the target it first follows
    missed_deadlines, late_plans, underruns, violations, steps_planned, steps_inserted, repairs    counts so far
    source_s                 time of the source that the reference comes from
    sample_s, retarget_s     what the plan that plays took to make
    target_to_command_s, target_to_effect_s    on the tick on which a plan for a new target begins to play
    work_s, lateness_s, robot_lateness_s       time this tick's work took; how late it woke; how late the robot was
    q_ref, qd_ref, torque_ref, q_cmd           reference from the plan; goal that was sent
    q, qd, effort, voltage, temperature, stale, hardware_error, imu_stale, gyro, accel      as measured
    tilt                     roll and pitch of the torso as estimated
    com_ref, com, dcm_ref, dcm, zmp_ref, zmp_shift        horizontal plane of the planned world; com and dcm estimated;
                             what the feedback adds to the zero-moment point
    foot_ref, base_ref       planned soles (x, y, z, yaw), left and right; planned torso, position and w x y z
    hand_error               distance of each hand's reference from where the human's maps to
    true_*                   ground truth of a simulation (flexmotion.drivers.simulated.Truth)
    contact_ref              planned contact of left and right foot
    ready, plan_over, must_stop           waits for its first plan; the plan is played; only a plan that stops is taken
    hung                     the feet are in the air
    hardware_failed          a servo, the IMU, the supply or the bus is why the start was refused or a fault is latched
    ```
    """
    whole = ("tick", "stamp_ns", "state", "plan", "plan_start", "plan_end", "offer", "pending", "asked_tick", "target")
    counts = ("missed_deadlines", "late_plans", "underruns", "violations", "steps_planned", "steps_inserted")
    times = ("source_s", "sample_s", "retarget_s", "target_to_command_s", "target_to_effect_s")
    clocks = ("work_s", "lateness_s", "robot_lateness_s")
    joints = ("q_ref", "qd_ref", "torque_ref", "q_cmd", "q", "qd", "effort", "voltage", "temperature")
    plane = ("tilt", "com_ref", "com", "dcm_ref", "dcm", "zmp_ref", "zmp_shift", "hand_error")
    return np.dtype(
        [
            *((name, "i8") for name in (*whole, *counts)),
            ("repairs", "i8", len(REPAIRS)),
            ("stale", "i8", n),
            ("hardware_error", "i8", n),
            ("imu_stale", "i8"),
            *((name, "f8") for name in (*times, *clocks)),
            *((name, "f8", n) for name in joints),
            ("gyro", "f8", 3),
            ("accel", "f8", 3),
            *((name, "f8", 2) for name in plane),
            ("foot_ref", "f8", (2, 4)),
            ("base_ref", "f8", 7),
            ("true_base", "f8", 7),
            ("true_q", "f8", n),
            *((name, "f8", (2, 3)) for name in ("true_foot", "true_foot_velocity", "true_foot_force")),
            ("true_torque", "f8", n),
            ("true_saturated", "f8", n),
            ("true_com", "f8", 3),
            ("true_self_contact", "?"),
            ("contact_ref", "?", 2),
            ("ready", "?"),
            ("plan_over", "?"),
            ("must_stop", "?"),
            ("hung", "?"),
            ("hardware_failed", "?"),
        ]
    )


def blank(dtype: np.dtype[Any], shape: int | tuple[int, ...] = ()) -> np.ndarray[Any, Any]:
    """Rows with every float NaN and every other field zero."""
    rows = np.zeros(shape, dtype)
    forget(rows)
    return rows


def forget(rows: np.ndarray[Any, Any]) -> None:
    """Set every float of `rows` to NaN."""
    for name in rows.dtype.names or ():
        if rows.dtype[name].base.kind == "f":
            rows[name] = np.nan
