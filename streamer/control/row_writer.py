"""`RowWriter`: fills a tick's row with what was measured, estimated, planned and sent."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import Driver, JointCommand, RobotState
from flexmotion.drivers.simulated import SimulatedDriver, simulated
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import Offer, Ticket
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.soft_following import SoftFollowing
from flexmotion.streamer.control.stabiliser import Stabiliser
from flexmotion.streamer.control.tick_row import REPAIRS, TickRow

Float = NDArray[np.float64]


class RowWriter:
    """Writes to one row, tick after tick; allocates nothing that grows.

    Floats that it does not write stay NaN, as `Telemetry.commit` leaves them.

    Args:
        row: of the telemetry, shape ().
    """

    def __init__(self, row: TickRow, robot: Robot, driver: Driver) -> None:
        self.row, self.driver = row, driver
        self._simulated = simulated(driver)
        self._rate_hz = robot.rate_hz
        self._counted_tick = -1  # footsteps up to this tick are counted
        self._seen_ns = 0  # arrival of the newest frame of a person that a plan has followed
        self._saw = False  # whether the plan that began on this tick follows a newer one
        self._answered: Ticket | None = None  # of the plan by which a new target is followed from this tick on

    def plan_began(self, ticket: Ticket) -> None:
        """A plan plays from this tick on."""
        row = self.row
        if ticket.target > row.target:
            self._answered = ticket
            row.target[...] = ticket.target
        if ticket.seen_ns > self._seen_ns:
            self._seen_ns, self._saw = ticket.seen_ns, True

    def write_measured(self, measured: RobotState) -> None:
        """The driver's reading, and the true state of a simulated robot."""
        row = self.row
        row.violations[...] = self.driver.violations
        row.q[...], row.qd[...], row.effort[...] = measured.position, measured.velocity, measured.effort
        row.voltage[...], row.temperature[...] = measured.voltage, measured.temperature
        row.stale[...], row.hardware_error[...] = measured.stale, measured.hardware_error
        row.imu_stale[...], row.gyro[...], row.accel[...] = measured.imu_stale, measured.gyro, measured.accel
        if self._simulated is not None:
            self._write_truth(self._simulated)

    def write_plan(self, playing: Offer | None) -> None:
        """Which plan plays, and how long it took to make."""
        row = self.row
        if playing is None:
            row.plan[...] = row.plan_start[...] = row.plan_end[...] = row.asked_tick[...] = 0
            return
        ticket = playing.ticket
        row.plan[...], row.asked_tick[...] = ticket.id, ticket.asked_tick
        row.plan_start[...], row.plan_end[...] = playing.plan.start_tick, playing.plan.end_tick
        row.sample_s[...], row.retarget_s[...] = ticket.sample_s, ticket.retarget_s
        if self._saw:
            row.seen_to_command_s[...] = (time.perf_counter_ns() - self._seen_ns) * 1e-9
            self._saw = False
        if self._answered is not None:
            waited = (time.perf_counter_ns() - ticket.target_ns) * 1e-9
            row.target_to_command_s[...] = waited
            if ticket.effect_row >= 0:
                late = int(row.tick) - playing.plan.start_tick
                row.target_to_effect_s[...] = waited + max(ticket.effect_row - late, 0) / self._rate_hz
            self._answered = None

    def write_state(self, tick: int, state: State, estimator: Estimator) -> None:
        """Fields that have a value in every state."""
        row = self.row
        row.tick[...], row.state[...], row.tilt[...] = tick, state, estimator.tilt
        row.contact_ref[...] = False

    def write_reference(
        self, now: Reference, command: JointCommand, softness: SoftFollowing, offset: Float, speed: Float
    ) -> None:
        """Reference with its offsets, (n,) [rad, rad/s], and goals, while torque is on."""
        row = self.row
        row.q_cmd[...], row.stiffness[...] = command.position, softness.share
        np.add(now.q, offset, out=row.q_ref)
        np.add(now.qd, speed, out=row.qd_ref)
        row.torque_ref[...] = now.torque
        row.base_ref[3:] = now.base[3:]

    def write_balance(self, now: Reference, estimator: Estimator, stabiliser: Stabiliser) -> None:
        """Planned and estimated balance, while a plan plays."""
        row = self.row
        row.com_ref[...], row.dcm_ref[...], row.zmp_ref[...] = now.com, now.dcm, now.zmp
        row.com[...], row.dcm[...], row.zmp_shift[...] = estimator.com, estimator.dcm, stabiliser.zmp_shift
        row.odometry[...] = estimator.odometry
        row.foot_ref[...], row.contact_ref[...], row.base_ref[...] = now.feet, now.contacts, now.base

    def write_progress(self, tick: int, plan: Plan) -> None:
        """Place in the plan, with the repairs and footsteps of its rows so far."""
        row, place = self.row, tick - plan.start_tick
        if not 0 <= place < len(plan):
            return
        row.source_s[...] = plan.source_s[place]
        row.hand_error[...] = plan.hand_error[place]
        for index, kind in enumerate(REPAIRS):
            row.repairs[index] += plan.repairs[kind][place]
        # Ticks may have been skipped since the last one.
        since, self._counted_tick = self._counted_tick, tick
        for step in plan.steps:
            if since < step.lift <= tick:
                row.steps_planned += 1
                row.steps_inserted += int(step.inserted)

    def _write_truth(self, robot: SimulatedDriver) -> None:
        row, truth = self.row, robot.truth()
        row.robot_lateness_s[...] = robot.lateness_s
        row.true_base[:3], row.true_base[3:] = truth.base_position, truth.base_quaternion
        row.true_q[...], row.true_com[...] = truth.joint_position, truth.com
        row.true_foot[...], row.true_foot_velocity[...] = truth.foot_position, truth.foot_velocity
        row.true_foot_force[...] = truth.foot_force
        row.true_torque[...], row.true_saturated[...] = truth.torque, truth.saturated
        row.true_self_contact[...] = truth.self_contact
