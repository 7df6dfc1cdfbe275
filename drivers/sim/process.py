"""`SimProcess`: the simulated robot in a process of its own, on the real clock, as hardware is."""

from __future__ import annotations

import contextlib
import time
from dataclasses import fields
from multiprocessing.connection import Connection, Pipe
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.drivers.interface import Capabilities, Driver, JointCommand, RobotState, Truth
from flexmotion.drivers.realtime import child, priority
from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.drivers.realtime.ticker import Ticker

if TYPE_CHECKING:
    from flexmotion.drivers.sim.driver import SimDriver

QUANTUM_S = 0.002
"""Simulated time goes on in steps of this, each when its time has come [s]: a quarter of a servo bus's usual cycle."""
_OPEN_PATIENCE_S, _CLOSE_PATIENCE_S = 5.0, 1.0
_PAUSE_S = 0.1
"""What shares its processor with others may pause for longer than a servo bus ever does, and is alive [s]."""
_GOALS, _TORQUE_ON, _TORQUE_OFF, _DAMP, _END = range(5)
_TRUTH = tuple(field.name for field in fields(Truth))
_STATE = ("position", "velocity", "effort", "voltage", "temperature", "hardware_error", "gyro", "accel")


def _command_dtype(n: int) -> np.dtype[Any]:
    return np.dtype([("kind", "i8"), ("position", "f8", n), ("torque_bound", "f8", n)])


def _state_dtype(n: int) -> np.dtype[Any]:
    return np.dtype(
        [
            ("stamp_ns", "i8"),
            ("imu_stale", "i8"),
            ("violations", "i8"),
            ("late_s", "f8"),
            ("worst_late_s", "f8"),
            ("hardware_error", "i8", n),
            *((name, "f8", n) for name in ("position", "velocity", "effort", "voltage", "temperature")),
            ("gyro", "f8", 3),
            ("accel", "f8", 3),
            ("base_position", "f8", 3),
            ("base_quaternion", "f8", 4),
            ("joint_position", "f8", n),
            *((f"foot_{name}", "f8", (2, 3)) for name in ("position", "velocity", "force")),
            ("torque", "f8", n),
            ("saturated", "f8", n),
            ("com", "f8", 3),
            ("self_contact", "?"),
        ]
    )


class SimProcess(Driver):
    """A driver that talks to a simulated robot through shared memory.

    The robot's time passes whether or not anybody reads. A robot whose process has died answers no more: its joints
    go stale, as they do on a bus whose cable was pulled.

    Args:
        simulation: the robot to run, not yet open; it belongs to the process from `open` on.
        realtime: whether the process may ask for realtime scheduling.
    """

    name = "sim"

    def __init__(self, simulation: SimDriver, *, realtime: bool = True) -> None:
        super().__init__(simulation.robot, options=simulation.options)
        self.simulation = simulation
        self._realtime = realtime
        n = self.robot.n
        self._commands = Ring(_command_dtype(n), 64)
        self._states = Ring(_state_dtype(n), 16)
        self._row = np.zeros((), _command_dtype(n))
        self._seen = 0
        self._unchanged = 0
        self._patience = max(round(_PAUSE_S * self.robot.rate_hz), 1)
        self._newest: NDArray[Any] = np.zeros((), _state_dtype(n))
        self._process: BaseProcess | None = None

    @property
    def capabilities(self) -> Capabilities:
        """Those of the simulation, but for its clock."""
        inner = self.simulation.capabilities
        return Capabilities(
            imu=inner.imu, effort=inner.effort, torque_bound=inner.torque_bound, lockstep=False, truth=inner.truth
        )

    @property
    def delay_s(self) -> float:
        """As the simulation reports it; the process takes goals up to `QUANTUM_S` later."""
        return self.simulation.delay_s

    @property
    def violations(self) -> int:
        """Goals outside the servos' envelope, as of the newest state that was read."""
        return int(self._newest["violations"])

    @property
    def lateness_s(self) -> float:
        """How late the simulated robot ran since the last read but one, at worst [s]."""
        return float(self._newest["worst_late_s"])

    @property
    def pid(self) -> int | None:
        """Of the robot's process; None while it is not open."""
        return None if self._process is None else self._process.pid

    def open(self) -> None:
        """Start the process and wait for its first state. Raises `DriverError` where none comes."""
        ears, mouth = Pipe(duplex=False)
        self._process = child.start("robot", self._serve, mouth)
        mouth.close()
        error: Exception | None = DriverError("driver 'sim': the simulated robot's process did not start")
        with contextlib.suppress(EOFError):
            if ears.poll(_OPEN_PATIENCE_S):
                error = ears.recv()
        if error is not None:
            self.close()
            raise error

    def read(self, state: RobotState) -> None:
        """Fill `state` with the newest measurement; `stale` counts reads that found no new one."""
        newest = self._states.latest()
        count = self._states.count
        self._unchanged = self._unchanged + 1 if count == self._seen else 0
        self._seen = count
        if newest is not None:
            self._newest = newest
            for name in _STATE:
                getattr(state, name)[:] = newest[name]
            state.stamp_ns = int(newest["stamp_ns"])
            state.imu_stale = int(newest["imu_stale"])
        state.stale[:] = self._reads_behind()
        if state.imu_stale >= 0:
            state.imu_stale = int(state.stale[0])

    def _reads_behind(self) -> int:
        """Reads in a row that told nothing new: as many as a robot that pauses may miss, more once it paused too long.

        One is nothing yet: two reads may follow each other closely after a loop was late.
        """
        borne = self.robot.safety.max_stale_reads
        paused_too_long = max(self._unchanged - self._patience, 0)
        return borne + paused_too_long if paused_too_long else min(max(self._unchanged - 1, 0), borne)

    def write(self, command: JointCommand) -> None:
        """Send goals."""
        self._row["position"], self._row["torque_bound"] = command.position, command.torque_bound
        self._send(_GOALS)

    def set_torque(self, on: bool) -> None:
        """Switch all servos."""
        self._send(_TORQUE_ON if on else _TORQUE_OFF)

    def damp(self) -> None:
        """Let the joints give way softly."""
        self._send(_DAMP)

    def truth(self) -> Truth:
        """The real pose as of the newest state that was read."""
        values: dict[str, Any] = {name: self._newest[name] for name in _TRUTH}
        return Truth(**values | {"self_contact": bool(values["self_contact"])})

    def close(self) -> None:
        """Torque off, and the process ended."""
        if self._process is not None:
            self._send(_TORQUE_OFF)
            self._send(_END)
            child.end(self._process, patience_s=_CLOSE_PATIENCE_S)
            self._process = None

    def _send(self, kind: int) -> None:
        self._row["kind"] = kind
        self._commands.publish(self._row)

    # ---------------------------------------------------------------- in the robot's process

    def _serve(self, opened: Connection) -> None:
        """Be the robot: let time pass, obey, publish what the sensors see."""
        simulation, commands = self.simulation, self._commands.reader()
        try:
            simulation.open()
        except DriverError as error:
            opened.send(error)
            return
        sensed, row = RobotState(self.robot.n), np.zeros((), self._states.dtype)
        priority.settle(collect=False)
        priority.claim(priority.ROBOT_PRIORITY, allowed=self._realtime)
        self._publish(sensed, row, 0.0, 0.0)
        opened.send(None)
        ticker = Ticker(QUANTUM_S)
        steps_a_tick = max(round(1.0 / (self.robot.rate_hz * QUANTUM_S)), 1)
        worst, step, ended = [0.0, 0.0], 0, False
        while not ended:
            ticker.wait()
            ended = self._obey(commands)
            # Late is late: the time that has passed is simulated, none is left out.
            simulation.advance(QUANTUM_S * (1 + ticker.skipped))
            step += 1
            late = 1e-9 * ticker.late_ns + QUANTUM_S * ticker.skipped
            worst[0] = max(worst[0], late)
            if step % steps_a_tick == 0:
                worst = [0.0, worst[0]]
            self._publish(sensed, row, late, max(worst))
        simulation.close()

    def _obey(self, commands: Reader) -> bool:
        """Do what was asked since the last step, in order; whether it was to end."""
        simulation = self.simulation
        command = JointCommand(self.robot.n)
        for asked in commands.read():
            kind = int(asked["kind"])
            if kind == _GOALS:
                command.position[:], command.torque_bound[:] = asked["position"], asked["torque_bound"]
                simulation.write(command)
            elif kind in (_TORQUE_ON, _TORQUE_OFF):
                simulation.set_torque(kind == _TORQUE_ON)
            elif kind == _DAMP:
                simulation.damp()
            else:
                return True
        return False

    def _publish(self, sensed: RobotState, row: NDArray[Any], late_s: float, worst_late_s: float) -> None:
        simulation = self.simulation
        simulation.read(sensed)
        for name in _STATE:
            row[name] = getattr(sensed, name)
        row["stamp_ns"], row["imu_stale"] = time.perf_counter_ns(), sensed.imu_stale
        row["violations"], row["late_s"], row["worst_late_s"] = simulation.violations, late_s, worst_late_s
        truth = simulation.truth()
        for name in _TRUTH:
            row[name] = getattr(truth, name)
        self._states.publish(row)
