"""The servo catalogue: figures of each servo model, each with its source or marked as an assumption.

A file of `configs/servos/` contains one family: `defaults` shared by its servos, the servos, and `provenance`, which
names an entry of `sources` for every figure.
"""

from __future__ import annotations

import math
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, parse, read_yaml

FOLDER = Path(__file__).parent / "servos"
NOT_DRIVEN = FOLDER.parent / "not_driven.yaml"

Protocol = Literal["dynamixel2", "feetech", "lx16a"]


class Source(Strict):
    """Source of a figure; `assumption` marks figures without a published source."""

    text: str
    assumption: bool = False


class Servo(Strict):
    """One servo model.

    Torque and speed are those of the output shaft at `nominal_voltage`; both scale with the supply. Angles are measured
    from `centre_tick`, positive with increasing ticks.

    Attributes:
        name, family, protocol: model name, catalogue file, wire protocol.
        model_number: answer to a ping; None: not known.
        nominal_voltage, min_voltage, max_voltage: supply [V].
        stall_torque: torque at standstill, for short times [N·m].
        usable_torque: greatest torque while it drives the load, torque and speed of the same sign [N·m].
        no_load_speed: [rad/s].
        stall_current: [A].
        gain_register, kp: a register value of the position gain and its stiffness [N·m/rad]; both are proportional.
        ticks_per_turn, centre_tick, min_tick, max_tick: position units.
        armature: inertia of rotor and gears, reflected to the output [kg·m²].
        frictionloss: dry friction at the output [N·m].
        damping: viscous friction at the output, in addition to back-EMF [N·m·s/rad].
        delay: from the arrival of a goal to acting on it [s].
        current_unit: one unit of the current registers [A]; None: no current measurement.
        torque_constant: output torque per motor current [N·m/A].
        temperature_limit: the servo shuts down above it [°C].
        stall_temperature_rise, thermal_time_constant: of first-order heating, final rise at stall [K] and time [s].
        provenance: source of every figure.
    """

    name: str
    family: str
    protocol: Protocol
    model_number: int | None = None
    nominal_voltage: float = Field(gt=0)
    min_voltage: float = Field(gt=0)
    max_voltage: float = Field(gt=0)
    stall_torque: float = Field(gt=0)
    usable_torque: float = Field(gt=0)
    no_load_speed: float = Field(gt=0)
    stall_current: float = Field(gt=0)
    gain_register: int = Field(gt=0)
    kp: float = Field(gt=0)
    ticks_per_turn: int = Field(gt=1)
    centre_tick: int
    min_tick: int
    max_tick: int
    armature: float = Field(ge=0)
    frictionloss: float = Field(ge=0)
    damping: float = Field(ge=0)
    delay: float = Field(ge=0, le=0.1)
    current_unit: float | None = Field(default=None, gt=0)
    torque_constant: float | None = Field(default=None, gt=0)
    temperature_limit: float
    stall_temperature_rise: float = Field(gt=0)
    thermal_time_constant: float = Field(gt=0)
    provenance: dict[str, Source]

    @model_validator(mode="after")
    def _consistent(self) -> Servo:
        if self.usable_torque > self.stall_torque:
            raise ValueError(f"usable_torque {self.usable_torque} exceeds stall_torque {self.stall_torque}")
        if not self.min_voltage <= self.nominal_voltage <= self.max_voltage:
            raise ValueError("voltages must be ordered min_voltage <= nominal_voltage <= max_voltage")
        if not self.min_tick <= self.centre_tick <= self.max_tick:
            raise ValueError("ticks must be ordered min_tick <= centre_tick <= max_tick")
        missing = [name for name in self.figures() if name not in self.provenance]
        if missing:
            raise ValueError(f"no source for {', '.join(missing)}; name one under provenance")
        return self

    def figures(self) -> dict[str, float]:
        """The known numbers, by name."""
        return {name: value for name, value in self if isinstance(value, (int, float))}

    @property
    def back_emf(self) -> float:
        """Stall torque / no-load speed [N·m·s/rad]: at speed qd, back-EMF reduces the stall torque by back_emf * qd."""
        return self.stall_torque / self.no_load_speed

    @property
    def tick_rad(self) -> float:
        """Angle of one position unit [rad]."""
        return 2 * math.pi / self.ticks_per_turn

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest angle of a goal [rad]."""
        return (
            (self.min_tick - self.centre_tick) * self.tick_rad,
            (self.max_tick - self.centre_tick) * self.tick_rad,
        )


class Family(Strict):
    """One catalogue file as written."""

    protocol: Protocol
    sources: dict[str, Source]
    provenance: dict[str, str]
    defaults: dict[str, Any]
    servos: dict[str, dict[str, Any]]

    def servo(self, name: str, file: Path) -> Servo:
        """The servo `name`, with defaults and resolved sources. Raises `ConfigError`."""
        own = dict(self.servos[name])
        keys = self.provenance | own.pop("provenance", {})
        unknown = sorted(set(keys.values()) - set(self.sources))
        if unknown:
            raise ConfigError(
                f"{file}: servos.{name}: unknown source {unknown[0]!r}, expected one of: {', '.join(self.sources)}"
            )
        content = self.defaults | own
        if "no_load_rpm" in content:
            content["no_load_speed"] = content.pop("no_load_rpm") * 2 * math.pi / 60
        provenance = {figure: self.sources[key] for figure, key in keys.items()}
        identity = {"name": name, "family": file.stem, "protocol": self.protocol}
        return parse(Servo, content | identity | {"provenance": provenance}, file.with_name(f"{file.name}#{name}"))


class NotDriven(Strict):
    """Actuators that no built-in driver supports: why, and their answer to a ping."""

    reason: str
    model_number: int | None = None


@cache
def not_driven() -> dict[str, NotDriven]:
    """Actuators that no built-in driver supports, by the start of the model name."""
    return {start: parse(NotDriven, content, NOT_DRIVEN) for start, content in read_yaml(NOT_DRIVEN).items()}


@cache
def catalogue() -> dict[str, Servo]:
    """All servos by name. Raises `ConfigError` if a file is malformed."""
    servos: dict[str, Servo] = {}
    for file in sorted(FOLDER.glob("*.yaml")):
        family = parse(Family, read_yaml(file), file)
        servos |= {name: family.servo(name, file) for name in family.servos}
    return servos


def find_servo(name: str) -> Servo:
    """The servo `name`. Raises `ConfigError` with the reason if it is not supported, or with the closest models."""
    servos = catalogue()
    if name not in servos:
        for start, other in not_driven().items():
            if name.upper().startswith(start):
                raise ConfigError(f"servo {name!r} {other.reason}: it needs a driver plug-in (docs/drivers.md)")
        close = get_close_matches(name.upper(), servos, n=3, cutoff=0.4) or sorted(servos)
        raise ConfigError(f"unknown servo {name!r}, did you mean: {', '.join(close)}")
    return servos[name]
