"""`ControlLoop`: one `tick` reads the robot, decides, and sends goals, the same in lockstep and on the real clock."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import Driver, JointCommand, RobotState
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.spatial.tilt import falls, lean_of, lean_of_angles, tilt_of
from flexmotion.streamer.control.estimator import Estimator, planned_tilt_rate
from flexmotion.streamer.control.foot_strikes import FootStrikes
from flexmotion.streamer.control.get_up_move import GetUpMove
from flexmotion.streamer.control.gyro_bias import GyroBias
from flexmotion.streamer.control.hardware_audit import HardwareAudit
from flexmotion.streamer.control.heel_strike import HeelStrike
from flexmotion.streamer.control.joint_torque import JointTorque
from flexmotion.streamer.control.ladder import POWERED, Inputs, Ladder, Playback, State
from flexmotion.streamer.control.load_estimator import LoadEstimator
from flexmotion.streamer.control.lying import lying_on
from flexmotion.streamer.control.obedience import Obedience
from flexmotion.streamer.control.overridden import GET_UP, overridden
from flexmotion.streamer.control.plan_buffer import PlanBuffer
from flexmotion.streamer.control.plan_intake import PlanIntake
from flexmotion.streamer.control.plausibility import Plausibility
from flexmotion.streamer.control.posture_move import PostureMove
from flexmotion.streamer.control.punctuality import Punctuality
from flexmotion.streamer.control.push_correction import PushCorrection
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.row_writer import RowWriter
from flexmotion.streamer.control.servo_command import ServoCommand
from flexmotion.streamer.control.stabiliser import Stabiliser
from flexmotion.streamer.control.start_check import why_not_arm, why_not_get_up
from flexmotion.streamer.control.suspension import Suspension
from flexmotion.streamer.control.swing_level import SwingLevel
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import REPAIRS
from flexmotion.streamer.control.unseen_fall import UnseenFall

Float = NDArray[np.float64]

_POSITION, _TORQUE = REPAIRS.index("position"), REPAIRS.index("torque")
_JUDGED = (State.READY, State.STREAMING, State.HOLD)
"""States in which joints must follow their goals. In PARK the ground or a hand may be in the way."""
_MAY_HOLD = "their joints may be stiff; switch the power off"
_BOWED_RAD = 0.5
"""A robot that is parked out of a bow as deep as this, beyond those near steps, stands up first [rad], with its arms as
they are: between trunk and thighs they would be led through them."""
_FALLS_ON_S = 0.05
"""A torso beyond the tilt of a fall that keeps its turn beyond the plan's for so long has fallen, if it is then too far
from its plan [s]."""
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
        inputs: requests for the next tick; cleared after it. joints: requests for single joints.
        stopped_by: what stops the robot in the next tick, and who asked for it, in words; cleared after it.
        intake: the plan that plays, and the one that waits.
        commands: goals have been sent since torque went on.
        offset: what answers to pushes add to the reference of the joints, (n,) [rad]; offset_speed: its rate, (n,)
            [rad/s].
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
        self.robot, self.driver, self.telemetry = robot, driver, telemetry
        self.ladder = Ladder(robot.safety, robot.rate_hz)
        self.inputs = Inputs()
        self.stopped_by: list[str] = []
        self.intake = PlanIntake(plans, telemetry)
        self.joints = JointTorque(robot, driver, self.ladder, self._emit)
        self.state = RobotState(robot.n)
        self.command = JointCommand(robot.n)
        self.now, self.ahead = Reference(robot.n), Reference(robot.n)
        self.estimator = Estimator(robot, retargeter.omega)
        self.unseen = UnseenFall(robot)
        self.gyro_bias = GyroBias(robot.rate_hz)
        self.stabiliser = Stabiliser(robot, enabled=feedback)
        self.level = SwingLevel(robot, retargeter, enabled=feedback)
        self.heel = HeelStrike(robot, retargeter, enabled=feedback)
        self.correction = PushCorrection(robot, enabled=feedback)
        self.offset, self.offset_speed = np.zeros(robot.n), np.zeros(robot.n)
        self.strikes = FootStrikes(robot, driver.delay_s)
        self.load = LoadEstimator(robot)
        self.suspension = Suspension(robot)
        self.punctuality = Punctuality(robot)
        self.plausibility, self.obedience = Plausibility(robot, driver.turns), Obedience(robot, driver.turns)
        note = partial(self._emit, "note")
        self.audit = HardwareAudit(robot, self.punctuality, self.plausibility, self.obedience, self._warn, note)
        self.servo = ServoCommand(robot, driver.delay_s, driver.turns)
        self.move = PostureMove(robot, retargeter.body.dynamics)
        self.get_up = GetUpMove(robot)
        self._uncapped = np.full(robot.n, np.inf)
        self._moving = np.zeros(robot.n)  # scratch: the reference with its offsets
        self.stand_pose = retargeter.layout.view(retargeter.standing()).q[0].copy()
        self.winding_down = self.hardware_failed = self.awaits_arm = self.commands = False
        self.tick_count = 0
        self._writer = RowWriter(telemetry.row, robot, driver)
        self._last_tick = 0
        self._moves_slowly = False  # by `move`, whose reference advances by a tick with each that is done
        self._pins = np.full(robot.n, np.nan)  # goals that the driver has pinned
        self._load = np.zeros(robot.n)  # planned, of the goals in effect
        self._judged = np.zeros(robot.n)  # goals with which joints are judged
        self._lead = driver.delay_s * robot.rate_hz
        self._waited_s = 0.0  # time that the last tick waited for servos to be switched on
        self._hardware_fault: str | None = None  # found on this tick

    @property
    def ready(self) -> bool:
        """Whether the robot stands and waits for its first plan."""
        return self.ladder.state is State.READY and self._arrived

    @property
    def _stands(self) -> bool:
        """Whether the robot stands and nothing is about to move it."""
        return self.ready or self.ladder.state is State.HOLD

    @property
    def _arrived(self) -> bool:
        """Whether the slow move of this state is done; in READY also the measurement of the gyro's bias after it."""
        return self.move.done and (self.ladder.state is not State.READY or self.gyro_bias.done)

    @property
    def must_stop(self) -> bool:
        """Whether only a plan that stops is accepted."""
        return self.winding_down or self.ladder.stopping or self.joints.reason is not None

    def touch(self) -> None:
        """Read the shared memory that ticks need, so that no tick meets a page fault in it."""
        self.telemetry.ticks.touch()
        self.telemetry.events.touch()
        self.intake.plans.touch()

    def tick(self, late_ns: int = 0) -> None:
        """One period: read, decide, send, publish the row.

        Args:
            late_ns: how late the loop woke for it [ns].
        """
        begin = time.perf_counter_ns()
        self.punctuality.woke(self.tick_count, late_ns * 1e-9, self._waited_s)
        self._waited_s = 0.0
        self._read()
        began = self.intake.take(self.tick_count, self.ladder.state, must_stop=self.must_stop)
        if began is not None:
            self._writer.plan_began(began.ticket)
        self.estimator.update(self.state, self.now)
        before, fault = self.ladder.state, self.ladder.fault
        self._set_inputs(before)
        playback = self.ladder.step(self.inputs)
        for name in overridden(self.inputs, before, self.ladder.state):
            self._emit("refused", f"{name}: overridden in its own tick by {', '.join(self.stopped_by) or 'a stop'}")
        if self.ladder.fault != fault:
            self.hardware_failed = self.ladder.fault is not None and self.ladder.fault == self._hardware_fault
            if self.ladder.fault is not None and self.ladder.fault == self.inputs.blocked:
                self._relieve()
        if self.ladder.state is not before:
            self.servo.rejoin()
            self._enter(self.ladder.state, before)
        pins = self.joints.step(self.tick_count, self.state, stands=self._stands)
        if pins is not None:
            self.servo.take_pins(pins)
        self._play(playback)
        self._write_row(playback)
        if playback is Playback.PLAN:
            self.intake.check_underrun(self.tick_count, must_stop=self.must_stop)
        self.inputs.reset()
        self.stopped_by.clear()
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
        late = self.tick_count - self._last_tick > _LATE_TICKS  # the servos have held their goals meanwhile
        self.plausibility.check(
            self.state,
            np.add(self.now.qd, self.offset_speed, out=self._moving),
            self.tick_count,
            powered=powered,
            limp=self.joints.limp,
            moved_s=1.0 / self.robot.rate_hz if late or self._moves_slowly else None,
            lies=self.ladder.state is State.GET_UP,
        )
        if self.plausibility.imu_restored:
            self.estimator.begin_attitude(self.state.accel)
        if late and powered:
            self.servo.rejoin()
        self._last_tick = self.tick_count

    def _set_inputs(self, state: State) -> None:
        """Tell the ladder what was measured and which plan there is."""
        inputs, measured = self.inputs, self.state
        self._hardware_fault = None
        inputs.plan_over = self.intake.over(self.tick_count)
        inputs.plan_ready = self.intake.plan is not None and not inputs.plan_over
        if state is State.READY and self.move.done and not self.gyro_bias.done:
            self._measure_gyro_bias()
        inputs.move_done = self._arrived if state is not State.GET_UP else self.get_up.done
        if state is State.GET_UP:
            failed = self.get_up.failed
            inputs.get_up_failed = None if failed is None else f"get up: {failed}"
        if state is State.OFF or inputs.get_up:
            self._check_start()
            return
        inputs.fallen = self.estimator.has_imu and self._falls()
        if self.now.balanced and not self.suspension.hung:
            believed = measured.imu_stale == 0 and not self.plausibility.imu_doubted
            falls = self.unseen.update(self.estimator, self.now, measured=believed)
            # One that lies may have told of the sway itself, and the robot is parked. Right ones stay believed.
            inputs.unseen = falls and not bool(self.plausibility.imu_suspicion.raised)
        if state in _JUDGED:
            known = (measured.stale == 0) & ~self.joints.limp
            # Judged by the stiff goals: by softer ones a blocked joint would never be named.
            softness = self.servo.softness
            np.add(self.command.position, softness.way, out=self._judged)
            self.obedience.update(self._judged, self._load, measured.position, known, softness.share)
        lost = self.audit.lost_bus(measured)
        if lost is not None:
            self._hardware_fault = inputs.bus_lost = lost
            if not self.driver.connected:
                inputs.cut_off = lost
        elif inputs.fault is None:
            fault = self.audit.problem(measured)
            if fault is None and state is State.READY and not self._arrived:
                fault = self.audit.lying_imu()  # a start, until the robot has stood up
            if fault is None and state in _JUDGED:
                self._look_for_blocks()
            self._hardware_fault = inputs.blocked if fault is None else fault
            inputs.fault = fault
        self.audit.watch_imu(self.estimator.has_imu)

    def _falls(self) -> bool:
        """Whether the torso is tilted further than it is to be."""
        fall_tilt = self.robot.safety.fall_tilt
        if self.estimator.tilt_angle <= fall_tilt:
            return False
        lean, planned = lean_of_angles(*self.estimator.tilt), lean_of(self.now.base[3:])
        # In a bow little is left below the robot: it falls where its turn beyond the plan will have led it.
        beyond = self.estimator.tilt_rate - planned_tilt_rate(self.now, 1.0 / self.robot.rate_hz)
        roll, pitch = _FALLS_ON_S * beyond
        return bool(falls(lean, planned, fall_tilt) or falls(lean + [pitch, -roll], planned, fall_tilt))

    def _look_for_blocks(self) -> None:
        """Tell the ladder which joint does not follow its goals, and whether it carries the robot."""
        self.inputs.blocked = self.audit.blocked()
        joint = self.obedience.worst
        self.inputs.stands = joint is not None and bool(self.joints.carries[joint])

    def _relieve(self) -> None:
        """The goal of a joint that is found to be blocked is where it stands: its servo pushes no more."""
        joint = self.obedience.blocked
        if joint is not None:
            self._pins.fill(np.nan)
            self._pins[joint] = np.clip(self.state.position[joint], self.robot.lower[joint], self.robot.upper[joint])
            self.command.position[joint] = self._pins[joint]
            self.servo.take_pins(self._pins)
        if self.ladder.waits:
            hold_s = self.robot.safety.blocked_hold_s
            self._warn(f"the robot stands frozen with a blocked leg, for {hold_s:g} s: hold it, then disarm it")

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
        """Refuse a start, or getting up, with the reason, while the robot is not fit for it, or does not lie so."""
        if not (self.inputs.start or self.inputs.get_up):
            self.audit.watch(self.state)
            return
        self.audit.take_limits(self.driver.temperature_limit, self.driver.voltage_limit)
        reason = self.joints.restarting or self.audit.refusal(
            self.state, self.plausibility.unread, self.estimator.has_imu
        )
        if self.inputs.get_up:
            if self.inputs.start:  # one operator's arm beside another's: neither check would cover both
                self.inputs.start = False
                self._emit("refused", "ARM: the robot is asked to get up")
            reason = reason or why_not_get_up(self.robot, self.estimator, self.state.gyro, self.state.accel)
            if reason is not None:
                self.inputs.get_up = False
                self._emit("refused", f"{GET_UP}: {reason}")
            return
        reason = reason or why_not_arm(self.robot, self.estimator, self.state.accel)
        if reason is None:
            return
        self.inputs.start = False
        if self.awaits_arm:
            self._emit("refused", f"ARM: {reason}")
        else:
            self.hardware_failed = True
            self._emit("fault", f"no start: {reason}")

    def _warn(self, message: str) -> None:
        self._emit("warning", message)

    def _emit(self, kind: str, message: str) -> None:
        self.telemetry.emit(self.tick_count, kind, message)

    def _enter(self, state: State, before: State) -> None:
        """Act once on a change of state."""
        cause = f": {self.ladder.fault}" if self.ladder.fault else ""
        self._emit("fault" if state is State.FAULT else "state", f"{before.name} -> {state.name}{cause}")
        robot = self.robot
        if before is State.GET_UP:
            self._emit(*(("done", GET_UP) if state is State.READY else ("refused", f"{GET_UP}: {self.ladder.fault}")))
        if state in (State.OFF, State.FAULT, State.GET_UP) or before is State.OFF:
            self.joints.forget()
            self.commands = False
        if state is State.READY:
            # A robot that has got up goes on from its reference, which is what the servos hold.
            pinned = self._switch_on() if before is State.OFF else self.now.q.copy()
            self.obedience.reset(pinned if before is State.OFF else self.state.position)
            self.load.reset()
            self.suspension.reset()
            self.estimator.reset()
            self.unseen.sways = False
            self.gyro_bias.reset()
            self.move.begin(pinned, self.stand_pose, least_s=_STAND_MOVE_S, speed=robot.safety.soft_start_speed)
        elif state is State.GET_UP:
            side = lying_on(self.estimator.tilt, robot.safety.fall_tilt)
            self.get_up.begin(self._switch_on(), robot.get_up.steps[str(side)])
        elif state is State.PARK:
            self.intake.forget()
            # From the reference of the goals, not from the measurement: that is what the servos hold.
            self.move.begin(
                self.now.q,
                robot.rest_pose,
                least_s=robot.safety.park_s,
                speed=2 * robot.safety.soft_start_speed,
                through=self._raised() if tilt_of(self.now.base[3:]) > _BOWED_RAD else None,
            )
        elif state is State.DAMPED:
            self.intake.forget()
            self.driver.damp()
        elif state in (State.OFF, State.FAULT):
            self.intake.forget()
            self.obedience.reset(self.state.position)
            self.driver.set_torque(False)
            if self.driver.holding:
                self._emit("fault", f"torque off is not confirmed by {', '.join(self.driver.holding)}: {_MAY_HOLD}")

    def _raised(self) -> Float:
        """The stand pose, arms and head as they are, (n,) [rad]."""
        pose = self.now.q.copy()
        legs = self.joints.carries
        pose[legs] = self.stand_pose[legs]
        return pose

    def _switch_on(self) -> Float:
        """Switch the torque on, and begin where the driver has pinned the joints, (n,) [rad]."""
        begin = time.perf_counter_ns()
        self.driver.set_torque(True)
        self._waited_s = (time.perf_counter_ns() - begin) * 1e-9
        pinned = self.state.position.copy()
        self.driver.take_pins(pinned)
        self.servo.reset(pinned)
        self.command.position[:] = pinned
        return pinned

    def _play(self, playback: Playback) -> None:
        if playback is not Playback.PLAN:
            self._forget_push()
        if playback in (Playback.NOTHING, Playback.DAMP):
            self.now.balanced = False
            return
        expected = self.plausibility.expected if self.plausibility.returned else None
        if playback is Playback.FREEZE:
            self.now.qd[:] = 0.0
            self.servo.softness.reset()
            self.command.position[:] = self.servo.held(self.state, expected)
            self.driver.write(self.command)
            return
        plan = self.intake.plan if playback is Playback.PLAN else None
        if playback is Playback.GET_UP:
            self.get_up.step(self.now, self.estimator.tilt if self.estimator.has_imu else None)
            self.ahead.copy(self.now)
        elif plan is not None:
            place = float(self.tick_count - plan.start_tick)
            self.now.take(plan, place)
            self.ahead.take(plan, place + self._lead)
            self.servo.take_cap(plan.torque_cap)
        else:
            self.servo.take_cap(self._uncapped)
            self.move.step(self.now)
            self.ahead.copy(self.now)
        self._moves_slowly = plan is None
        np.copyto(self._load, self.now.torque if playback is Playback.GET_UP else self._torque())
        if plan is not None:
            self._answer_push()
        self.joints.lead(self.ahead, self._load, self.state)
        if self.now.balanced and not self.suspension.hung:
            self.strikes.update(self.estimator)
        else:
            self.strikes.reset()
        self.commands = True
        goals = self.servo.update(
            self.ahead.q,
            self.ahead.qd,
            self._load,
            self.state,
            expected,
            stiffness=self.ahead.stiffness,
            struck=self.strikes.change,
            slow=plan is None and playback is not Playback.GET_UP,
            pushed=self.correction.acts,
            impacts=playback is Playback.GET_UP
            or self.correction.falls
            or (self.unseen.sways and not self.estimator.has_imu),
        )
        self.command.position[:] = goals
        repairs = self.telemetry.row.repairs
        repairs[_POSITION] += self.servo.position_clamps
        repairs[_TORQUE] += self.servo.torque_clamps
        self.driver.write(self.command)

    def _answer_push(self) -> None:
        """Add to the reference of a plan what a robot that sways or tilts does beside it."""
        hung, measured = self.suspension.hung, self.state
        believed = measured.imu_stale == 0 and not self.plausibility.imu_doubted
        self.correction.update(
            self.estimator, self.now, hung=hung, measured=believed and int(measured.stale.max()) < self.driver.turns
        )
        levels = self.level.update(self.estimator, self.now, hung=hung)
        self.heel.update(
            self.estimator, self.now, measured=believed and not (levels or self.correction.acts), hung=hung
        )
        np.add(self.level.offset, self.correction.offset, out=self.offset)
        np.add(self.level.speed, self.correction.speed, out=self.offset_speed)
        self.offset += self.heel.offset
        self.offset_speed += self.heel.speed
        self.ahead.q += self.offset
        self.ahead.qd += self.offset_speed

    def _forget_push(self) -> None:
        """What plays is no plan: nothing answers beside it, and no joint is expected to move on by an answer."""
        self.level.reset()
        self.correction.reset()
        self.heel.reset()
        self.offset[:] = self.offset_speed[:] = 0.0

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
        # Joints that have left the plan on purpose do not sag by that.
        self.load.update(np.add(now.q, self.offset, out=self._moving), measured.position, now.torque)
        return self.load.factor * self.ahead.torque + self.stabiliser.torque

    def _write_row(self, playback: Playback) -> None:
        """Fill this tick's row."""
        row, writer, intake, now = self.telemetry.row, self._writer, self.intake, self.now
        writer.write_state(self.tick_count, self.ladder.state, self.estimator)
        row.ready[...], row.plan_over[...], row.must_stop[...] = (
            self.ready,
            intake.over(self.tick_count),
            self.must_stop,
        )
        row.faulted[...] = self.ladder.fault is not None
        row.offer[...], row.pending[...] = intake.examined, 0 if intake.waiting is None else intake.waiting.ticket.id
        row.disbelieved[...] = self.plausibility.disbelieved
        row.limp[...] = self.joints.limp
        row.hung[...], row.hardware_failed[...] = self.suspension.hung, self.hardware_failed
        writer.write_measured(self.state)
        writer.write_plan(intake.playing)
        if playback in (Playback.NOTHING, Playback.DAMP):
            return
        writer.write_reference(now, self.command, self.servo.softness, self.offset, self.offset_speed)
        if now.balanced:
            writer.write_balance(now, self.estimator, self.stabiliser)
        if intake.plan is not None and playback is Playback.PLAN:
            writer.write_progress(self.tick_count, intake.plan)
