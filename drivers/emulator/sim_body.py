"""`SimBody`: the whole robot in MuJoCo behind emulated servos, moved by a real driver through bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.drivers.emulator.body import Body
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.plant import ServoPlant
from flexmotion.drivers.receiver import Receiver
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import SimOptions
from flexmotion.spatial.tilt import PAST_PLAN_RAD

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

PICKED_UP_S = 3.0
"""Time with all torque off after which the robot is put back into its start pose [s]."""


class SimBody(Body):
    """The robot of driver `sim` without its delays, which the bus adds.

    When torque goes off after it was on, the robot sinks, and may fall. `PICKED_UP_S` later it is back in its start
    pose, its torso held until torque goes on, so that the next run starts like the first.

    Attributes:
        driver: the simulated robot.
        fell: whether the torso tilted further than in any plan while all servos held; the lowest height is reported,
            but not a criterion.
    """

    def __init__(self, robot: Robot, options: SimOptions | None = None) -> None:
        options = SimOptions() if options is None else options
        # A goal waits for the next physics step, which stands for the catalogue's delay of a servo.
        assumed = float(np.mean([servo.delay for servo in robot.catalogue_servos]))
        delay = options.extra_latency_s + max(robot.servo_delay - assumed, 0.0)
        instant = options.model_copy(update={"command_delay_s": delay, "read_delay_s": 0.0})
        self.driver = SimDriver(robot, options=instant.model_copy(update={"extra_latency_s": 0.0}))
        self.driver.open()
        super().__init__(robot, instant.timestep)
        self._state = RobotState(robot.n)
        self._height = float(self.driver.truth().base_position[2])
        self._origin = self.driver.truth().base_position[:2].copy()
        self._fallen_tilt = max(robot.safety.fall_tilt, robot.safety.most_tilt + PAST_PLAN_RAD)
        self.fell, self._lowest, self._steepest = False, 1.0, 0.0
        self._walked, self._off_s = 0.0, np.inf

    @property
    def plant(self) -> ServoPlant:
        """See `Body`."""
        return self.driver.plant

    @property
    def receiver(self) -> Receiver:
        """See `Body`."""
        return self.driver.receiver

    @property
    def position(self) -> Float:
        """See `Body`."""
        return self.driver.position

    @property
    def velocity(self) -> Float:
        """See `Body`."""
        return self.driver.velocity

    def receive(self, goal: Float, which: Bool, bound: Float) -> None:
        """See `Body`."""
        self.driver.receive(goal, which, bound)

    def set_torque(self, which: Bool, on: bool) -> None:
        """See `Body`. Once every servo holds, the torso is released."""
        self.plant.enabled[which] = on
        if self.plant.enabled.all():
            self.driver.release()

    def block(self, joint: int, on: bool) -> None:
        """See `Body`."""
        self.driver.block(joint, on)

    def step(self, seconds: float) -> None:
        """See `Body`."""
        self.driver.advance(seconds)
        if not self.plant.enabled.all():
            self._lie(seconds)
            return
        self._off_s = 0.0
        height, up = self.driver.torso_height, self.driver.torso_up
        tilt = float(np.arccos(np.clip(up, -1.0, 1.0)))
        self._lowest, self._steepest = min(self._lowest, height / self._height), max(self._steepest, tilt)
        self.fell |= tilt > self._fallen_tilt

    def _lie(self, seconds: float) -> None:
        """Count the time without torque, then put the robot back; `_off_s` is infinite before torque and after that."""
        if self.plant.enabled.any() or np.isinf(self._off_s):
            return
        self._off_s += seconds
        if self._off_s > PICKED_UP_S:
            self._off_s = np.inf
            self._walked += self._way
            self.driver.place()

    @property
    def _way(self) -> float:
        """Straight distance from where it was put down [m]."""
        return float(np.hypot(*(self.driver.truth().base_position[:2] - self._origin)))

    def sense(self) -> None:
        """See `Body`."""
        self.driver.read(self._state)
        self.gyro[:], self.accel[:] = self._state.gyro, self._state.accel

    def report(self) -> dict[str, Any]:
        """See `Body`. With height and tilt while all servos held."""
        return {
            "violations": self.receiver.violations,
            "fell": bool(self.fell),
            "lowest_height_share": round(self._lowest, 4),
            "steepest_tilt_rad": round(self._steepest, 4),
            "travelled_m": round(self._walked + self._way, 4),
            "time_s": round(self.driver.time, 3),
        }
