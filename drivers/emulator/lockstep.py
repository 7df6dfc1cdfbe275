"""`LockstepBus`: a bus driver and the robot behind its emulated bus, stepped tick by tick like driver `sim`."""

from __future__ import annotations

from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import Capabilities, Driver, Float, JointCommand, RobotState, Truth


class LockstepBus(Driver):
    """Everything but time is as on a real port: what a read takes on the wire passes in it.

    Args:
        driver: a real driver; its ports are replaced by emulated ones.
        world: the emulated buses; the driver's `port` options name them.
        body: the robot behind them.
    """

    name = "lockstep_bus"

    def __init__(self, driver: BusDriver, world: Loopback, body: SimBody) -> None:
        super().__init__(driver.robot)
        driver.open_port = world.open_port
        self._driver, self._world, self._body = driver, world, body
        self._tick_end: float | None = None

    @property
    def capabilities(self) -> Capabilities:
        """The driver's, and those of a simulation."""
        real = self._driver.capabilities
        return Capabilities(imu=real.imu, effort=real.effort, torque_bound=real.torque_bound, lockstep=True, truth=True)

    @property
    def delay_s(self) -> float:
        """See `Driver`."""
        return self._driver.delay_s

    @property
    def violations(self) -> int:
        """Goals outside the envelope, as counted where the bytes arrive."""
        return self._body.receiver.violations

    def open(self) -> None:
        """See `Driver`."""
        self._driver.open()
        # Ticks begin where physics steps, whatever opening took: how long a goal waits for its step moves tracking by a
        # sixth, and runs are compared.
        self._world.advance(-self._world.now % self._body.timestep)
        self._tick_end = None

    def read(self, state: RobotState) -> None:
        """See `Driver`."""
        if self._tick_end is None:
            self._tick_end = self._world.now
        self._driver.read(state)

    def write(self, command: JointCommand) -> None:
        """See `Driver`."""
        self._driver.write(command)

    def set_torque(self, on: bool) -> None:
        """See `Driver`."""
        self._driver.set_torque(on)

    def take_pins(self, goal: Float) -> None:
        """See `Driver`."""
        self._driver.take_pins(goal)

    def damp(self) -> None:
        """See `Driver`."""
        self._driver.damp()

    def truth(self) -> Truth:
        """See `Driver`."""
        return self._body.driver.truth()

    def advance(self, seconds: float) -> None:
        """Let the rest of the tick pass; a tick that reading overran ends late, and the next one makes up for it."""
        self._tick_end = (self._world.now if self._tick_end is None else self._tick_end) + seconds
        self._world.advance(self._tick_end - self._world.now)

    def close(self) -> None:
        """See `Driver`."""
        self._driver.close()
