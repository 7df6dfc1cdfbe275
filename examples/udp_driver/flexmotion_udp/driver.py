"""`UdpDriver`: a robot that sends its state over UDP, unasked, and takes goals the same way."""

from __future__ import annotations

import socket
import time

import numpy as np
from pydantic import Field

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import Robot
from flexmotion.configs.schema import Strict
from flexmotion.drivers.interface import Capabilities, Driver, JointCommand, RobotState
from flexmotion_udp.wire import GOALS, STATE, TORQUE, pack, unpack

PATIENCE_S = 1.0
"""How long `open` and `set_torque` wait for the robot [s]; `read` never waits."""


class UdpOptions(Strict):
    """Options of driver `udp`: where the robot's controller listens."""

    host: str = "127.0.0.1"
    udp_port: int = Field(ge=1, le=65535)


class UdpDriver(Driver):
    """A robot behind a controller of its own, reached over UDP."""

    name = "udp"
    Options = UdpOptions

    def __init__(self, robot: Robot, *, options: Strict | None = None) -> None:
        super().__init__(robot, options=options)
        assert isinstance(self.options, UdpOptions)
        self._address = (self.options.host, self.options.udp_port)
        self._socket: socket.socket | None = None
        self._position, self._velocity = np.zeros(robot.n), np.zeros(robot.n)
        self._torque = False
        self._stale, self._stamp_ns = 0, 0

    @property
    def capabilities(self) -> Capabilities:
        """Positions and speeds, nothing else: say what is not there, and the loop does without."""
        return Capabilities()

    @property
    def delay_s(self) -> float:
        """A network's way there, and the controller's own cycle (assumption)."""
        return 0.002

    def open(self) -> None:
        """Find the robot. Whatever is wrong must come out here, in one line that says where."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if not self._wait_for(torque=None):
            self.close()
            raise DriverError(f"robot at {self._address[0]}:{self._address[1]}: does not answer")

    def read(self, state: RobotState) -> None:
        """The newest state. Never waits, never raises: what did not come makes every joint a read older."""
        self._stale = 0 if self._receive() else self._stale + 1
        state.position[:], state.velocity[:] = self._position, self._velocity
        state.stale[:] = self._stale
        state.stamp_ns = self._stamp_ns

    def write(self, command: JointCommand) -> None:
        """Send the goals; the robot ignores them while torque is off."""
        self._send(pack(GOALS, command.position))

    def set_torque(self, on: bool) -> None:
        """Switch, and wait until the robot says that it has. Its controller pins the goals when torque goes on."""
        if not self._wait_for(torque=on) and on:
            raise DriverError(f"robot at {self._address[0]}:{self._address[1]}: torque does not go on")

    def damp(self) -> None:
        """Torque off: all that this robot can do."""
        self._send(pack(TORQUE, np.zeros(1)))

    def close(self) -> None:
        """Torque off and let go; a second call finds nothing to do."""
        if self._socket is not None:
            self.set_torque(False)
            self._socket.close()
            self._socket = None

    def _wait_for(self, torque: bool | None) -> bool:
        """Ask again until the robot answers, with torque as wanted; False where it does not in time."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            # A datagram may get lost, and the first one tells the robot whom to answer.
            self._send(pack(TORQUE, np.array([float(self._torque if torque is None else torque)])))
            time.sleep(0.01)
            if self._receive() and torque in (None, self._torque):
                return True
        return False

    def _send(self, datagram: bytes) -> None:
        if self._socket is not None:
            try:
                self._socket.sendto(datagram, self._address)
            except OSError:
                self._stale += 1  # a network that is down is a robot that does not answer

    def _receive(self) -> bool:
        """Take in all that came; whether anything did."""
        fresh = False
        while self._socket is not None:
            try:
                kind, values = unpack(self._socket.recv(65536))
            except OSError:
                break
            if kind == STATE and len(values) == 1 + 2 * self.robot.n:
                self._torque = values[0] == 1.0
                self._position, self._velocity = np.split(values[1:], 2)
                self._stamp_ns, fresh = time.perf_counter_ns(), True
        return fresh
