"""`SimProcess`: a simulated robot on the real clock, in a process of its own."""

from __future__ import annotations

import contextlib
import time
from dataclasses import fields, replace
from multiprocessing.connection import Connection, Pipe
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import DriverError
from flexmotion.drivers.interface import Capabilities, JointCommand, RobotState
from flexmotion.drivers.realtime import child, priority
from flexmotion.drivers.realtime.ring import Reader, Ring
from flexmotion.drivers.realtime.ticker import Ticker
from flexmotion.drivers.simulated import LockstepDriver, SimulatedDriver, Truth
from flexmotion.records import Bool, Float, Int, Record, column

QUANTUM_S = 0.002
"""Step of simulated time, each taken when it is due on the real clock [s]: a quarter of a servo bus's usual cycle."""
_OPEN_PATIENCE_S, _CLOSE_PATIENCE_S = 30.0, 1.0
"""Bounds against hanging [s]: a process that dies while it opens is noticed at once."""
_PAUSE_S = 0.1
"""Longest pause of the process that does not count as silence [s]; it shares its processor with other processes."""
_GOALS, _TORQUE_ON, _TORQUE_OFF, _DAMP, _STIFF, _LIMP, _REBOOT, _END = range(8)
_TRUTH = tuple(field.name for field in fields(Truth))
_STATE = ("position", "velocity", "effort", "voltage", "temperature", "hardware_error", "gyro", "accel")


class _CommandRow(Record):
    """A command to the robot's process: goals, or what to do with the torque (of the joints in `which`, 0 or 1).

    `stamp_ns`: when it was sent [`time.perf_counter_ns`].
    """

    stamp_ns: Int = column("i8")
    kind: Int = column("i8")
    which: Int = column("i8", "joints")
    position: Float = column("f8", "joints")
    torque_bound: Float = column("f8", "joints")


class _StateRow(Record):
    """What the robot's process publishes: fields of `RobotState` and `Truth`, and its own lateness."""

    stamp_ns: Int = column("i8")
    imu_stale: Int = column("i8")
    violations: Int = column("i8")
    late_s: Float = column("f8")
    worst_late_s: Float = column("f8")
    hardware_error: Int = column("i8", "joints")
    position: Float = column("f8", "joints")
    velocity: Float = column("f8", "joints")
    effort: Float = column("f8", "joints")
    voltage: Float = column("f8", "joints")
    temperature: Float = column("f8", "joints")
    gyro: Float = column("f8", 3)
    accel: Float = column("f8", 3)
    base_position: Float = column("f8", 3)
    base_quaternion: Float = column("f8", 4)
    joint_position: Float = column("f8", "joints")
    foot_position: Float = column("f8", 2, 3)
    foot_velocity: Float = column("f8", 2, 3)
    foot_force: Float = column("f8", 2, 3)
    torque: Float = column("f8", "joints")
    saturated: Float = column("f8", "joints")
    com: Float = column("f8", 3)
    self_contact: Bool = column("?")


class SimProcess(SimulatedDriver):
    """Runs a lockstep driver in a process of its own and exchanges messages with it through shared memory.

    The robot's time passes whether or not `read` is called. If the process dies, all joints go stale, as on a bus whose
    cable was pulled.

    Args:
        simulation: the robot to run, not yet open; from `open` on only the process uses it.
        realtime: whether the process may ask for realtime scheduling.
    """

    name = "sim"

    def __init__(self, simulation: LockstepDriver, *, realtime: bool = True) -> None:
        super().__init__(simulation.robot, options=simulation.options)
        self.simulation = simulation
        self._realtime = realtime
        n = self.robot.n
        self._commands = Ring(_CommandRow.dtype(joints=n), 64)
        self._states = Ring(_StateRow.dtype(joints=n), 16)
        self._command = np.zeros((), self._commands.dtype)
        self._row = _CommandRow(self._command)
        self._seen = 0
        self._unchanged = 0
        self._patience = max(round(_PAUSE_S * self.robot.rate_hz), 1)
        self._newest = _StateRow(np.zeros((), self._states.dtype))
        self._restarted: list[tuple[int, str | None]] = []
        self._process: BaseProcess | None = None

    @property
    def capabilities(self) -> Capabilities:
        """Those of the simulation, without `lockstep`."""
        inner = self.simulation.capabilities
        return replace(inner, lockstep=False)

    @property
    def delay_s(self) -> float:
        """Delay of the simulation [s]; the process takes goals up to `QUANTUM_S` later."""
        return self.simulation.delay_s

    @property
    def turns(self) -> int:
        """Those of the simulation."""
        return self.simulation.turns

    @property
    def connected(self) -> bool:
        """False once the process has died."""
        return self._process is None or self._process.is_alive()

    @property
    def violations(self) -> int:
        """Goals outside the servos' envelope, up to the last `read`."""
        return int(self._newest.violations)

    @property
    def lateness_s(self) -> float:
        """Greatest lateness of the simulation in the tick of the newest state and the one before [s]."""
        return float(self._newest.worst_late_s)

    @property
    def pid(self) -> int | None:
        """Process id of the robot's process; None while it is not open."""
        return None if self._process is None else self._process.pid

    def open(self) -> None:
        """Start the process and wait for its first state. Raises `DriverError` if none comes."""
        result, result_writer = Pipe(duplex=False)
        self._process = child.start("robot", self._serve, result_writer, self._commands.reader(new_only=True))
        result_writer.close()
        error: Exception | None = DriverError("driver 'sim': the simulated robot's process did not start")
        with contextlib.suppress(EOFError):
            if result.poll(_OPEN_PATIENCE_S):
                error = result.recv()
        if error is not None:
            self.close()
            raise error

    def read(self, state: RobotState) -> None:
        """Fill `state` with the newest measurement; `stale` counts reads that found no new one, see `_reads_behind`."""
        newest = self._states.latest()
        count = self._states.count
        self._unchanged = self._unchanged + 1 if count == self._seen else 0
        self._seen = count
        if newest is not None:
            self._newest = _StateRow(newest)
            for name in _STATE:
                getattr(state, name)[:] = getattr(self._newest, name)
            state.stamp_ns = int(self._newest.stamp_ns)
            state.imu_stale = int(self._newest.imu_stale)
        state.stale[:] = self._reads_behind()
        if state.imu_stale >= 0:
            state.imu_stale = int(state.stale[0])

    def _reads_behind(self) -> int:
        """Consecutive reads without a new state, at most `max_stale_reads` until the pause is longer than `_PAUSE_S`.

        A single one counts as 0: after a late tick two reads may follow each other closely.
        """
        tolerated = self.robot.safety.max_stale_reads
        excess = max(self._unchanged - self._patience, 0)
        return tolerated + excess if excess else min(max(self._unchanged - 1, 0), tolerated)

    def write(self, command: JointCommand) -> None:
        """Send goals."""
        self._row.position[...], self._row.torque_bound[...] = command.position, command.torque_bound
        self._send(_GOALS)

    def set_torque(self, on: bool) -> None:
        """Switch all servos."""
        self._send(_TORQUE_ON if on else _TORQUE_OFF)

    def switch(self, which: NDArray[np.bool_], on: bool) -> None:
        """See `Driver`."""
        self._row.which[...] = which
        self._send(_STIFF if on else _LIMP)

    def reboot(self, which: NDArray[np.bool_]) -> None:
        """See `Driver`."""
        self._row.which[...] = which
        self._send(_REBOOT)
        self._restarted += [(int(joint), None) for joint in np.flatnonzero(which)]

    def take_restarted(self) -> list[tuple[int, str | None]]:
        """See `Driver`. The robot's process does not say; errors that remain are in the next readings."""
        restarted, self._restarted = self._restarted, []
        return restarted

    def damp(self) -> None:
        """Let the joints give way."""
        self._send(_DAMP)

    def truth(self) -> Truth:
        """The true state at the last `read`."""
        values: dict[str, Any] = {name: getattr(self._newest, name) for name in _TRUTH}
        return Truth(**values | {"self_contact": bool(values["self_contact"])})

    def close(self) -> None:
        """Switch torque off and end the process."""
        if self._process is not None:
            self._send(_TORQUE_OFF)
            self._send(_END)
            child.end(self._process, patience_s=_CLOSE_PATIENCE_S)
            self._process = None

    def _send(self, kind: int) -> None:
        self._row.kind[...], self._row.stamp_ns[...] = kind, time.perf_counter_ns()
        self._commands.publish(self._command)

    # ---------------------------------------------------------------- in the robot's process

    def _serve(self, opened: Connection, commands: Reader) -> None:
        """Main function of the process: step time, carry out commands, publish states."""
        simulation = self.simulation
        try:
            simulation.open()
        except DriverError as error:
            opened.send(error)
            return
        sensed, row = RobotState(self.robot.n), np.zeros((), self._states.dtype)
        # Views, looked up once: a field of a record costs as much as the physics of a step.
        cells = dict(_StateRow(row))
        priority.settle(collect=False)
        priority.claim(priority.ROBOT_PRIORITY, allowed=self._realtime)
        ticker = Ticker(QUANTUM_S)
        self._publish(sensed, row, cells, ticker.deadline_ns, 0.0, 0.0)
        opened.send(None)
        steps_a_tick = max(round(1.0 / (self.robot.rate_hz * QUANTUM_S)), 1)
        worst, step, ended = [0.0, 0.0], 0, False
        while not ended:
            ticker.wait()
            # Skipped steps are simulated too: simulated time keeps up with the real clock.
            ended = self._simulate(commands.read(), 1 + ticker.skipped, ticker.deadline_ns)
            step += 1
            late = 1e-9 * ticker.late_ns + QUANTUM_S * ticker.skipped
            worst[0] = max(worst[0], late)
            if step % steps_a_tick == 0:
                worst = [0.0, worst[0]]
            self._publish(sensed, row, cells, ticker.deadline_ns, late, max(worst))
        simulation.close()

    def _simulate(self, sent: NDArray[np.void], steps: int, due_ns: int) -> bool:
        """Simulate steps, and carry out each command before the step in which it came; True if the process must end.

        A servo is never late: goals that came while this process was late meet the joints where they were then, not
        where they are by the time that it goes on.

        Args:
            sent: commands since the last call, in order.
            steps: number of steps of `QUANTUM_S`.
            due_ns: when the last of them is due [ns, `time.perf_counter_ns`]; all commands are carried out before it.
        """
        rows, done, ended = [_CommandRow(row) for row in sent], 0, False
        for left in reversed(range(steps)):
            begin_ns = due_ns - round(left * QUANTUM_S * 1e9)
            while done < len(rows) and (left == 0 or rows[done].stamp_ns <= begin_ns):
                ended |= self._execute(rows[done])
                done += 1
            self.simulation.advance(QUANTUM_S)
        return ended

    def _execute(self, row: _CommandRow) -> bool:
        """Carry out a command; True if the process must end."""
        simulation, kind = self.simulation, int(row.kind)
        if kind == _GOALS:
            command = JointCommand(self.robot.n)
            command.position[:], command.torque_bound[:] = row.position, row.torque_bound
            simulation.write(command)
        elif kind in (_TORQUE_ON, _TORQUE_OFF):
            simulation.set_torque(kind == _TORQUE_ON)
        elif kind == _DAMP:
            simulation.damp()
        elif kind in (_STIFF, _LIMP):
            simulation.switch(row.which == 1, kind == _STIFF)
        elif kind == _REBOOT:
            simulation.reboot(row.which == 1)
        return kind == _END

    def _publish(
        self,
        sensed: RobotState,
        row: NDArray[np.void],
        cells: dict[str, NDArray[Any]],
        now_ns: int,
        late_s: float,
        worst_late_s: float,
    ) -> None:
        """Send the state, stamped with the moment that it is of.

        Joints that a late process has caught up with have moved for as long as was simulated, not for as long as that
        took.

        Args:
            sensed: is overwritten.
            row, cells: a `_StateRow` and views of its fields, overwritten.
            now_ns: the moment [ns]; late_s, worst_late_s: see `lateness_s`.
        """
        simulation = self.simulation
        simulation.read(sensed)
        for name in _STATE:
            cells[name][...] = getattr(sensed, name)
        cells["stamp_ns"][...], cells["imu_stale"][...] = now_ns, sensed.imu_stale
        cells["violations"][...] = simulation.violations
        cells["late_s"][...], cells["worst_late_s"][...] = late_s, worst_late_s
        truth = simulation.truth()
        for name in _TRUTH:
            cells[name][...] = getattr(truth, name)
        self._states.publish(row)
