"""`Inspection`: the settings that a servo keeps without power, as they are and as the robot file wants them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexmotion.configs.errors import ConfigError, DriverError


class NotConfiguredError(ConfigError):
    """A servo's settings differ from the robot file."""


@dataclass(frozen=True)
class Inspection:
    """One servo, as it was read.

    Attributes:
        joint, id, servo: its joint, address and model.
        port: of its bus.
        held: settings in EEPROM that the robot file determines, as the servo has them, by name of the register.
        wanted: the same as the robot file wants them.
        torque_on: whether its torque is on, which locks the EEPROM of some servos.
    """

    joint: str
    id: int
    servo: str
    port: str
    held: dict[str, int]
    wanted: dict[str, int]
    torque_on: bool

    @property
    def changes(self) -> dict[str, int]:
        """Settings that differ, with the values wanted, in the order in which they must be written."""
        return {name: value for name, value in self.wanted.items() if self.held[name] != value}

    @property
    def where(self) -> str:
        """`servo of JOINT (id N) on PORT`, for messages."""
        return f"servo of {self.joint} (id {self.id}) on {self.port}"


def refuse_unconfigured(inspections: Sequence[Inspection]) -> None:
    """Raise `NotConfiguredError` if a setting of a servo differs from the robot file."""
    wrong = [each for each in inspections if each.changes]
    if not wrong:
        return
    first, others = wrong[0], len(wrong) - 1
    name, value = next(iter(first.changes.items()))
    more = f" ({others} other servo{'s' if others > 1 else ''} too)" if others else ""
    raise NotConfiguredError(
        f"{first.where}: is not configured: {name} is {first.held[name]}, the robot file wants {value}{more}; "
        "`flexmotion servo configure` shows and writes what differs"
    )


def refuse_locked(inspections: Sequence[Inspection]) -> None:
    """Raise `DriverError` if torque is on in one of the servos that are to be written."""
    for each in inspections:
        if each.torque_on:
            raise DriverError(
                f"{each.where}: torque is on, which locks its settings: hold the robot and switch its "
                "power off and on; nothing was written"
            )
