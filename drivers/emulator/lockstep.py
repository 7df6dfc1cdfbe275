"""`LockstepBus`: a bus driver and a simulated robot on its emulated bus, stepped tick by tick like driver `sim`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexmotion.drivers.bus.driver import BusDriver
from flexmotion.drivers.emulator.loopback import Loopback
from flexmotion.drivers.emulator.sim_body import SimBody
from flexmotion.drivers.interface import Bool, Capabilities, Float, JointCommand, RobotState
from flexmotion.drivers.simulated import LockstepDriver, Truth


class LockstepBus(LockstepDriver):
    """A bus driver on an emulated clock: the wire time of a read passes during the read.

    Args:
        driver: a bus driver; emulated ports replace its ports.
        world: the emulated buses; the driver's `port` options name them.
        body: the robot on these buses.
    """

    name = "lockstep_bus"

    def __init__(self, driver: BusDriver, world: Loopback, body: SimBody) -> None:
        super().__init__(driver.robot)
        driver.open_port = world.open_port
        self._driver, self._world, self._body = driver, world, body
        self._tick_end: float | None = None

    @property
    def capabilities(self) -> Capabilities:
        """Those of the bus driver, and all of simulation."""
        real = self._driver.capabilities
        return replace(real, lockstep=True, truth=True)

    @property
    def delay_s(self) -> float:
        """See `Driver`."""
        return self._driver.delay_s

    @property
    def turns(self) -> int:
        """See `Driver`."""
        return self._driver.turns

    @property
    def temperature_limit(self) -> Float:
        """See `Driver`."""
        return self._driver.temperature_limit

    @property
    def voltage_limit(self) -> Float:
        """See `Driver`."""
        return self._driver.voltage_limit

    @property
    def connected(self) -> bool:
        """See `Driver`."""
        return self._driver.connected

    @property
    def holding(self) -> Sequence[str]:
        """See `Driver`."""
        return self._driver.holding

    @property
    def violations(self) -> int:
        """Goals outside the envelope, counted by the emulated servos."""
        return self._body.receiver.violations

    def open(self) -> None:
        """See `Driver`."""
        self._driver.open()
        # Align ticks with physics steps, however long opening took: the time that a goal waits for its physics step
        # changes the tracking error by a sixth, and runs must be comparable.
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

    def switch(self, which: Bool, on: bool) -> None:
        """See `Driver`."""
        self._driver.switch(which, on)

    def reboot(self, which: Bool) -> None:
        """See `Driver`."""
        self._driver.reboot(which)

    def take_restarted(self) -> Sequence[tuple[int, str | None]]:
        """See `Driver`."""
        return self._driver.take_restarted()

    def take_pins(self, goal: Float) -> None:
        """See `Driver`."""
        self._driver.take_pins(goal)

    def damp(self) -> None:
        """See `Driver`."""
        self._driver.damp()

    def truth(self) -> Truth:
        """See `SimulatedDriver`."""
        return self._body.driver.truth()

    def advance(self, seconds: float) -> None:
        """Let the rest of the tick pass; if reading overran the tick, the next tick is shorter by as much."""
        self._tick_end = (self._world.now if self._tick_end is None else self._tick_end) + seconds
        self._world.advance(self._tick_end - self._world.now)

    def close(self) -> None:
        """See `Driver`."""
        self._driver.close()
