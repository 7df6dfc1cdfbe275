"""The control loop: one `tick` reads the robot, decides, and sends goals. Lockstep and the real clock share it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from configs.robot import Robot
from drivers.interface import Driver, JointCommand, RobotState
from retarget.plan import Plan
from retarget.retargeter import Retargeter
from streamer.estimator import Estimator
from streamer.ladder import Inputs, Ladder, Playback, State
from streamer.load_estimator import LoadEstimator
from streamer.posture_move import PostureMove
from streamer.record import Event, RunRecord
from streamer.reference import Reference
from streamer.servo_command import ServoCommand
from streamer.stabiliser import Stabiliser

Float = NDArray[np.float64]

_OUTSIDE = 0.02
"""How far outside its limits a joint may stand at the start [rad]: play and zero error, about a degree."""
_STAND_MOVE_S = 0.5
"""Shortest move to the stand pose, also when the robot already stands there."""


class ControlLoop:
    """Ladder, reference, estimator, stabiliser, servo command and driver, in the order in which a tick needs them.

    Args:
        feedback: whether balance feedback acts.

    Attributes:
        tick_count: ticks done; the next `tick` is that number.
        inputs: requests for the next tick; cleared after it.
        plan: the plan that plays; `pending` the one that takes over at its start tick.
    """

    def __init__(
        self, robot: Robot, driver: Driver, retargeter: Retargeter, record: RunRecord, *, feedback: bool = True
    ) -> None:
        self.robot, self.driver, self.record = robot, driver, record
        self.ladder = Ladder(robot.safety, robot.rate_hz)
        self.inputs = Inputs()
        self.state = RobotState(robot.n)
        self.command = JointCommand(robot.n)
        self.now, self.ahead = Reference(robot.n), Reference(robot.n)
        self.estimator = Estimator(robot, retargeter.omega)
        self.stabiliser = Stabiliser(robot, enabled=feedback)
        self.load = LoadEstimator(robot)
        self.servo = ServoCommand(robot, driver.delay_s)
        self.move = PostureMove(robot, retargeter.body.dynamics)
        self.stand_pose = retargeter.layout.get(retargeter.standing(), "q")[0].copy()
        self.plan: Plan | None = None
        self.pending: Plan | None = None
        self.tick_count = 0
        self._seen, self._unread = np.full(robot.n, np.nan), np.zeros(robot.n, np.int64)
        self._imu_unread = self._low_reads = 0
        self._lead = driver.delay_s * robot.rate_hz
        self._warned: set[str] = set()

    @property
    def ready(self) -> bool:
        """Whether the robot stands and waits for its first plan."""
        return self.ladder.state is State.READY and self.move.done

    @property
    def plan_over(self) -> bool:
        """Whether the plan has been played to its last row."""
        return self.plan is not None and self.tick_count >= self.plan.end_tick - 1

    def tick(self) -> None:
        """One period: read, decide, send, record."""
        self._read()
        self._join()
        self.estimator.update(self.state, self.now)
        before = self.ladder.state
        self._look(before)
        playback = self.ladder.step(self.inputs)
        if self.ladder.state is not before:
            self._enter(self.ladder.state, before)
        self._play(playback)
        self._write_record(playback)
        self.inputs.reset()
        self.tick_count += 1

    def _read(self) -> None:
        """Read; what is no number counts as not having answered: such a joint is taken to move as it was meant to."""
        state = self.state
        self.driver.read(state)
        lost = ~(np.isfinite(state.position) & np.isfinite(state.velocity))
        self._unread += 1
        self._unread[~lost] = 0
        np.copyto(state.position, self._seen + self.now.qd / self.robot.rate_hz, where=lost)
        np.copyto(state.velocity, self.now.qd, where=lost)
        np.maximum(state.stale, self._unread, out=state.stale)
        np.copyto(self._seen, state.position)
        if not (np.isfinite(state.gyro).all() and np.isfinite(state.accel).all()):
            if state.imu_stale < 0:
                state.gyro.fill(0.0)
                return
            self._imu_unread += 1
            state.gyro.fill(0.0)
            state.imu_stale = max(state.imu_stale, self._imu_unread)
        else:
            self._imu_unread = 0

    def _join(self) -> None:
        if self.pending is not None and self.tick_count >= self.pending.start_tick:
            self.plan, self.pending = self.pending, None

    def _look(self, state: State) -> None:
        """Fill what the ladder must know from what was measured."""
        inputs, robot, measured = self.inputs, self.robot, self.state
        limits = robot.safety
        inputs.plan_ready = self.plan is not None and not self.plan_over
        inputs.plan_over = self.plan_over
        inputs.move_done = self.move.done
        if state is State.OFF:
            self._audit()
            return
        tilted = math.hypot(*self.estimator.tilt) > limits.fall_tilt
        inputs.fallen = bool(self.estimator.has_imu and tilted)
        if measured.stale.min() > limits.max_stale_reads:
            inputs.bus_lost = f"bus lost: no joint has answered for {int(measured.stale.min())} reads"
        else:
            inputs.fault = inputs.fault or self._problem()
        if not self.estimator.has_imu:
            self._warn("imu", "no IMU: the robot runs open loop, falls are not detected")

    def _audit(self) -> None:
        """A start is refused, with its reason, while anything is wrong that could be known before torque goes on."""
        if not self.inputs.start:
            return
        robot, position = self.robot, self.state.position
        silent = np.flatnonzero(self._unread)
        # Past its limits by more than a goal's resolution: the robot's own stops hold it, or its zero is wrong.
        outside = np.flatnonzero((position < robot.lower - _OUTSIDE) | (position > robot.upper + _OUTSIDE))
        imu = robot.config.imu
        if len(silent):
            reason: str | None = self._name("returns no position", int(silent[0]))
        elif len(outside):
            joint = int(outside[0])
            reason = self._name(
                f"stands at {position[joint]:.2f} rad, outside [{robot.lower[joint]:.2f}, {robot.upper[joint]:.2f}]: "
                "move it by hand",
                joint,
            )
        elif imu is not None and imu.required and not self.estimator.has_imu:
            reason = "the robot file requires an IMU and none answers"
        else:
            reason = self._problem()
        if reason is not None:
            self.inputs.start = False
            self._event("fault", f"no start: {reason}")

    def _problem(self) -> str | None:
        """What is wrong with servos, IMU or supply, if anything."""
        measured, limits = self.state, self.robot.safety
        if measured.stale.max() > limits.max_stale_reads:
            return self._name("does not answer", int(np.argmax(measured.stale)))
        if measured.hardware_error.any():
            worst = int(np.flatnonzero(measured.hardware_error)[0])
            return self._name(f"reports hardware error 0x{int(measured.hardware_error[worst]):02x}", worst)
        if measured.imu_stale > limits.max_stale_reads:
            return f"IMU has not answered for {measured.imu_stale} reads"
        supply = np.fmin.reduce(measured.voltage)
        low = limits.voltage_min is not None and supply < limits.voltage_min
        self._low_reads = self._low_reads + 1 if low else 0
        if self._low_reads > limits.max_stale_reads:
            return f"supply at {supply:.1f} V, below {limits.voltage_min:.1f} V"
        return None

    def _name(self, what: str, joint: int) -> str:
        return f"servo of {self.robot.joint_names[joint]} (id {self.robot.joints[joint].id}) {what}"

    def _warn(self, kind: str, message: str) -> None:
        if kind not in self._warned:
            self._warned.add(kind)
            self._event("warning", message)

    def _event(self, kind: str, message: str) -> None:
        self.record.events.append(Event(self.tick_count, kind, message))

    def _enter(self, state: State, before: State) -> None:
        """What happens once when a state begins."""
        cause = f": {self.ladder.fault}" if self.ladder.fault else ""
        self._event("fault" if state is State.FAULT else "state", f"{before.name} -> {state.name}{cause}")
        robot = self.robot
        if state is State.READY:
            self.servo.reset(self.state.position)
            self.load.reset()
            self.estimator.reset()
            self.command.position[:] = self.state.position
            self.driver.set_torque(True)
            self.move.begin(
                self.state.position, self.stand_pose, least_s=_STAND_MOVE_S, speed=robot.safety.soft_start_speed
            )
        elif state is State.PARK:
            self.plan = self.pending = None
            # From the goals' reference, not from the measurement: the servos hold the one, not the other.
            self.move.begin(
                self.now.q, robot.rest_pose, least_s=robot.safety.park_s, speed=2 * robot.safety.soft_start_speed
            )
        elif state is State.DAMPED:
            self.plan = self.pending = None
            self.driver.damp()
        elif state in (State.OFF, State.FAULT):
            self.plan = self.pending = None
            self.driver.set_torque(False)

    def _play(self, playback: Playback) -> None:
        if playback in (Playback.NOTHING, Playback.DAMP):
            self.now.balanced = False
            return
        if playback is Playback.FREEZE:
            self.driver.write(self.command)
            return
        if playback is Playback.PLAN and self.plan is not None:
            place = float(self.tick_count - self.plan.start_tick)
            self.now.take(self.plan, place)
            self.ahead.take(self.plan, place + self._lead)
        else:
            self.move.step(self.now)
            self.ahead.copy(self.now)
        self.stabiliser.update(self.estimator, self.now)
        self.load.update(self.now.q, self.state.position, self.now.torque)
        torque = self.load.factor * self.ahead.torque + self.stabiliser.torque
        goal = self.servo.update(self.ahead.q, self.ahead.qd, torque, self.state)
        self.command.position[:] = goal
        self.record.repairs["position"] += self.servo.position_clamps
        self.record.repairs["torque"] += self.servo.torque_clamps
        self.driver.write(self.command)

    def _write_record(self, playback: Playback) -> None:
        record, row = self.record, self.tick_count
        if row >= record.ticks:
            return
        record.used = row + 1
        record.state[row] = self.ladder.state
        record.q[row], record.qd[row] = self.state.position, self.state.velocity
        if playback in (Playback.NOTHING, Playback.DAMP):
            return
        record.q_cmd[row] = self.command.position
        now = self.now
        record.q_ref[row], record.qd_ref[row], record.torque_ref[row] = now.q, now.qd, now.torque
        if not now.balanced:
            return
        record.com_ref[row], record.dcm_ref[row], record.zmp_ref[row] = now.com, now.dcm, now.zmp
        record.com[row], record.dcm[row] = self.estimator.com, self.estimator.dcm
        record.foot_ref[row], record.contact_ref[row], record.base_ref[row] = now.feet, now.contacts, now.base
        if self.plan is not None and playback is Playback.PLAN:
            place = row - self.plan.start_tick
            if 0 <= place < len(self.plan):
                record.source_s[row] = self.plan.source_s[place]
                record.hand_error[row] = self.plan.hand_error[place]
                for kind, counts in self.plan.repairs.items():
                    record.repairs[kind] += int(counts[place])
                for step in self.plan.steps:
                    if step.lift == row:
                        record.steps_planned += 1
                        record.steps_inserted += int(step.inserted)
