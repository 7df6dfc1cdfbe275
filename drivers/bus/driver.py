"""`BusDriver`: a robot on one or several servo buses."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict
from flexmotion.drivers.bus.joint_switch import JointSwitch
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.bus.servo_bus import ServoBus
from flexmotion.drivers.imu import registry as imus
from flexmotion.drivers.imu.interface import Imu, StandaloneImu, do_without
from flexmotion.drivers.interface import Capabilities, Driver, JointCommand, RobotState
from flexmotion.drivers.port import SerialPort

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

READ_SHARE = 0.6
"""Largest share of a tick for reading; the rest is for the loop and for writing."""

CONFIRM_S = 0.2
"""Time in which servos are asked whether torque went off, of all buses together [s]. The loop does not tick meanwhile,
and whoever cuts the torque waits for it; it is enough for two rounds on a bus whose servos are asked one by one."""

IMU_PATIENCE_S = 0.15
"""Longest time that `open` waits for a sample of the IMU [s]; longer than a sensor needs to reach its rate."""

log = logging.getLogger(__name__)


class BusDriver(Driver):
    """Common base of the vendors' drivers: units, staleness, time budget, several buses on one clock.

    Subclasses set `Bus`, which implements the protocol of their servos.

    Attributes:
        buses: of the robot file, in its order; empty unless open.
        open_port: makes a port from path and baud rate.
    """

    Options = BusOptions
    Bus: ClassVar[type[ServoBus]]

    def __init__(self, robot: Robot, *, options: Strict | None = None) -> None:
        super().__init__(robot, options=options)
        if not isinstance(self.options, BusOptions):
            raise TypeError(f"{type(self).__name__} takes BusOptions, not {type(self.options).__name__}")
        self._settings: BusOptions = self.options
        self._paths = {name: self._settings.port_of(name, robot) for name in robot.config.buses}
        _refuse_couplings(robot)
        for name in self._paths:
            self.Bus.check(robot, name)
        n = robot.n
        self.open_port: Callable[[str, int], SerialPort] = SerialPort
        self.buses: list[ServoBus] = []
        self._imu_on_bus = any(self.Bus.carries_imu(robot, name) for name in self._paths)
        self._standalone_imu = self._own_imu()
        self._imu: Imu | None = None
        self._imu_raised = False
        self._period = 1.0 / robot.rate_hz
        self._measured, self._raw = np.full((5, n), np.nan), np.zeros(n)
        self._directions = np.ones((5, n))
        self._directions[1:3] = robot.direction
        self._stale, self._imu_stale = np.zeros(n, np.int64), 0
        self._switch = JointSwitch(n)
        self._stamp_ns = self._violations = 0

    @property
    def delay_s(self) -> float:
        """Time from the start of a tick until its goals act [s]: read, write, and the servos' own delay."""
        robot = self.robot
        return max(self.Bus.budget(robot, name).cycle_s for name in robot.config.buses) + robot.servo_delay

    @property
    def turns(self) -> int:
        """See `Driver`."""
        return max(self.Bus.turns(self.robot, name) for name in self.robot.config.buses)

    @property
    def temperature_limit(self) -> Float:
        """See `Driver`. Read from the servos, if they have such a register."""
        limit = super().temperature_limit
        for bus in self.buses:
            limit[bus.where] = bus.temperature_limit
        return limit

    @property
    def voltage_limit(self) -> Float:
        """See `Driver`."""
        limit = super().voltage_limit
        for bus in self.buses:
            limit[bus.where] = bus.voltage_limit
        return limit

    @property
    def connected(self) -> bool:
        """False once every port is lost."""
        return not self.buses or any(bus.port.lost is None for bus in self.buses)

    @property
    def holding(self) -> list[str]:
        """See `Driver`."""
        return [servo for bus in self.buses for servo in bus.holding]

    @property
    def violations(self) -> int:
        """Goals outside their envelope, replaced before they were sent; see `flexmotion.drivers.bus.goal_guard`."""
        return self._violations + sum(bus.guard.violations for bus in self.buses)

    def look(self) -> None:
        """See `Driver`. Raises as `open`."""
        try:
            self._connect()
            for bus in self.buses:
                bus.look()
        finally:
            self.let_go()

    def open(self) -> None:
        """Open every port, check and set up every servo; torque stays as it is. Raises `DriverError`."""
        self._switch = JointSwitch(self.robot.n)
        try:
            self._connect()
            self._imu = self._open_imu()
            for bus in self.buses:
                bus.audit()
                self._imu = self._imu or bus.imu
            self._await_imu()
        except BaseException:
            self.let_go()
            raise

    def close(self) -> None:
        """Switch torque off and release the ports. May be called twice."""
        if self.buses:
            self.set_torque(False)
            self.let_go()

    def let_go(self) -> None:
        """Release all ports and leave torque as it is: for tools that only read."""
        self._violations = self.violations
        for bus in self.buses:
            bus.close()
        self.buses = []
        if self._standalone_imu is not None:
            self._standalone_imu.close()

    def read(self, state: RobotState) -> None:
        """Read all buses in parallel, at most `READ_SHARE` of a tick."""
        begin = self.buses[0].port.now()
        self._cycle(begin, begin + READ_SHARE * self._period)
        for bus in self.buses:
            self._take(bus, state)
        # Velocity and effort in the direction of the joints, then positions in their units.
        np.multiply(self._measured, self._directions, out=state.values)
        self.robot.from_ticks(self._measured[0], out=state.position)
        state.stale[:] = self._stale
        self._switch.look(self.buses, self._stale, begin, state)
        self._switch.go_on()
        self._read_imu(state)
        state.stamp_ns = self._stamp_ns

    def write(self, command: JointCommand) -> None:
        """Send the goals to all buses. If one is not a number, none is sent and the goals before stay in effect."""
        robot, position = self.robot, command.position
        if not math.isfinite(position.dot(position)):  # else all are
            bad = ~np.isfinite(position)
            if bad.any():
                log.error("joint %s: goal is not a number", robot.joint_names[int(np.flatnonzero(bad)[0])])
                return
        robot.to_ticks(position, out=self._raw)
        for bus in self.buses:
            bus.send_goals(self._raw[bus.where], command.torque_bound[bus.where])
        self._switch.repeat(self.buses)

    def set_torque(self, on: bool) -> None:
        """Switch all servos. On: goals are pinned to present positions and verified first; raises if that fails."""
        if not on:
            self._switch.set_all(False, 0.0)
            for bus in self.buses:
                bus.send_off()
            # Only now: servos that are silent on one bus must not delay the others.
            end = self.buses[0].port.now() + CONFIRM_S
            for place, bus in enumerate(self.buses):
                now = bus.port.now()
                bus.confirm_off(now + (end - now) / (len(self.buses) - place))
            return
        try:
            for bus in self.buses:
                bus.switch_on()
        except BaseException:
            self.set_torque(False)
            raise
        self._switch.set_all(True, self.buses[0].port.now())

    def switch(self, which: Bool, on: bool) -> None:
        """See `Driver`."""
        self._switch.switch(self.buses, which, on, self.buses[0].port.now())

    def reboot(self, which: Bool) -> None:
        """See `Driver`."""
        self._switch.restart(self.buses, which)

    def take_restarted(self) -> list[tuple[int, str | None]]:
        """See `Driver`."""
        return self._switch.take_restarted()

    def take_pins(self, goal: Float) -> None:
        """See `Driver`."""
        pinned = np.zeros(self.robot.n, np.bool_)
        for bus in self.buses:
            pinned[bus.where] = np.isfinite(bus.pins)
            self._raw[bus.where] = bus.pins
            bus.pins.fill(np.nan)
        if pinned.any():
            np.copyto(goal, self.robot.from_ticks(self._raw), where=pinned)

    def damp(self) -> None:
        """Pin the goals and lower stiffness and torque as far as the servos can."""
        for bus in self.buses:
            bus.damp()

    # ---------------------------------------------------------------- inside

    def _connect(self) -> None:
        """Open every port. Raises `DriverError`."""
        for name, path in self._paths.items():
            port = self.open_port(path, self.robot.config.buses[name].baud)
            port.refuse_echo()
            self.buses.append(self.Bus(self.robot, name, port, self._settings))

    def _cycle(self, begin: float, deadline: float) -> None:
        clock = self.buses[0].port
        for bus in self.buses:
            bus.request(begin)
        self._stamp_ns = round(begin * 1e9)
        waiting, now = [bus for bus in self.buses if bus.port.lost is None], clock.now()
        while waiting and now < deadline:
            until = min(deadline, *(bus.patience for bus in waiting))
            # An adapter that passes an answer on in pieces wakes the loop for the first and the last of them.
            due = min(bus.due for bus in waiting)
            if due > now:
                clock.sleep(min(due, until) - now)
                now = clock.now()
            clock.wait_any([bus.port for bus in waiting], until - now)
            now = clock.now()
            waiting = [bus for bus in waiting if not bus.receive(now)]
        for bus in self.buses:
            bus.finish()

    def _take(self, bus: ServoBus, state: RobotState) -> None:
        """Copy the measurements of a bus; those in servo units to `_measured`."""
        measured, where = bus.measured, bus.where
        if measured.complete:
            self._stale[where] = 0
        else:
            self._stale[bus.joints[measured.fresh]] = 0
            self._stale[bus.joints[measured.asked & ~measured.fresh]] += 1
        self._measured[:, where] = measured.values
        state.hardware_error[where] = measured.error

    def _own_imu(self) -> StandaloneImu | None:
        """The robot's IMU if it is not on a servo bus. Raises `ConfigError` if its driver is unknown."""
        imu = self.robot.config.imu
        if imu is None or imu.driver is None or self._imu_on_bus or not self._settings.imu:
            return None
        return imus.create(self.robot, self._settings.imu_port)

    def _open_imu(self) -> StandaloneImu | None:
        imu, self._imu_raised = self._standalone_imu, False
        if imu is None:
            return None
        try:
            imu.open(self.open_port, self.robot.rate_hz)
        except DriverError as error:
            do_without(imu.config, error)
            return None
        except Exception as error:  # of a plug-in: the robot can run without it
            log.debug("IMU %s", imu.name, exc_info=True)
            do_without(imu.config, DriverError(f"IMU {imu.name}: {type(error).__name__}: {error}"))
            return None
        return imu

    def _await_imu(self) -> None:
        """Wait for a sample from after the audit, so that the first tick finds a fresh one."""
        clock = self.buses[0].port
        end = clock.now() + IMU_PATIENCE_S
        while self._imu is not None and not self._fresh(self._imu, now := clock.now()) and now < end:
            clock.sleep(IMU_PATIENCE_S / 10)

    def _fresh(self, imu: Imu, now: float) -> bool:
        """Whether the IMU has a fresh sample. An exception counts as none: a plug-in must not end a walking loop."""
        try:
            return imu.read(now)
        except Exception as error:
            if not self._imu_raised:
                self._imu_raised = True
                log.error("IMU %s: %s: %s", imu.name, type(error).__name__, error)
                log.debug("IMU %s", imu.name, exc_info=True)
            return False

    def _read_imu(self, state: RobotState) -> None:
        imu = self._imu
        if imu is None:
            state.imu_stale = -1
            return
        self._imu_stale = 0 if self._fresh(imu, self.buses[0].port.now()) else self._imu_stale + 1
        state.gyro[:], state.accel[:] = imu.gyro, imu.accel
        state.imu_stale = self._imu_stale

    @property
    def capabilities(self) -> Capabilities:
        """An IMU if the robot file names its driver, effort if a servo measures current."""
        return Capabilities(
            imu=self._imu_on_bus or self._standalone_imu is not None,
            effort=any(servo.current_unit is not None for servo in self.robot.servos),
            torque_bound=self.Bus.bounds_torque(self.robot),
            joint_torque=True,
            reboot=self.Bus.restarts,
        )


def _refuse_couplings(robot: Robot) -> None:
    """Raise `ConfigError` if the MJCF couples joints: every joint must be driven directly by its own servo."""
    model = robot.model
    coupled = [model.equality(i).name for i in range(model.neq)] + [model.tendon(i).name for i in range(model.ntendon)]
    if coupled:
        raise ConfigError(
            f"{robot.file}: {robot.config.mjcf} couples joints ({coupled[0] or 'a constraint'}): differentials and "
            "linkages need a driver plug-in that converts joint angles to actuator angles (docs/drivers.md)"
        )
