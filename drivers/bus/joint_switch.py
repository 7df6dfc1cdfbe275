"""`JointSwitch`: the torque of single joints on the buses of a robot, and restarts of their servos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError, DriverError
from flexmotion.drivers.bus.servo_bus import TORQUE_LOST, ServoBus
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.masks import every, some

Bool = NDArray[np.bool_]

SETTLE_S = 0.05
"""Time after switching on in which servos without torque are switched on again; later it is a fault [s]."""

_REPEATS = 2
"""Times that a switch is sent again, once a tick: sync writes are not acknowledged, and not all servos tell their
torque in every cycle."""


class JointSwitch:
    """Knows which joints are meant to have torque; allocates nothing that grows.

    Args:
        n: number of joints.

    Attributes:
        limp: joints whose torque was switched off by themselves, (n,) bool.
    """

    def __init__(self, n: int) -> None:
        self.limp = np.zeros(n, np.bool_)
        self._powered = False
        self._since = np.zeros(n)  # time at which the torque of each was switched on [s]
        self._again = np.zeros(n, np.int64)
        self._restarts: dict[int, Iterator[None]] = {}
        self._ended: list[tuple[int, str | None]] = []

    def set_all(self, on: bool, now: float) -> None:
        """The torque of all was switched at time `now` [s]."""
        self._powered = on
        self.limp.fill(False)
        self._again.fill(0)
        self._since.fill(now)

    def switch(self, buses: Sequence[ServoBus], which: Bool, on: bool, now: float) -> None:
        """Switch some joints at time `now` [s]."""
        self.limp[which] = not on
        self._again[which] = _REPEATS
        self._since[which] = now
        for bus in buses:
            bus.switch(which[bus.where], on)

    def repeat(self, buses: Sequence[ServoBus]) -> None:
        """Send what was switched lately again; once a tick."""
        again = self._again > 0
        if not some(again):
            return
        self._again[again] -= 1
        for bus in buses:
            for on in (False, True):
                which = (again & (self.limp != on))[bus.where]
                if which.any():
                    bus.switch(which, on)

    def look(self, buses: Sequence[ServoBus], stale: NDArray[np.int64], now: float, state: RobotState) -> None:
        """Compare the torque that servos report with what it is meant to be.

        Torque that went off unasked is switched on again during `SETTLE_S`, later `TORQUE_LOST` is set.
        """
        if not self._powered or all(every(bus.measured.torque != self.limp[bus.where]) for bus in buses):
            return
        for bus in buses:
            limp, fresh = self.limp[bus.where], stale[bus.where] == 0
            bus.switch(limp & bus.measured.torque & fresh, False)
            off = ~limp & ~bus.measured.torque & fresh
            settling = now - self._since[bus.where] < SETTLE_S
            bus.repeat_on(off & settling)
            state.hardware_error[bus.joints[off & ~settling]] |= TORQUE_LOST

    def restart(self, buses: Sequence[ServoBus], which: Bool) -> None:
        """Begin to restart the servos of the joints in `which`, (n,)."""
        for bus in buses:
            for slot, joint in enumerate(bus.joints):
                if which[joint]:
                    self._restarts[int(joint)] = bus.restart(slot)

    def go_on(self) -> None:
        """One step of one restart: at most one exchange, so that a tick is not held up by many servos."""
        if not self._restarts:
            return
        joint = next(iter(self._restarts))
        steps = self._restarts.pop(joint)
        try:
            next(steps)
        except StopIteration:
            self._ended.append((joint, None))
        except (ConfigError, DriverError) as error:
            self._ended.append((joint, str(error)))
        else:
            self._restarts[joint] = steps

    def take_restarted(self) -> list[tuple[int, str | None]]:
        """See `Driver.take_restarted`."""
        ended, self._ended = self._ended, []
        return ended
