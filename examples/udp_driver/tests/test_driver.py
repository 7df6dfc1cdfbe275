# ruff: noqa: D101, D102 - the names of tests say what they check
"""The conformance suite against a robot in a thread.

The robot lives on the real clock. Tests wait for what it does, so that they pass on a slow machine too.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from flexmotion_udp import driver as udp
from flexmotion_udp.driver import UdpDriver, UdpOptions
from flexmotion_udp.wire import GOALS, TORQUE, pack_state, unpack

from flexmotion.configs.errors import DriverError
from flexmotion.configs.robot import load_robot
from flexmotion.drivers.conformance import DriverConformance
from flexmotion.drivers.interface import Driver, JointCommand, RobotState

PERIOD = 0.002
HANGS_S = 90.0
"""Bound against hanging [s]."""


class ThreadRobot(threading.Thread):
    """A robot whose joints halve the distance to their goals in each of its cycles.

    Attributes:
        cycles: cycles so far.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        robot = load_robot("op3")
        self.position, self.torque, self.running = robot.stand_pose.copy(), False, True
        self.cycles = 0
        self.goal = self.position.copy()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(PERIOD)
        self.port = self.socket.getsockname()[1]

    def run(self) -> None:
        client = None
        while self.running:
            end = time.monotonic() + PERIOD
            while time.monotonic() < end:
                try:
                    datagram, client = self.socket.recvfrom(65536)
                except TimeoutError:
                    break
                self.receive(*unpack(datagram))
            if self.torque:
                self.position += 0.5 * (self.goal - self.position)
            if client is not None:
                self.socket.sendto(pack_state(self.torque, self.position, np.zeros_like(self.position)), client)
            self.cycles += 1
        self.socket.close()

    def receive(self, kind: bytes, values: np.ndarray) -> None:
        if kind == TORQUE:
            if values[0] == 1.0 and not self.torque:
                self.goal[:] = self.position
            self.torque = values[0] == 1.0
        elif kind == GOALS and self.torque and np.isfinite(values).all():
            self.goal[:] = values


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver gives a slow machine time."""
    monkeypatch.setattr(udp, "PATIENCE_S", HANGS_S)


@pytest.fixture
def robot() -> Iterator[ThreadRobot]:
    robot = ThreadRobot()
    robot.start()
    yield robot
    robot.running = False
    robot.join()


class TestUdpDriver(DriverConformance):
    @pytest.fixture(autouse=True)
    def _robot(self, robot: ThreadRobot) -> None:
        self.robot = robot

    def make_driver(self) -> Driver:
        return UdpDriver(load_robot("op3"), options=UdpOptions(udp_port=self.robot.port))

    def wait(self, driver: Driver, seconds: float) -> None:
        """Wait for as many cycles of the robot as take this time on a fast machine."""
        end, hangs = self.robot.cycles + round(seconds / PERIOD), time.monotonic() + HANGS_S
        while self.robot.cycles < end:
            assert time.monotonic() < hangs, "the robot's thread stands still"
            time.sleep(PERIOD)


def test_a_silent_robot_goes_stale(robot: ThreadRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    state, command = RobotState(20), JointCommand(20)
    with UdpDriver(load_robot("op3"), options=UdpOptions(udp_port=robot.port)) as driver:
        robot.running = False
        robot.join()
        driver.read(state)
        for _ in range(6):
            driver.write(command)
            driver.read(state)
        assert state.stale.min() >= 5
        monkeypatch.setattr(udp, "PATIENCE_S", 0.1)  # closing waits for an answer that never comes


def test_a_missing_robot_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "PATIENCE_S", 0.1)
    driver = UdpDriver(load_robot("op3"), options=UdpOptions(udp_port=1))
    with pytest.raises(DriverError, match=r"robot at 127.0.0.1:1: does not answer"):
        driver.open()
