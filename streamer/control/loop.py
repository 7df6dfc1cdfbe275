"""`ControlLoop`: one `tick` reads the robot, decides, and sends goals, the same in lockstep and on the real clock."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import Driver, JointCommand, RobotState
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.gyro_bias import GyroBias
from flexmotion.streamer.control.hardware_audit import HardwareAudit
from flexmotion.streamer.control.ladder import POWERED, Inputs, Ladder, Playback, State
from flexmotion.streamer.control.load_estimator import LoadEstimator
from flexmotion.streamer.control.obedience import Obedience
from flexmotion.streamer.control.plan_buffer import Offer, PlanBuffer
from flexmotion.streamer.control.plausibility import Plausibility
from flexmotion.streamer.control.posture_move import PostureMove
from flexmotion.streamer.control.punctuality import Punctuality
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.row_writer import RowWriter
from flexmotion.streamer.control.servo_command import ServoCommand
from flexmotion.streamer.control.stabiliser import Stabiliser
from flexmotion.streamer.control.suspension import Suspension
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import REPAIRS

Float = NDArray[np.float64]

_POSITION, _TORQUE = REPAIRS.index("position"), REPAIRS.index("torque")
_JUDGED = (State.READY, State.STREAMING, State.HOLD)
"""States in which joints must follow their goals. In PARK the ground or a hand may be in the way."""
_MAY_HOLD = "their joints may be stiff; switch the power off"
_LATE_TICKS = 3
"""Ticks from one to the next after which goals begin where the servos hold them."""
_STAND_MOVE_S = 0.5
"""Shortest move to the stand pose, also when the robot already stands there."""


class ControlLoop:
    """Runs ladder, reference, estimator, stabiliser, servo command and driver, in the order that a tick needs.

    Args:
        plans: buffer that the planner publishes to.
        telemetry: rings that every tick and event are published to.
        feedback: whether balance feedback acts.

    Attributes:
        tick_count: ticks done, which is the number of the next tick.
        inputs: requests for the next tick; cleared after it.
        playing: the plan that plays; `waiting`: the accepted plan that takes over at its start tick.
        winding_down: set by the lifecycle: from now on only a plan that stops is accepted.
        awaits_arm: set by the lifecycle: a start that is refused is no fault, another may be requested.
        hardware_failed: a servo, the IMU, the supply or the bus is why the start was refused or a fault is latched.
    """

    def __init__(
        self,
        robot: Robot,
        driver: Driver,
        retargeter: Retargeter,
        plans: PlanBuffer,
        telemetry: Telemetry,
        *,
        feedback: bool = True,
    ) -> None:
        self.robot, self.driver, self.plans, self.telemetry = robot, driver, plans, telemetry
        self.ladder = Ladder(robot.safety, robot.rate_hz)
        self.inputs = Inputs()
        self.state = RobotState(robot.n)
        self.command = JointCommand(robot.n)
        self.now, self.ahead = Reference(robot.n), Reference(robot.n)
        self.estimator = Estimator(robot, retargeter.omega)
        self.gyro_bias = GyroBias(robot.rate_hz)
        self.stabiliser = Stabiliser(robot, enabled=feedback)
        self.load = LoadEstimator(robot)
        self.suspension = Suspension(robot)
        self.punctuality = Punctuality(robot)
        self.plausibility, self.obedience = Plausibility(robot, driver.turns), Obedience(robot, driver.turns)
        self.audit = HardwareAudit(robot, self.punctuality, self.plausibility, self.obedience, self._warn)
        self.servo = ServoCommand(robot, driver.delay_s, driver.turns)
        self.move = PostureMove(robot, retargeter.body.dynamics)
        self.stand_pose = retargeter.layout.view(retargeter.standing()).q[0].copy()
        self.playing: Offer | None = None
        self.waiting: Offer | None = None
        self.winding_down = self.hardware_failed = self.awaits_arm = False
        self.tick_count = 0
        self._writer = RowWriter(telemetry.row, robot, driver)
        self._examined = 0  # id of the newest plan that was accepted or refused
        self._underrun = 0  # id of the plan whose underrun was counted
        self._last_tick = 0
        self._pins = np.full(robot.n, np.nan)  # goals that the driver has pinned
        self._load = np.zeros(robot.n)  # planned, of the goals in effect
        self._lead = driver.delay_s * robot.rate_hz
        self._waited_s = 0.0  # time that the last tick waited for servos to be switched on
        self._hardware_fault: str | None = None  # found on this tick

    @property
    def ready(self) -> bool:
        """Whether the robot stands and waits for its first plan."""
        return self.ladder.state is State.READY and self._arrived

    @property
    def _arrived(self) -> bool:
        """Whether the slow move of this state is done; in READY also the measurement of the gyro's bias after it."""
        return self.move.done and (self.ladder.state is not State.READY or self.gyro_bias.done)

    @property
    def plan(self) -> Plan | None:
        """The plan that plays."""
        return None if self.playing is None else self.playing.plan

    @property
    def plan_over(self) -> bool:
        """Whether the plan has been played to its last row."""
        return self.playing is not None and self.tick_count >= self.playing.plan.end_tick - 1

    @property
    def must_stop(self) -> bool:
        """Whether only a plan that stops is accepted."""
        return self.winding_down or self.ladder.stopping or self.ladder.fault is not None

    def touch(self) -> None:
        """Read the shared memory that ticks need, so that no tick meets a page fault in it."""
        self.telemetry.ticks.touch()
        self.telemetry.events.touch()
        self.plans.touch()

    def tick(self, late_ns: int = 0) -> None:
        """One period: read, decide, send, publish the row.

        Args:
            late_ns: how late the loop woke for it [ns].
        """
        begin = time.perf_counter_ns()
        self.punctuality.woke(self.tick_count, late_ns * 1e-9, self._waited_s)
        self._waited_s = 0.0
        self._read()
        self._take_plan()
        self.estimator.update(self.state, self.now)
        before, fault = self.ladder.state, self.ladder.fault
        self._set_inputs(before)
        playback = self.ladder.step(self.inputs)
        if self.ladder.fault != fault:
            self.hardware_failed = self.ladder.fault is not None and self.ladder.fault == self._hardware_fault
        if self.ladder.state is not before:
            self.servo.rejoin()
            self._enter(self.ladder.state, before)
        self._play(playback)
        self._write_row(playback)
        self._check_underrun(playback)
        self.inputs.reset()
        self.tick_count += 1
        row = self.telemetry.row
        row.stamp_ns[...], row.lateness_s[...] = begin, late_ns * 1e-9
        row.work_s[...] = (time.perf_counter_ns() - begin) * 1e-9
        self.telemetry.commit()

    def _read(self) -> None:
        """Read the robot; what cannot be is not believed."""
        powered = self.ladder.state in POWERED
        self.driver.read(self.state)
        self._pins.fill(np.nan)
        self.driver.take_pins(self._pins)
        self.servo.take_pins(self._pins)
        np.copyto(self.command.position, self._pins, where=np.isfinite(self._pins))  # also where goals are frozen
        self.plausibility.check(self.state, self.now.qd, self.tick_count, powered=powered)
        if self.tick_count - self._last_tick > _LATE_TICKS and powered:
            self.servo.rejoin()  # the servos have held their goals meanwhile
        self._last_tick = self.tick_count

    def _take_plan(self) -> None:
        """Let the waiting plan take over when its tick has come; a newer acceptable plan replaces it."""
        standing = self.ladder.state in (State.READY, State.HOLD)
        if self.waiting is not None and standing and self.must_stop and not self.waiting.ticket.stops:
            # Accepted before the stop was requested: a robot that stands does not start to walk after it.
            self.waiting = None
            self.plans.hold(self.playing, None)
        if self.waiting is not None and self.tick_count >= self.waiting.plan.start_tick:
            self._begin_plan(self.waiting)
        offer = self.plans.newest(self._examined)
        if offer is None:
            return
        # A plan that resumes the waiting plan is examined once that one plays.
        if self.waiting is None or offer.ticket.resumed != self.waiting.ticket.id:
            self._examined = offer.ticket.id
            if self._acceptable(offer):
                self.waiting = offer
                if self.tick_count == offer.plan.start_tick:
                    self._begin_plan(offer)
        self.plans.hold(self.playing, self.waiting)

    def _begin_plan(self, offer: Offer) -> None:
        self.playing, self.waiting = offer, None
        self.plans.hold(offer, None)
        self._writer.plan_began(offer.ticket)

    def _acceptable(self, offer: Offer) -> bool:
        """Whether a plan may be played: it resumes the plan that plays, is not late, and stops where it must."""
        if self.ladder.state not in (State.READY, State.STREAMING, State.HOLD):
            return False
        if offer.plan.start_tick < self.tick_count:
            # Never played late. The planner makes another, which joins later.
            self.telemetry.row.late_plans += 1
            return False
        playing = 0 if self.playing is None else self.playing.ticket.id
        return offer.ticket.resumed == playing and (offer.ticket.stops or not self.must_stop)

    def _set_inputs(self, state: State) -> None:
        """Tell the ladder what was measured and which plan there is."""
        inputs, measured = self.inputs, self.state
        self._hardware_fault = None
        inputs.plan_ready = self.plan is not None and not self.plan_over
        inputs.plan_over = self.plan_over
        if state is State.READY and self.move.done and not self.gyro_bias.done:
            self._measure_gyro_bias()
        inputs.move_done = self._arrived
        if state is State.OFF:
            self._check_start()
            return
        tilted = math.hypot(*self.estimator.tilt) > self.robot.safety.fall_tilt
        inputs.fallen = bool(self.estimator.has_imu and tilted)
        if state in _JUDGED:
            self.obedience.update(self.command.position, self._load, measured.position, measured.stale == 0)
        lost = self.audit.lost_bus(measured)
        if lost is not None:
            self._hardware_fault = inputs.bus_lost = lost
            if not self.driver.connected:
                inputs.cut_off = lost
        elif inputs.fault is None:
            fault = self.audit.problem(measured)
            if fault is None and state is State.READY and not self._arrived:
                fault = self.audit.lying_imu()  # a start, until the robot has stood up
            self._hardware_fault = inputs.fault = fault
        if not self.estimator.has_imu:
            self.audit.warn_of_imu()

    def _measure_gyro_bias(self) -> None:
        """While the robot stands and waits, the gyro measures its bias."""
        bias = self.gyro_bias
        bias.update(self.state, has_imu=self.estimator.has_imu, hung=self.suspension.hung)
        if not bias.done:
            return
        self.estimator.gyro_bias[:] = bias.bias
        self.estimator.odometry[:] = 0.0  # it begins where the robot has stood up
        if not bias.known and self.estimator.has_imu:
            self._emit("warning", f"{bias.reason}: the gyro's bias is not known, none is subtracted")

    def _check_start(self) -> None:
        """Refuse a start, with the reason, while the hardware is not fit for it."""
        if not self.inputs.start:
            self.audit.watch(self.state)
            return
        self.audit.take_limits(self.driver.temperature_limit, self.driver.voltage_limit)
        reason = self.audit.refusal(self.state, self.plausibility.unread, self.estimator.has_imu) or self._lies()
        if reason is None:
            return
        self.inputs.start = False
        if self.awaits_arm:
            self._emit("refused", f"ARM: {reason}")
        else:
            self.hardware_failed = True
            self._emit("fault", f"no start: {reason}")

    def _lies(self) -> str | None:
        """Why a robot that has been watched for a while cannot stand up: it lies. None where it may."""
        tilt = math.hypot(*self.estimator.tilt)
        if not self.estimator.has_imu or tilt <= self.robot.safety.fall_tilt:
            return None
        return f"the torso is tilted by {math.degrees(tilt):.0f}°: the robot lies; put it into its rest pose by hand"

    def _warn(self, message: str) -> None:
        self._emit("warning", message)

    def _emit(self, kind: str, message: str) -> None:
        self.telemetry.emit(self.tick_count, kind, message)

    def _enter(self, state: State, before: State) -> None:
        """Act once on a change of state."""
        cause = f": {self.ladder.fault}" if self.ladder.fault else ""
        self._emit("fault" if state is State.FAULT else "state", f"{before.name} -> {state.name}{cause}")
        robot = self.robot
        if state is State.READY:
            begin = time.perf_counter_ns()
            self.driver.set_torque(True)
            self._waited_s = (time.perf_counter_ns() - begin) * 1e-9
            pinned = self.state.position.copy()
            self.driver.take_pins(pinned)
            self.servo.reset(pinned)
            self.obedience.reset(pinned)
            self.load.reset()
            self.suspension.reset()
            self.estimator.reset()
            self.gyro_bias.reset()
            self.command.position[:] = pinned
            self.move.begin(pinned, self.stand_pose, least_s=_STAND_MOVE_S, speed=robot.safety.soft_start_speed)
        elif state is State.PARK:
            self._forget_plans()
            # From the reference of the goals, not from the measurement: that is what the servos hold.
            self.move.begin(
                self.now.q, robot.rest_pose, least_s=robot.safety.park_s, speed=2 * robot.safety.soft_start_speed
            )
        elif state is State.DAMPED:
            self._forget_plans()
            self.driver.damp()
        elif state in (State.OFF, State.FAULT):
            self._forget_plans()
            self.obedience.reset(self.state.position)
            self.driver.set_torque(False)
            if self.driver.holding:
                self._emit("fault", f"torque off is not confirmed by {', '.join(self.driver.holding)}: {_MAY_HOLD}")

    def _forget_plans(self) -> None:
        self.playing = self.waiting = None
        self.plans.hold(None, None)

    def _play(self, playback: Playback) -> None:
        if playback in (Playback.NOTHING, Playback.DAMP):
            self.now.balanced = False
            return
        if playback is Playback.FREEZE:
            self.now.qd[:] = 0.0
            self.driver.write(self.command)
            return
        slow = playback is not Playback.PLAN or self.plan is None
        if self.plan is not None and not slow:
            place = float(self.tick_count - self.plan.start_tick)
            self.now.take(self.plan, place)
            self.ahead.take(self.plan, place + self._lead)
        else:
            self.move.step(self.now)
            self.ahead.copy(self.now)
        np.copyto(self._load, self._torque())
        expected = self.plausibility.expected if self.plausibility.returned else None
        goals = self.servo.update(self.ahead.q, self.ahead.qd, self._load, self.state, expected, slow=slow)
        self.command.position[:] = goals
        repairs = self.telemetry.row.repairs
        repairs[_POSITION] += self.servo.position_clamps
        repairs[_TORQUE] += self.servo.torque_clamps
        self.driver.write(self.command)

    def _torque(self) -> Float:
        """Feed-forward torque that carries and balances the robot, (n,) [N·m]."""
        now, measured, suspension = self.now, self.state, self.suspension
        if suspension.update(self.command.position, measured.position, measured.velocity, now.torque):
            self._emit("note", "the feet are in the air: balance is off" if suspension.hung else "back on its feet")
        if suspension.hung:
            torque = self.ahead.torque.copy()
            torque[suspension.legs] = 0.0
            return torque
        self.stabiliser.update(self.estimator, now)
        self.load.update(now.q, measured.position, now.torque)
        return self.load.factor * self.ahead.torque + self.stabiliser.torque

    def _write_row(self, playback: Playback) -> None:
        """Fill this tick's row."""
        row, writer, now = self.telemetry.row, self._writer, self.now
        writer.write_state(self.tick_count, self.ladder.state, self.estimator)
        row.ready[...], row.plan_over[...], row.must_stop[...] = self.ready, self.plan_over, self.must_stop
        row.offer[...], row.pending[...] = self._examined, 0 if self.waiting is None else self.waiting.ticket.id
        row.disbelieved[...] = self.plausibility.disbelieved
        row.hung[...], row.hardware_failed[...] = self.suspension.hung, self.hardware_failed
        writer.write_measured(self.state)
        writer.write_plan(self.playing)
        if playback in (Playback.NOTHING, Playback.DAMP):
            return
        writer.write_reference(now, self.command)
        if now.balanced:
            writer.write_balance(now, self.estimator, self.stabiliser)
        if self.plan is not None and playback is Playback.PLAN:
            writer.write_progress(self.tick_count, self.plan)

    def _check_underrun(self, playback: Playback) -> None:
        """Count and warn once for each plan whose stop tail plays because no other plan came."""
        if self.playing is None or playback is not Playback.PLAN:
            return
        ticket, plan = self.playing.ticket, self.playing.plan
        in_tail = plan.stop_row <= self.tick_count - plan.start_tick < len(plan)
        if in_tail and ticket.id != self._underrun and not (ticket.stops or ticket.source_over or self.must_stop):
            self._underrun = ticket.id
            self.telemetry.row.underruns += 1
            self._emit("warning", f"no plan followed plan {ticket.id}: its own stop is played")
