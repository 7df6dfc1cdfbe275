"""Drivers of simulated robots: what they offer beyond the hardware interface of `flexmotion.drivers.interface`.

`SimulatedDriver` knows the robot's true state. `LockstepDriver` also steps the robot's time. A caller asks for either
with `simulated(driver)` and `lockstep(driver)`.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.interface import Driver, Float


@dataclass(frozen=True)
class Truth:
    """The true state of a simulated robot, for reports and pictures, never for control.

    Attributes:
        base_position, base_quaternion: torso in the world, (3,) [m] and (4,) w x y z.
        joint_position: (n,) [rad], without sensor quantisation.
        foot_position: centre of each sole in the world, left then right, (2, 3) [m].
        foot_velocity: velocity of that point, (2, 3) [m/s].
        foot_force: ground force on each foot, world frame, (2, 3) [N].
        torque: servo torque, averaged over the tick, (n,) [N·m].
        saturated: share of the tick in which each servo was at its torque limit, (n,) in [0, 1].
        com: centre of mass of the whole robot, (3,) [m].
        self_contact: whether two links of the robot touch (feet on the floor do not count).
    """

    base_position: Float
    base_quaternion: Float
    joint_position: Float
    foot_position: Float
    foot_velocity: Float
    foot_force: Float
    torque: Float
    saturated: Float
    com: Float
    self_contact: bool


class SimulatedDriver(Driver):
    """A driver whose robot is simulated, on either clock. Its `capabilities.truth` is True."""

    @abstractmethod
    def truth(self) -> Truth:
        """The true state of the robot. Only while the driver is open."""

    @property
    def lateness_s(self) -> float:
        """Greatest recent lateness of the simulation against the real clock [s]; NaN where it cannot be late."""
        return float("nan")


class LockstepDriver(SimulatedDriver):
    """A simulated robot whose time passes only in `advance`. Its `capabilities.lockstep` is True."""

    @abstractmethod
    def advance(self, seconds: float) -> None:
        """Let simulated time pass."""

    def detached(self, *, realtime: bool) -> SimulatedDriver:
        """The same robot on the real clock, in a process of its own. Call it at most once, before `open`.

        Args:
            realtime: whether that process may ask for realtime scheduling.

        Raises `ConfigError` if the driver runs in lockstep only.
        """
        raise ConfigError(f"driver {self.name!r} runs in lockstep only; use --clock lockstep")


def simulated(driver: Driver) -> SimulatedDriver | None:
    """The driver, if it is simulated and its capabilities say so."""
    return driver if isinstance(driver, SimulatedDriver) and driver.capabilities.truth else None


def lockstep(driver: Driver) -> LockstepDriver | None:
    """The driver, if it runs in lockstep and its capabilities say so."""
    return driver if isinstance(driver, LockstepDriver) and driver.capabilities.lockstep else None
