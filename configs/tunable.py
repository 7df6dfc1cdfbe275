"""Numbers of a robot file that may be found by measurement, with bounds: `choose_numbers`.

Which they are, within which bounds and why, is data: `tunable.yaml`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot
from flexmotion.configs.robot_file import RobotFile
from flexmotion.configs.schema import Strict, load
from flexmotion.configs.yaml_numbers import Place

FILE = Path(__file__).with_name("tunable.yaml")
DIGITS = 5
"""Significant digits of a number that is written; it is measured with these, too."""
STANDARD_GRAVITY = 9.81
"""[m/s²]; the bounds need no more digits."""

Scale = Literal["hip_height", "pendulum_time", "pendulum_speed", "sole_half_length", "sole_half_width", "one"]
_SCALES: dict[Scale, Callable[[RobotFile], float]] = {
    "hip_height": lambda file: file.gait.stand_hip_height,
    "pendulum_time": lambda file: math.sqrt(file.gait.stand_hip_height / STANDARD_GRAVITY),
    "pendulum_speed": lambda file: math.sqrt(file.gait.stand_hip_height * STANDARD_GRAVITY),
    "sole_half_length": lambda file: file.feet.left.half_size[0],
    "sole_half_width": lambda file: file.feet.left.half_size[1],
    "one": lambda file: 1.0,
}


class TunableNumber(Strict):
    """A number that may be tuned.

    Attributes:
        at: its place in the robot file.
        unit: of the number in the robot file.
        scale: what the bounds are multiplied by; see `tunable.yaml`.
        bounds: least and greatest value over the scale [1].
        reason: why these bounds.
    """

    at: Place
    unit: str
    scale: Scale
    bounds: tuple[float, float]
    reason: str = Field(min_length=1)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.bounds[0] < self.bounds[1]:
            raise ValueError(f"bounds {list(self.bounds)} must be [lower, higher]")
        return self


class TunableNumbers(Strict):
    """The file `tunable.yaml`.

    Attributes:
        numbers: those that may be tuned, by name.
        kept: names of those that may not, or of their section, and why.
    """

    numbers: dict[str, TunableNumber]
    kept: dict[str, str]


@dataclass(frozen=True)
class ChosenNumber:
    """A number of one robot that is to be tuned, in the unit of the robot file.

    Attributes:
        name: such as `gait.clearance`.
        at: its place in the robot file.
        unit: of all its values.
        low, high: bounds.
        start: the value in the robot file.
    """

    name: str
    at: Place
    unit: str
    low: float
    high: float
    start: float

    def value(self, share: float) -> float:
        """The value at a share of the way from the lower to the upper bound, in [0, 1], as it is written."""
        return rounded(self.low + min(max(share, 0.0), 1.0) * (self.high - self.low))

    @property
    def start_share(self) -> float:
        """Where the value in the robot file is between the bounds, in [0, 1]."""
        return (self.start - self.low) / (self.high - self.low)


def rounded(value: float) -> float:
    """A number as it is written, with `DIGITS` significant digits."""
    return float(f"{value:.{DIGITS}g}") + 0.0  # + 0.0: no negative zero


@cache
def tunable_numbers() -> TunableNumbers:
    """The content of `tunable.yaml`."""
    return load(TunableNumbers, FILE)


def choose_numbers(names: Sequence[str], robot: Robot) -> tuple[ChosenNumber, ...]:
    """The named numbers of a robot with their bounds, in the order of `tunable.yaml`.

    Raises:
        ConfigError: a name is unknown, given twice or not to be tuned, or the robot file lacks the number or has one
            that is not between the bounds.
    """
    if not names:
        raise ConfigError(f"no numbers to tune, expected some of: {', '.join(tunable_numbers().numbers)}")
    if twice := sorted({name for name in names if list(names).count(name) > 1}):
        raise ConfigError(f"number {twice[0]} is given twice")
    chosen = {name: _chosen(name, robot) for name in names}
    return tuple(chosen[name] for name in tunable_numbers().numbers if name in chosen)


def unusual_numbers(robot: Robot) -> tuple[str, ...]:
    """Messages about numbers of a robot outside the bounds of `tunable.yaml`: it can be run, and may well fall."""
    content, found = robot.config.model_dump(), []
    for name, number in tunable_numbers().numbers.items():
        low, high = _bounds(number, robot)
        value = _value_at(content, number.at)
        if value is not None and not low <= value <= high:
            unit, least, most = "" if number.unit == "1" else f" {number.unit}", *number.bounds
            of = "" if number.scale == "one" else f" ({least:g} to {most:g} times {number.scale})"
            expected = f"expected {low:.4g} to {high:.4g}{unit}{of}"
            found.append(f"{robot.file}: field {name}: {value:g}{unit}, {expected}: {number.reason}")
    return tuple(found)


def _bounds(number: TunableNumber, robot: Robot) -> tuple[float, float]:
    low, high = (rounded(bound * _SCALES[number.scale](robot.config)) for bound in number.bounds)
    return low, high


def _chosen(name: str, robot: Robot) -> ChosenNumber:
    known = tunable_numbers()
    number = known.numbers.get(name)
    if number is None:
        kept = next((why for own, why in known.kept.items() if name == own or name.startswith(f"{own}.")), None)
        told = f"number {name} is not tuned: {kept}" if kept is not None else f"unknown number {name!r}"
        raise ConfigError(f"{told}; expected some of: {', '.join(known.numbers)}")
    low, high = _bounds(number, robot)
    start = _value_at(robot.config.model_dump(), number.at)
    if start is None:
        raise ConfigError(f"{robot.file}: field {name}: missing; write a number from {low:g} to {high:g} to start from")
    if not low <= start <= high:
        raise ConfigError(f"{robot.file}: field {name}: {start:g} is not between its bounds {low:g} and {high:g}")
    return ChosenNumber(name, number.at, number.unit, low, high, start)


def _value_at(content: dict[str, Any], at: Place) -> float | None:
    """The number at a place of a robot file; None where its section is missing."""
    found: Any = content
    for key in at:
        found = None if found is None else found[key]
    return None if found is None else float(found)
