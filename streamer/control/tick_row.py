"""`TickRow`: what the loop records about one tick, a row of fixed size that ring, log, viewer and report share."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexmotion.records import Bool, Float, Int, Record, column

REPAIRS = ("position", "speed", "acceleration", "torque")
"""Kinds of repair, in the order of the column `repairs`."""


class TickRow(Record):
    """One tick, or the ticks of a run; SI units, NaN where a value is unknown or was not sent.

    Wide fields come first, so that the row has no padding and its bytes are also those of a log's message. The log's
    topic `/tick` has these fields in this order.
    """

    tick: Int = column("i8")
    """Number of the tick."""
    stamp_ns: Int = column("i8")
    """`time.perf_counter_ns` at which the loop woke."""
    state: Int = column("i8")
    """`flexmotion.streamer.control.ladder.State`."""
    plan: Int = column("i8")
    """Id of the plan that plays; 0: none. `plan_start` and `plan_end`: its first tick, and the first after it."""
    plan_start: Int = column("i8")
    plan_end: Int = column("i8")
    offer: Int = column("i8")
    """Id of the newest plan that the loop has examined."""
    pending: Int = column("i8")
    """Id of the accepted plan that waits for its start tick; 0: none."""
    asked_tick: Int = column("i8")
    """Tick at which the plan that plays was requested."""
    target: Int = column("i8")
    """Id of the newest target that the plans played so far follow; 0: none."""

    missed_deadlines: Int = column("i8")
    """This and the next seven fields count since the start of the run."""
    late_plans: Int = column("i8")
    underruns: Int = column("i8")
    violations: Int = column("i8")
    disbelieved: Int = column("i8")
    """Readings that could not be, of servos and IMU."""
    steps_planned: Int = column("i8")
    steps_inserted: Int = column("i8")
    repairs: Int = column("i8", len(REPAIRS))
    """By kind, in the order of `REPAIRS`."""
    stale: Int = column("i8", "joints")
    """Reads since each joint last answered; 0: it answered this tick."""
    hardware_error: Int = column("i8", "joints")
    """Error byte of each servo; 0: none."""
    imu_stale: Int = column("i8")
    """Reads since the IMU last answered; below 0: there is none."""

    source_s: Float = column("f8")
    """Time of the source that the reference comes from [s]."""
    sample_s: Float = column("f8")
    """Time that it took to get the human motion of the plan that plays, and (`retarget_s`) to retarget it [s]."""
    retarget_s: Float = column("f8")
    target_to_command_s: Float = column("f8")
    """From a target's arrival to the first tick of the first plan that follows it, on that tick alone [s]."""
    target_to_effect_s: Float = column("f8")
    """From there to the first row that differs by two degrees, on that tick alone [s]."""
    seen_to_command_s: Float = column("f8")
    """From the arrival of a mirrored person's frame to the first tick of the first plan that follows it, on that tick
    alone [s]."""
    work_s: Float = column("f8")
    """Time that the work of this tick took [s]."""
    lateness_s: Float = column("f8")
    """How late the loop woke [s]; `robot_lateness_s`: how late the simulated robot was [s]."""
    robot_lateness_s: Float = column("f8")

    q_ref: Float = column("f8", "joints")
    """Reference of the plan: angle [rad], speed `qd_ref` [rad/s] and torque `torque_ref` [N·m]."""
    qd_ref: Float = column("f8", "joints")
    torque_ref: Float = column("f8", "joints")
    q_cmd: Float = column("f8", "joints")
    """Goals that were sent [rad]."""
    stiffness: Float = column("f8", "joints")
    """Share of the robot file's stiffness with which each joint follows its reference: less where the human is not
    tense, or less is asked for."""
    q: Float = column("f8", "joints")
    """Measured angle [rad], speed `qd` [rad/s], torque `effort` [N·m], supply `voltage` [V], `temperature` [°C]."""
    qd: Float = column("f8", "joints")
    effort: Float = column("f8", "joints")
    voltage: Float = column("f8", "joints")
    temperature: Float = column("f8", "joints")
    gyro: Float = column("f8", 3)
    """Measured angular velocity [rad/s] and specific force `accel` [m/s²] of the torso, in its frame."""
    accel: Float = column("f8", 3)
    tilt: Float = column("f8", 2)
    """Estimated roll and pitch of the torso [rad]."""
    com_ref: Float = column("f8", 2)
    """Centre of mass, x and y in the plan's world [m]: planned, and (`com`) estimated."""
    com: Float = column("f8", 2)
    dcm_ref: Float = column("f8", 2)
    """Its divergent component [m]: planned, and (`dcm`) estimated."""
    dcm: Float = column("f8", 2)
    zmp_ref: Float = column("f8", 2)
    """Planned zero-moment point [m], and (`zmp_shift`) what the balance feedback adds to it [m]."""
    zmp_shift: Float = column("f8", 2)
    hand_error: Float = column("f8", 2)
    """Distance of each hand's reference from where the human's hand maps to [m]; NaN out of reach."""
    foot_ref: Float = column("f8", 2, 4)
    """Planned soles: x, y, z [m] and yaw [rad], left then right."""
    odometry: Float = column("f8", 3)
    """Way of the centre of mass x, y [m] and turn of the torso [rad] since the robot had stood up, from gyroscope,
    joint speeds and the planned stance; whole turns are counted."""
    base_ref: Float = column("f8", 7)
    """Planned torso: position [m] and quaternion w x y z; of a slow move its tilt alone."""

    true_base: Float = column("f8", 7)
    """This and the other `true_` fields: true state of a simulated robot, as of its driver's `truth`."""
    true_q: Float = column("f8", "joints")
    true_foot: Float = column("f8", 2, 3)
    true_foot_velocity: Float = column("f8", 2, 3)
    true_foot_force: Float = column("f8", 2, 3)
    true_torque: Float = column("f8", "joints")
    true_saturated: Float = column("f8", "joints")
    true_com: Float = column("f8", 3)
    true_self_contact: Bool = column("?")

    contact_ref: Bool = column("?", 2)
    """Planned contact of the left and the right foot."""
    limp: Bool = column("?", "joints")
    """Joints whose torque an operator has switched off by themselves."""
    ready: Bool = column("?")
    """The robot stands and waits for its first plan."""
    plan_over: Bool = column("?")
    """The plan has been played to its last row."""
    must_stop: Bool = column("?")
    """Only a plan that stops is accepted."""
    faulted: Bool = column("?")
    """A fault is latched: no target is followed until it is cleared and the robot is armed again."""
    hung: Bool = column("?")
    """The feet are in the air."""
    hardware_failed: Bool = column("?")
    """A servo, the IMU, the supply or the bus is why the start was refused or a fault is latched."""


def blank(dtype: np.dtype[Any], shape: int | tuple[int, ...] = ()) -> np.ndarray[Any, Any]:
    """Rows with every float NaN and every other field zero."""
    rows = np.zeros(shape, dtype)
    for name in dtype.names or ():
        if dtype[name].base.kind == "f":
            rows[name] = np.nan
    return rows
