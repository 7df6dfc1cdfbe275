"""`UdpDriver`: a robot that sends its state over UDP, unasked, and receives goals over UDP."""

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
"""Longest wait of `open` and `set_torque` for the robot [s]; `read` never waits."""


class UdpOptions(Strict):
    """Options of driver `udp`: the address of the robot's controller."""

    host: str = "127.0.0.1"
    udp_port: int = Field(ge=1, le=65535)


class UdpDriver(Driver):
    """A robot with a controller that is reached over UDP."""

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
        """Positions and speeds only; the loop does not use what a driver does not offer."""
        return Capabilities()

    @property
    def delay_s(self) -> float:
        """Delay of the network and cycle of the controller [s] (assumption)."""
        return 0.002

    def open(self) -> None:
        """Find the robot. Raises `DriverError` with its address if it does not answer."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if not self._wait_for(torque=None):
            self.close()
            raise DriverError(f"robot at {self._address[0]}:{self._address[1]}: does not answer")

    def read(self, state: RobotState) -> None:
        """The newest state. Does not wait or raise: without a new state, `stale` of every joint is incremented."""
        self._stale = 0 if self._receive() else self._stale + 1
        state.position[:], state.velocity[:] = self._position, self._velocity
        state.stale[:] = self._stale
        state.stamp_ns = self._stamp_ns

    def write(self, command: JointCommand) -> None:
        """Send the goals. The robot ignores them while torque is off."""
        self._send(pack(GOALS, command.position))

    def set_torque(self, on: bool) -> None:
        """Switch torque and wait for the robot to confirm it. Its controller pins the goals when torque goes on."""
        if not self._wait_for(torque=on) and on:
            raise DriverError(f"robot at {self._address[0]}:{self._address[1]}: torque does not go on")

    def damp(self) -> None:
        """Switch torque off: this robot has no softer way."""
        self._send(pack(TORQUE, np.zeros(1)))

    def close(self) -> None:
        """Switch torque off and close the socket. May be called twice."""
        if self._socket is not None:
            self.set_torque(False)
            self._socket.close()
            self._socket = None

    def _wait_for(self, torque: bool | None) -> bool:
        """Repeat the request until the robot answers with this torque state (None: any); False after `PATIENCE_S`."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            # A datagram may be lost, and the first one gives the robot our address.
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
                self._stale += 1  # a network that is down is treated as a robot that does not answer

    def _receive(self) -> bool:
        """Take all received datagrams; whether there was a state."""
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
