"""`SimDriver`: the robot simulated in MuJoCo, with a free-floating torso, on a floor."""

from __future__ import annotations

import logging
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict
from flexmotion.drivers.interface import Capabilities, JointCommand, RobotState
from flexmotion.drivers.plant import ServoPlant
from flexmotion.drivers.random_errors import RandomErrors
from flexmotion.drivers.receiver import Receiver
from flexmotion.drivers.sim.false_state import falsify
from flexmotion.drivers.sim.goal_line import GoalLine
from flexmotion.drivers.sim.ground_truth import GroundTruth
from flexmotion.drivers.sim.imu import SimImu
from flexmotion.drivers.sim.options import BUS_S, Push, SimOptions
from flexmotion.drivers.sim.process import SimProcess
from flexmotion.drivers.sim.pushes import PushSchedule
from flexmotion.drivers.sim.world import HOLDER, build_model, start_qpos
from flexmotion.drivers.simulated import LockstepDriver, Truth

Float = NDArray[np.float64]

OVERHEATED = 0x04
"""Hardware error bit of a servo that overheated and shut down (bit 2 of Dynamixel's hardware error status)."""

BLOCKED_SHARE, BLOCKED_IMPEDANCE = 12.0, (0.999, 0.9999, 0.001, 0.5, 2.0)
"""Friction of a blocked joint over its servo's stall torque, and the impedance (`solimp`) of this constraint: against
all torque of a servo it creeps by a few ticks a second. A damping that no servo overcomes is outside MuJoCo's solver:
the state of a walking robot diverged."""

_ON_ITS_SIDE = 0.5
"""Sine of the torso's lean from which on the robot lies on its side."""
_PARKED = 0.25
"""Share of the way from the rest pose to the stand pose up to which the joints count as parked."""

log = logging.getLogger(__name__)


class SimDriver(LockstepDriver):
    """Physics in this process, in lockstep: time passes only in `advance`.

    A tick is `read`, `write`, `advance(1 / rate)`. Equal options and commands give equal runs, bit for bit.

    Attributes:
        model, data: MuJoCo's, for viewers; only the driver changes `data`.
        plant: the servos.
    """

    name = "sim"
    Options = SimOptions

    def __init__(self, robot: Robot, *, options: Strict | None = None) -> None:
        super().__init__(robot, options=options)
        if not isinstance(self.options, SimOptions):
            raise TypeError(f"SimDriver takes SimOptions, not {type(self.options).__name__}")
        self._settings: SimOptions = self.options
        self.model = build_model(robot, self._settings)
        self.data = mujoco.MjData(self.model)
        self._torso = robot.torso_id
        self._qpos, self._dof = _index(robot.qpos_address), _index(robot.dof_address)
        self._truth = GroundTruth(robot, self.model, self.data)
        self._weld = self.model.equality(HOLDER).id
        self._has_current = np.array([servo.current_unit is not None for servo in robot.servos])
        self._free: dict[int, tuple[float, Float]] = {}  # friction and impedance of joints that were blocked
        self._open = False
        self._restarted: list[tuple[int, str | None]] = []
        self._reset()

    @property
    def capabilities(self) -> Capabilities:
        """An IMU if the robot file and the options have one, effort if a servo measures current, all of simulation."""
        return Capabilities(
            imu=self._imu is not None,
            effort=bool(self._has_current.any()),
            torque_bound=True,
            joint_torque=True,
            reboot=True,
            lockstep=True,
            truth=True,
        )

    @property
    def delay_s(self) -> float:
        """The command delay [s], without `extra_latency_s`: the driver does not report that mismatch."""
        given = self._settings.command_delay_s
        return BUS_S + self.robot.servo_delay if given is None else given

    @property
    def violations(self) -> int:
        """Goals outside the servos' envelope (see `flexmotion.drivers.receiver`)."""
        return self._goals.receiver.violations

    @property
    def time(self) -> float:
        """Simulated time since `open` [s]."""
        return self._steps * self._settings.timestep

    @property
    def receiver(self) -> Receiver:
        """Takes goals and counts those outside the envelope."""
        return self._goals.receiver

    @property
    def position(self) -> Float:
        """True joint angles now, (n,) [rad]; valid until the next `advance`."""
        return self._newest[: self.robot.n]

    @property
    def velocity(self) -> Float:
        """True joint speeds now, (n,) [rad/s]; valid until the next `advance`."""
        return self._newest[self.robot.n : 2 * self.robot.n]

    @property
    def torso_height(self) -> float:
        """Height of the torso above the world's origin [m]."""
        return float(self.data.xpos[self._torso, 2])

    @property
    def torso_up(self) -> float:
        """Cosine of the torso's tilt against the world's vertical."""
        return float(self.data.xmat[self._torso, 8])

    def open(self) -> None:
        """Put the robot on the floor in its start pose, torque off; its torso is held if option `held` is set."""
        self._reset()
        self._open = True

    def detached(self, *, realtime: bool) -> SimProcess:
        """See `LockstepDriver`."""
        return SimProcess(self, realtime=realtime)

    def close(self) -> None:
        """Torque off. May be called twice."""
        if self._open:
            self.set_torque(False)
            self._open = False

    def set_torque(self, on: bool) -> None:
        """Switch all servos at once. On: goals are pinned, damping ends, and the torso is released."""
        if on:
            self._pin_goals()
            self.plant.stiffen()
            self.plant.enabled[:] = self._hardware_error == 0
            self.release()
        else:
            self.plant.enabled[:] = False

    def switch(self, which: NDArray[np.bool_], on: bool) -> None:
        """See `Driver`. A servo that has shut down stays without torque."""
        if on:
            self._goals.pin_some(self.position, which)
        self.plant.enabled[which] = on
        self.plant.enabled &= self._hardware_error == 0

    def reboot(self, which: NDArray[np.bool_]) -> None:
        """See `Driver`. It takes no time; a servo that is still too hot shuts down again."""
        self.plant.enabled[which] = False
        self._hardware_error[which] = 0
        self._restarted += [(int(joint), None) for joint in np.flatnonzero(which)]

    def take_restarted(self) -> list[tuple[int, str | None]]:
        """See `Driver`."""
        restarted, self._restarted = self._restarted, []
        return restarted

    def release(self) -> None:
        """Stop holding the torso, unless the robot is suspended."""
        if not self._settings.suspended:
            self.data.eq_active[self._weld] = 0

    def place(self) -> None:
        """Put the robot into its start pose, at rest, as `open` does; torque stays on or off."""
        robot, options, data = self.robot, self._settings, self.data
        mujoco.mj_resetData(self.model, data)
        pose = robot.stand_pose if options.start == "stand" else robot.rest_pose
        data.qpos[:] = start_qpos(robot, self.model, pose, options)
        data.mocap_pos[0], data.mocap_quat[0] = data.qpos[:3], data.qpos[3:7]
        data.eq_active[self._weld] = options.suspended or options.held or options.picked_up_s is not None
        mujoco.mj_forward(self.model, data)
        imu = robot.config.imu
        if imu is not None and self._imu is not None:
            carrier = data.xmat[self.model.body(imu.body).id].reshape(3, 3)
            self._imu.reset(carrier[2])
        self._remember()
        self._history[:] = self._newest
        self._pin_goals()

    def receive(self, goal: Float, which: NDArray[np.bool_], bound: Float) -> None:
        """Take goals [rad] and torque bounds [N·m] from an emulated bus, (n,) each.

        All of `goal` and `bound` takes effect; only goals of servos marked in `which` are counted against the envelope.
        """
        self._goals.send(goal, bound, self.position, self.velocity, self.plant, which)

    def block(self, joint: int, on: bool) -> None:
        """Hold a joint by friction that no servo overcomes, or let it go."""
        dof = int(self.robot.dof_address[joint])
        model = self.model
        if joint not in self._free:
            self._free[joint] = float(model.dof_frictionloss[dof]), model.dof_solimp[dof].copy()
        blocked = BLOCKED_SHARE * float(self.robot.stall_torque[joint]), BLOCKED_IMPEDANCE
        model.dof_frictionloss[dof], model.dof_solimp[dof] = blocked if on else self._free[joint]

    def push(self, impulse: tuple[float, float, float], seconds: float) -> None:
        """Push the torso from now on.

        Args:
            impulse: in the world frame [N·s].
            seconds: over which it is spread [s].
        """
        self._pushes.add(Push(at=self.time, impulse=impulse, duration=seconds))

    def damp(self) -> None:
        """Pin the goals and lower gain and voltage (see `ServoPlant.damp`)."""
        self._pin_goals()
        self.plant.damp()

    def write(self, command: JointCommand) -> None:
        """Send goals: they are quantised and counted against the envelope now, and take effect after the delay."""
        self._goals.send(command.position, command.torque_bound, self.position, self.velocity, self.plant)

    def read(self, state: RobotState) -> None:
        """Fill `state` with measurements that are `read_delay_s` old; effort, voltage and temperature are current.

        Option `false_readings` makes a share of them false.
        """
        robot, row = self.robot, self._history[(self._steps - self._read_steps) % len(self._history)]
        n = robot.n
        robot.from_ticks(robot.to_ticks(row[:n], out=state.position), out=state.position)
        state.velocity[:] = row[n : 2 * n]
        np.copyto(state.effort, self.plant.torque, where=self._has_current)
        state.voltage.fill(round(self.plant.voltage, 1))
        np.rint(self.plant.temperature, out=state.temperature)
        state.hardware_error[:] = self._hardware_error
        state.stale.fill(0)
        if self._imu is None:
            state.imu_stale = -1
        else:
            self._imu.read(row[2 * n :], state.gyro, state.accel)
            state.imu_stale = 0
        if self._settings.false_readings:
            falsify(self._errors, robot, state)
        state.stamp_ns = round(max(self._steps - self._read_steps, 0) * self._settings.timestep * 1e9)

    def advance(self, seconds: float) -> None:
        """Simulate `seconds` in whole physics steps; the remainder is carried over to the next call."""
        self._owed += seconds / self._settings.timestep
        steps = int(self._owed + 1e-6)
        self._owed -= steps
        if not steps:
            return
        self._torque.fill(0.0)
        self._saturated.fill(0.0)
        for _ in range(steps):
            self._step()
        self._torque /= steps
        self._saturated /= steps
        self.plant.draw(self._torque, steps * self._settings.timestep)
        hot = self.plant.temperature > self._temperature_limit
        if hot.any():
            self._shut_down(hot)
        if self._settings.picked_up_s is not None:
            self._lie(seconds, self._settings.picked_up_s)

    def _lie(self, seconds: float, picked_up_s: float) -> None:
        """Count the time without torque, then set the robot up; `_off_s` is infinite before torque, and after that.

        A robot that lay when its torque went off, or fell since it was not parked then, stays where it lies, on a side
        from which it can get up. One that tips over as it rests is set up.
        """
        if self.plant.enabled.any():
            self._off_s, self._fell = 0.0, self._lies or not self._is_parked
        elif self._fell and self._lies and self._gets_up:
            return
        elif np.isfinite(self._off_s):
            self._off_s += seconds
            if self._off_s > picked_up_s:
                self._off_s = np.inf
                self.place()

    @property
    def _lies(self) -> bool:
        return self.torso_up < math.cos(self.robot.safety.fall_tilt)

    @property
    def _is_parked(self) -> bool:
        """Whether the joints are near the rest pose, by those that differ in the stand pose: limp arms hardly count."""
        way = self.robot.stand_pose - self.robot.rest_pose
        return bool((self.position - self.robot.rest_pose) @ way <= _PARKED * (way @ way))

    @property
    def _gets_up(self) -> bool:
        """Whether it lies on a side that its get-up file has steps for."""
        ahead, left, _ = self.data.xmat[self._torso].reshape(3, 3)[2]
        return abs(left) < _ON_ITS_SIDE and ("front" if ahead < 0.0 else "back") in self.robot.get_up.steps

    def truth(self) -> Truth:
        """The true state now; torque and saturation are those of the last `advance`."""
        return self._truth.read(self._torque, self._saturated)

    def _reset(self) -> None:
        robot, options = self.robot, self._settings
        n = robot.n
        sensors, pushes = (np.random.default_rng([options.seed, stream]) for stream in (0, 1))
        imu = robot.config.imu if options.imu else None
        self._imu = None if imu is None else SimImu(imu, self.model, options, sensors)
        self._pushes = PushSchedule(options, pushes)
        self._errors = RandomErrors(options.false_readings, options.seed)
        self.plant = ServoPlant(
            robot, kp_scale=options.kp_scale, supply=options.voltage, resistance=options.supply_resistance
        )
        self._hardware_error = np.zeros(n, np.int64)
        self._restarted = []
        self._temperature_limit = np.array([servo.temperature_limit for servo in robot.servos])

        self._goals = GoalLine(robot, robot.stand_pose, self.delay_s + options.extra_latency_s)
        self._read_steps = round(options.read_delay_s / options.timestep)
        self._history = np.zeros((self._read_steps + 1, 2 * n + 6))
        self._torque, self._saturated = np.zeros(n), np.zeros(n)
        self._steps, self._owed, self._pushed, self._off_s = 0, 0.0, False, np.inf
        self._fell = False
        self.place()

    def _step(self) -> None:
        data, n, plant, row = self.data, self.robot.n, self.plant, self._newest
        self._goals.advance(self._settings.timestep, plant)
        data.qfrc_applied[self._dof] = plant.step(row[:n], row[n : 2 * n])
        self._push()
        mujoco.mj_step(self.model, data)
        self._steps += 1
        self._torque += plant.torque
        self._saturated += plant.saturated
        if self._imu is not None:
            self._imu.step(data)
        self._remember()

    def _push(self) -> None:
        force = self._pushes.force(self._steps)
        if force is not None:
            self.data.xfrc_applied[self._torso, :3] = force
        elif self._pushed:
            self.data.xfrc_applied[self._torso] = 0.0
        self._pushed = force is not None

    def _remember(self) -> None:
        """Store the present joint positions, speeds and IMU sample; `read` returns them `read_delay_s` later."""
        n = self.robot.n
        row = self._newest = self._history[self._steps % len(self._history)]
        row[:n] = self.data.qpos[self._qpos]
        row[n : 2 * n] = self.data.qvel[self._dof]
        if self._imu is not None:
            row[2 * n :] = self._imu.sample

    def _pin_goals(self) -> None:
        """Set the goals to the present positions; goals still in the delay line are dropped."""
        self._goals.pin(self.position)

    def _shut_down(self, hot: NDArray[np.bool_]) -> None:
        """Servos past their temperature limit switch their own torque off, as real servos do."""
        for index in np.flatnonzero(hot & (self._hardware_error == 0)):
            log.warning("joint %s: servo overheated and shut down", self.robot.joint_names[index])
        self._hardware_error[hot] |= OVERHEATED
        self.plant.enabled[hot] = False


def _index(addresses: NDArray[np.int64]) -> slice | NDArray[np.int64]:
    """Indices of the joints in `qpos` or `qvel`; a slice if they are consecutive, which numpy reads without a copy."""
    first, n = int(addresses[0]), len(addresses)
    return slice(first, first + n) if np.array_equal(addresses, np.arange(first, first + n)) else addresses
