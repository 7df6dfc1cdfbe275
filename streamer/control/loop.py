"""The control loop: one `tick` reads the robot, decides, and sends goals. Lockstep and the real clock share it."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import Driver, JointCommand, RobotState
from flexmotion.drivers.simulated import SimulatedDriver, simulated
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.estimator import Estimator
from flexmotion.streamer.control.gyro_bias import GyroBias
from flexmotion.streamer.control.ladder import Inputs, Ladder, Playback, State
from flexmotion.streamer.control.load_estimator import LoadEstimator
from flexmotion.streamer.control.plan_buffer import Offer, PlanBuffer, Ticket
from flexmotion.streamer.control.posture_move import PostureMove
from flexmotion.streamer.control.punctuality import Punctuality
from flexmotion.streamer.control.reference import Reference
from flexmotion.streamer.control.servo_command import ServoCommand
from flexmotion.streamer.control.stabiliser import Stabiliser
from flexmotion.streamer.control.suspension import Suspension
from flexmotion.streamer.control.telemetry import Telemetry
from flexmotion.streamer.control.tick_row import REPAIRS

Float = NDArray[np.float64]

_MEASURED = (
    *("position", "velocity", "effort", "voltage", "temperature", "stale", "hardware_error", "imu_stale"),
    *("gyro", "accel"),
)
_COLUMNS = {"position": "q", "velocity": "qd"}
"""What a row holds of `RobotState`, and where names differ."""
_POSITION, _TORQUE = REPAIRS.index("position"), REPAIRS.index("torque")
_STAND_MOVE_S = 0.5
"""Shortest move to the stand pose, also when the robot already stands there."""


class ControlLoop:
    """Ladder, reference, estimator, stabiliser, servo command and driver, in the order in which a tick needs them.

    Args:
        plans: where the planner puts its plans.
        telemetry: where every tick is told.
        feedback: whether balance feedback acts.

    Attributes:
        tick_count: ticks done; the next `tick` is that number.
        inputs: requests for the next tick; cleared after it.
        playing: the plan that plays; `waiting` the one that takes over at its start tick.
        winding_down: from now on only a plan that stops is taken.
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
        self.servo = ServoCommand(robot, driver.delay_s)
        self.move = PostureMove(robot, retargeter.body.dynamics)
        self.stand_pose = retargeter.layout.view(retargeter.standing()).q[0].copy()
        self.playing: Offer | None = None
        self.waiting: Offer | None = None
        self.winding_down = self.hardware_failed = False
        self.tick_count = 0
        self._looked_at = self._ran_out = 0
        self._described = -1
        self._answered: Ticket | None = None
        self._seen, self._unread = np.full(robot.n, np.nan), np.zeros(robot.n, np.int64)
        self._imu_unread = self._low_reads = 0
        self._lead = driver.delay_s * robot.rate_hz
        self._warned: set[str] = set()
        self._waited_s = 0.0
        self._found: str | None = None  # what is wrong with the hardware, on this tick
        self._shutdown_at = np.array([servo.temperature_limit for servo in robot.servos])

    @property
    def ready(self) -> bool:
        """Whether the robot stands and waits for its first plan."""
        return self.ladder.state is State.READY and self._arrived

    @property
    def _arrived(self) -> bool:
        """Whether a slow move is over, and the rest after that to the stand pose."""
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
        """Whether only a plan that stops is taken."""
        return self.winding_down or self.ladder.stopping or self.ladder.fault is not None

    def touch(self) -> None:
        """Touch the memory that ticks will need."""
        self.telemetry.ticks.touch()
        self.telemetry.events.touch()
        self.plans.touch()

    def tick(self, late_ns: int = 0) -> None:
        """One period: read, decide, send, tell.

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
        self._look(before)
        playback = self.ladder.step(self.inputs)
        if self.ladder.fault != fault:
            self.hardware_failed = self.ladder.fault is not None and self.ladder.fault == self._found
        if self.ladder.state is not before:
            self._enter(self.ladder.state, before)
        self._play(playback)
        self._describe(playback)
        self.inputs.reset()
        self.tick_count += 1
        row = self.telemetry.row
        row["stamp_ns"], row["lateness_s"] = begin, late_ns * 1e-9
        row["work_s"] = (time.perf_counter_ns() - begin) * 1e-9
        self.telemetry.commit()

    def _read(self) -> None:
        """Read; what is no number counts as not having answered: such a joint is taken to move as it was meant to."""
        state = self.state
        self.driver.read(state)
        self.driver.take_pins(self.servo.goal)  # of servos that were switched on again
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

    def _take_plan(self) -> None:
        """Let the waiting plan take over when its tick has come; a newer one that fits takes its place."""
        standing = self.ladder.state in (State.READY, State.HOLD)
        if self.waiting is not None and standing and self.must_stop and not self.waiting.ticket.stops:
            # Accepted before the stop was asked for: a robot that stands does not start to walk after it.
            self.waiting = None
            self.plans.hold(self.playing, None)
        if self.waiting is not None and self.tick_count >= self.waiting.plan.start_tick:
            self._begin_plan(self.waiting)
        offer = self.plans.newest(self._looked_at)
        if offer is None:
            return
        # One that goes on from the plan that waits is looked at once that one plays.
        if self.waiting is None or offer.ticket.resumed != self.waiting.ticket.id:
            self._looked_at = offer.ticket.id
            if self._acceptable(offer):
                self.waiting = offer
                if self.tick_count == offer.plan.start_tick:
                    self._begin_plan(offer)
        self.plans.hold(self.playing, self.waiting)

    def _begin_plan(self, offer: Offer) -> None:
        self.playing, self.waiting = offer, None
        self.plans.hold(offer, None)
        row, ticket = self.telemetry.row, offer.ticket
        if ticket.target > row["target"]:
            self._answered = ticket
        row["target"] = max(ticket.target, int(row["target"]))

    def _acceptable(self, offer: Offer) -> bool:
        """Whether a plan may be played: it goes on from what plays, it is not late, and it stops where it must."""
        if self.ladder.state not in (State.READY, State.STREAMING, State.HOLD):
            return False
        if offer.plan.start_tick < self.tick_count:
            # Never played late. The next one joins at the next slot.
            self.telemetry.row["late_plans"] += 1
            return False
        playing = 0 if self.playing is None else self.playing.ticket.id
        return offer.ticket.resumed == playing and (offer.ticket.stops or not self.must_stop)

    def _look(self, state: State) -> None:
        """Fill what the ladder must know from what was measured."""
        inputs, robot, measured = self.inputs, self.robot, self.state
        limits, self._found = robot.safety, None
        inputs.plan_ready = self.plan is not None and not self.plan_over
        inputs.plan_over = self.plan_over
        if state is State.READY and self.move.done and not self.gyro_bias.done:
            self._rest()
        inputs.move_done = self._arrived
        if state is State.OFF:
            self._audit()
            return
        tilted = math.hypot(*self.estimator.tilt) > limits.fall_tilt
        inputs.fallen = bool(self.estimator.has_imu and tilted)
        if measured.stale.min() > limits.max_stale_reads:
            reads = f"{int(measured.stale.min())} reads{self.punctuality.remark}"
            self._found = inputs.bus_lost = f"bus lost: no joint has answered for {reads}"
        elif inputs.fault is None:
            self._found = inputs.fault = self._problem()
        if not self.estimator.has_imu:
            self._warn("imu", "no IMU: the robot runs open loop, falls are not detected")

    def _rest(self) -> None:
        """The robot stands and waits: what the gyro measures now is its bias."""
        rest, measured = self.gyro_bias, self.state
        if not self.estimator.has_imu:
            rest.give_up("no IMU")
        elif self.suspension.hung:
            # It swings, slower than a rest is long.
            rest.give_up("the robot hangs")
        elif measured.imu_stale == 0:
            rest.add(measured.gyro, measured.accel)
        if not rest.done:
            return
        self.estimator.gyro_bias[:] = rest.bias
        if not rest.known and self.estimator.has_imu:
            self._event("warning", f"{rest.reason}: the gyro's bias is not known, none is taken out")

    def _audit(self) -> None:
        """A start is refused, with its reason, while anything is wrong that could be known before torque goes on."""
        if not self.inputs.start:
            return
        robot, position = self.robot, self.state.position
        silent = np.flatnonzero(self._unread)
        # Further out than its stops let it sag: it was forced, or its zero is wrong, and no goal can be pinned there.
        margin = robot.safety.standing_margin
        outside = np.flatnonzero((position < robot.lower - margin) | (position > robot.upper + margin))
        imu = robot.config.imu
        if len(silent):
            reason: str | None = self._name("returns no position", int(silent[0]))
        elif len(outside):
            joint = int(outside[0])
            reason = self._name(
                f"stands at {position[joint]:.2f} rad, more than {margin:g} rad outside "
                f"[{robot.lower[joint]:.2f}, {robot.upper[joint]:.2f}]: move it by hand",
                joint,
            )
        elif imu is not None and imu.required and not self.estimator.has_imu:
            reason = "the robot file requires an IMU and none answers"
        else:
            reason = self._problem()
        if reason is not None:
            self.inputs.start, self.hardware_failed = False, True
            self._event("fault", f"no start: {reason}")

    def _problem(self) -> str | None:
        """What is wrong with servos, IMU or supply, if anything."""
        measured, limits = self.state, self.robot.safety
        if measured.stale.max() > limits.max_stale_reads:
            return self._name(f"does not answer{self.punctuality.remark}", int(np.argmax(measured.stale)))
        if measured.hardware_error.any():
            worst = int(np.flatnonzero(measured.hardware_error)[0])
            return self._name(f"reports hardware error 0x{int(measured.hardware_error[worst]):02x}", worst)
        imu = self.robot.config.imu
        if imu is not None and imu.required and measured.imu_stale > limits.max_stale_reads:
            return f"IMU has not answered for {measured.imu_stale} reads{self.punctuality.remark}"
        heat = measured.temperature - self._shutdown_at
        if np.fmax.reduce(heat) > -2 * limits.thermal_margin:
            hottest = int(np.nanargmax(heat))
            now, shutdown = measured.temperature[hottest], self._shutdown_at[hottest]
            degrees = f"is at {now:.0f} °C and shuts down at {shutdown:.0f} °C"
            if heat[hottest] > -limits.thermal_margin:
                return self._name(degrees, hottest)
            self._warn(f"heat {hottest}", self._name(degrees, hottest))
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
        self.telemetry.tell(self.tick_count, kind, message)

    def _enter(self, state: State, before: State) -> None:
        """What happens once when a state begins."""
        cause = f": {self.ladder.fault}" if self.ladder.fault else ""
        self._event("fault" if state is State.FAULT else "state", f"{before.name} -> {state.name}{cause}")
        robot = self.robot
        if state is State.READY:
            begin = time.perf_counter_ns()
            self.driver.set_torque(True)
            self._waited_s = (time.perf_counter_ns() - begin) * 1e-9
            pinned = self.state.position.copy()
            self.driver.take_pins(pinned)
            self.servo.reset(pinned)
            self.load.reset()
            self.suspension.reset()
            self.estimator.reset()
            self.gyro_bias.reset()
            self.command.position[:] = pinned
            self.move.begin(pinned, self.stand_pose, least_s=_STAND_MOVE_S, speed=robot.safety.soft_start_speed)
        elif state is State.PARK:
            self._forget_plans()
            # From the goals' reference, not from the measurement: the servos hold the one, not the other.
            self.move.begin(
                self.now.q, robot.rest_pose, least_s=robot.safety.park_s, speed=2 * robot.safety.soft_start_speed
            )
        elif state is State.DAMPED:
            self._forget_plans()
            self.driver.damp()
        elif state in (State.OFF, State.FAULT):
            self._forget_plans()
            self.driver.set_torque(False)

    def _forget_plans(self) -> None:
        self.playing = self.waiting = None
        self.plans.hold(None, None)

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
        torque = self._torque()
        goal = self.servo.update(self.ahead.q, self.ahead.qd, torque, self.state)
        self.command.position[:] = goal
        repairs = self.telemetry.row["repairs"]
        repairs[_POSITION] += self.servo.position_clamps
        repairs[_TORQUE] += self.servo.torque_clamps
        self.driver.write(self.command)

    def _torque(self) -> Float:
        """What the servos are to make beyond following, (n,) [N·m]: carry the robot, and balance it."""
        now, measured, suspension = self.now, self.state, self.suspension
        if suspension.update(self.command.position, measured.position, measured.velocity, now.torque):
            self._event("note", "the feet are in the air: balance is off" if suspension.hung else "back on its feet")
        if suspension.hung:
            torque = self.ahead.torque.copy()
            torque[suspension.legs] = 0.0
            return torque
        self.stabiliser.update(self.estimator, now)
        self.load.update(now.q, measured.position, now.torque)
        return self.load.factor * self.ahead.torque + self.stabiliser.torque

    def _describe(self, playback: Playback) -> None:
        """Fill this tick's row."""
        row, state, now = self.telemetry.row, self.state, self.now
        row["tick"], row["state"] = self.tick_count, self.ladder.state
        row["ready"], row["plan_over"], row["must_stop"] = self.ready, self.plan_over, self.must_stop
        row["offer"], row["pending"] = self._looked_at, 0 if self.waiting is None else self.waiting.ticket.id
        row["violations"] = self.driver.violations
        for name in _MEASURED:
            row[_COLUMNS.get(name, name)] = getattr(state, name)
        row["tilt"], row["hung"] = self.estimator.tilt, self.suspension.hung
        row["hardware_failed"] = self.hardware_failed
        row["contact_ref"] = False
        self._describe_plan()
        robot = simulated(self.driver)
        if robot is not None:
            self._describe_truth(robot)
        if playback in (Playback.NOTHING, Playback.DAMP):
            return
        row["q_cmd"] = self.command.position
        row["q_ref"], row["qd_ref"], row["torque_ref"] = now.q, now.qd, now.torque
        if not now.balanced:
            return
        row["com_ref"], row["dcm_ref"], row["zmp_ref"] = now.com, now.dcm, now.zmp
        row["com"], row["dcm"], row["zmp_shift"] = self.estimator.com, self.estimator.dcm, self.stabiliser.zmp_shift
        row["foot_ref"], row["contact_ref"], row["base_ref"] = now.feet, now.contacts, now.base
        if self.playing is not None and playback is Playback.PLAN:
            self._describe_progress(self.playing)

    def _describe_plan(self) -> None:
        """Which plan plays, and what it took to make."""
        row, playing = self.telemetry.row, self.playing
        if playing is None:
            row["plan"] = row["plan_start"] = row["plan_end"] = row["asked_tick"] = 0
            return
        ticket = playing.ticket
        row["plan"], row["asked_tick"] = ticket.id, ticket.asked_tick
        row["plan_start"], row["plan_end"] = playing.plan.start_tick, playing.plan.end_tick
        row["sample_s"], row["retarget_s"] = ticket.sample_s, ticket.retarget_s
        if self._answered is not None:
            waited = (time.perf_counter_ns() - ticket.target_ns) * 1e-9
            row["target_to_command_s"] = waited
            if ticket.effect_row >= 0:
                row["target_to_effect_s"] = waited + ticket.effect_row / self.robot.rate_hz
            self._answered = None

    def _describe_progress(self, playing: Offer) -> None:
        """Where in its plan the robot is, and what that row cost."""
        row, plan = self.telemetry.row, playing.plan
        place = self.tick_count - plan.start_tick
        if not 0 <= place < len(plan):
            return
        row["source_s"] = plan.source_s[place]
        row["hand_error"] = plan.hand_error[place]
        for index, kind in enumerate(REPAIRS):
            row["repairs"][index] += plan.repairs[kind][place]
        # Ticks may have been skipped since the last one.
        since, self._described = self._described, self.tick_count
        for step in plan.steps:
            if since < step.lift <= self.tick_count:
                row["steps_planned"] += 1
                row["steps_inserted"] += int(step.inserted)
        ticket = playing.ticket
        if (
            place >= plan.stop_row
            and ticket.id != self._ran_out
            and not (ticket.stops or ticket.source_over or self.must_stop)
        ):
            self._ran_out = ticket.id
            row["underruns"] += 1
            self._event("warning", f"no plan followed plan {ticket.id}: its own stop is played")

    def _describe_truth(self, robot: SimulatedDriver) -> None:
        row, truth = self.telemetry.row, robot.truth()
        row["robot_lateness_s"] = robot.lateness_s
        row["true_base"][:3], row["true_base"][3:] = truth.base_position, truth.base_quaternion
        row["true_q"], row["true_com"] = truth.joint_position, truth.com
        row["true_foot"], row["true_foot_velocity"] = truth.foot_position, truth.foot_velocity
        row["true_foot_force"] = truth.foot_force
        row["true_torque"], row["true_saturated"] = truth.torque, truth.saturated
        row["true_self_contact"] = truth.self_contact
