"""What the feet of a simulated robot do on the floor: load, slip and height, by its true state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.world import FLOOR

Float = NDArray[np.float64]

LOADED_N = 3.0
"""A foot that presses with more stands on the floor [N]: a tenth of the robot's weight."""


class Ground:
    """Feet of the newest tick; left before right.

    Attributes:
        load: force of each foot against the floor [N]; slip: its speed along the floor [m/s]; height: of the lowest
            corner of its sole over the floor [m]; (2,) each.
        velocity: of the centre of mass since the last update, (2,) [m/s].
        torque, saturated: of the servos, means over the tick, (n,).
    """

    def __init__(self, driver: SimDriver) -> None:
        self._driver, robot = driver, driver.robot
        self._feet, self._half = np.array(robot.foot_ids), robot.sole_half_size
        self._up = np.zeros(3)
        self.load, self.slip, self.height = np.zeros(2), np.zeros(2), np.zeros(2)
        self.torque, self.saturated = np.zeros(robot.n), np.zeros(robot.n)
        self.position = np.zeros(3)

    def update(self) -> None:
        """Look at the driver's present state."""
        driver = self._driver
        truth = driver.truth()
        self._up[:] = driver.data.geom_xmat[driver.model.geom(FLOOR).id].reshape(3, 3)[:, 2]
        up = self._up
        self.load[:] = truth.foot_force @ up
        along = truth.foot_velocity - np.outer(truth.foot_velocity @ up, up)
        np.sqrt((along * along).sum(axis=1), out=self.slip)
        rotation = driver.data.xmat[self._feet].reshape(2, 3, 3)
        lean = np.abs(np.einsum("fij,i->fj", rotation[:, :, :2], up))
        self.height[:] = truth.foot_position @ up - (lean * self._half).sum(axis=1)
        self.torque[:], self.saturated[:] = truth.torque, truth.saturated
        self.position[:] = truth.base_position
