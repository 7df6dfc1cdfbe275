"""`Bench`: a robot's servos for tools, which look at them and write only what they are told to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Protocol
from flexmotion.drivers.bus.inspection import Inspection, refuse_locked
from flexmotion.drivers.bus.options import BusOptions
from flexmotion.drivers.bus.tools import BusTools
from flexmotion.drivers.dynamixel.opencr import OpenCr
from flexmotion.drivers.dynamixel.tools import DynamixelTools
from flexmotion.drivers.feetech.tools import FeetechTools
from flexmotion.drivers.imu import registry as imus
from flexmotion.drivers.imu.interface import Imu, StandaloneImu
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.lx16a.tools import Lx16aTools
from flexmotion.drivers.port import SerialPort

TOOLS: dict[Protocol, type[BusTools]] = {kind.protocol: kind for kind in (DynamixelTools, FeetechTools, Lx16aTools)}
"""The tools of each protocol."""


class Bench:
    """The servos of a robot, each asked by itself, outside any control cycle. Nothing is written unasked.

    Args:
        robot: with its calibration.
        options: ports.
        imu: whether its IMU is read too.
        power: whether a board that has switched the power of the servos off is told to switch it on.
        open_port: makes a port from path and baud rate.

    Attributes:
        tools: for each bus, by its name in the robot file.
    """

    def __init__(
        self,
        robot: Robot,
        options: BusOptions,
        *,
        imu: bool = False,
        power: bool = False,
        open_port: Callable[[str, int], SerialPort] | None = None,
    ) -> None:
        """Raises `ConfigError` if a port is missing from the options, `DriverError` if one cannot be used."""
        self.robot = robot
        self.tools: dict[str, BusTools] = {}
        self._open_port = SerialPort if open_port is None else open_port
        self._board: tuple[BusTools, Imu] | None = None
        self._standalone: StandaloneImu | None = None
        try:
            for name, bus in robot.config.buses.items():
                protocol = next(s.protocol for j, s in zip(robot.joints, robot.servos, strict=True) if j.bus == name)
                port = self._open_port(options.port_of(name, robot), bus.baud)
                port.refuse_echo()
                self.tools[name] = TOOLS[protocol](port)
            for name, tools in self.tools.items():
                if power:
                    tools.switch_power(robot, name)
            self._find_imu(options, wanted=imu)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the ports; torque stays as it is. May be called twice."""
        for tools in self.tools.values():
            tools.port.close()
        if self._standalone is not None:
            self._standalone.close()

    def inspect(self, joints: Sequence[str] | None = None) -> list[Inspection]:
        """The settings of every servo, or of those of `joints`, in robot order.

        Raises `DriverError` if one is missing or another model.
        """
        robot = self.robot
        wanted = [i for i, name in enumerate(robot.joint_names) if joints is None or name in joints]
        return [self._of(joint).inspect(robot, joint) for joint in wanted]

    def inspect_what_answers(self) -> tuple[list[Inspection], list[DriverError]]:
        """The settings of those servos that tell them, in robot order, and why the others do not."""
        found: list[Inspection] = []
        missing: list[DriverError] = []
        for joint in range(self.robot.n):
            try:
                found.append(self._of(joint).inspect(self.robot, joint))
            except DriverError as error:
                missing.append(error)
        return found, missing

    def acknowledge(self) -> None:
        """Make every servo answer every instruction: before settings are written."""
        for name, tools in self.tools.items():
            tools.acknowledge(self.robot, [i for i, joint in enumerate(self.robot.joints) if joint.bus == name])

    def write(self, inspections: list[Inspection], settings: Mapping[str, Mapping[str, int]]) -> None:
        """Write settings that servos keep without power.

        Args:
            inspections: of these servos, or of more.
            settings: joint -> name -> value of those that change.

        Raises:
            DriverError: torque is on in one of these servos (nothing is written then), or one refuses a setting.
        """
        changing = [each for each in inspections if settings.get(each.joint)]
        refuse_locked(changing)
        for each in changing:
            joint = self.robot.index(each.joint)
            self._of(joint).write_settings(self.robot, joint, settings[each.joint])

    def torque_off(self, joint: int) -> None:
        """Switch the torque of a joint's servo off. Raises `DriverError`."""
        self._of(joint).torque_off(self.robot, joint)

    def read(self, state: RobotState) -> None:
        """Read every servo, one after the other, and the IMU; `stale` counts the reads that a servo has missed."""
        robot, ticks = self.robot, np.zeros(self.robot.n)
        for joint in range(robot.n):
            reading = self._of(joint).look(robot, joint)
            if reading is None:
                state.stale[joint] += 1
                ticks[joint] = robot.to_ticks(state.position)[joint]
                continue
            state.stale[joint] = 0
            ticks[joint] = reading.ticks
            direction = robot.direction[joint]
            state.velocity[joint], state.effort[joint] = direction * reading.velocity, direction * reading.effort
            state.voltage[joint], state.temperature[joint] = reading.voltage, reading.temperature
            state.hardware_error[joint] = reading.error
        robot.from_ticks(ticks, out=state.position)
        self.read_imu(state)

    def read_imu(self, state: RobotState) -> None:
        """Read the IMU alone."""
        imu: Imu | None
        if self._board is not None:
            tools, imu = self._board
            fresh = tools.read_board(imu)
        elif self._standalone is not None:
            imu = self._standalone
            fresh = imu.read(next(iter(self.tools.values())).port.now())
        else:
            state.imu_stale = -1
            return
        state.imu_stale = 0 if fresh else max(state.imu_stale, 0) + 1
        state.gyro[:], state.accel[:] = imu.gyro, imu.accel

    def angle(self, joint: int) -> float | None:
        """Angle of one joint [rad]; None: its servo does not answer."""
        reading = self._of(joint).look(self.robot, joint)
        if reading is None:
            return None
        ticks = self.robot.to_ticks(np.zeros(self.robot.n))
        ticks[joint] = reading.ticks
        return float(self.robot.from_ticks(ticks)[joint])

    def torque_on(self) -> list[int]:
        """Joints whose servos have torque on. A servo that does not answer counts as off."""
        readings = [self._of(joint).look(self.robot, joint) for joint in range(self.robot.n)]
        return [joint for joint, reading in enumerate(readings) if reading is not None and reading.torque_on]

    # ---------------------------------------------------------------- inside

    def _of(self, joint: int) -> BusTools:
        return self.tools[self.robot.joints[joint].bus]

    def _find_imu(self, options: BusOptions, *, wanted: bool) -> None:
        for name, tools in self.tools.items():
            board = tools.find_board(self.robot, name)
            if board is not None:
                self._board = (tools, board)
        config = self.robot.config.imu
        if wanted and config is not None and config.driver not in (None, OpenCr.name):
            self._standalone = imus.create(self.robot, options.imu_port)
            self._standalone.open(self._open_port, self.robot.rate_hz)
