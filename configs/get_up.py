"""How a robot gets up from its front or its back: key poses, in `get_up.yaml` beside the robot file.

A step moves all joints from the pose before to its own with a minimum-jerk profile, holds it, and is over once the
torso's pitch is inside its bounds. The pitch is that about the torso's own y axis: 0 upright, positive leaned forward,
about pi/2 on the front and -pi/2 on the back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot_file import Name
from flexmotion.configs.schema import Strict, load
from flexmotion.configs.versions import FormatVersions

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

FILE = "get_up.yaml"
SIDES: tuple[Literal["front", "back"], ...] = ("front", "back")
"""Sides that a robot can get up from."""
MINIMUM_JERK_PEAK = 1.875
"""Peak speed of a minimum-jerk profile over its mean speed, 15/8."""
LONGEST_S = 40.0
"""Longest that the steps of a side may take, with all that they may wait [s]."""
SPEED_SHARE = 0.9
"""Greatest speed of a step's reference over the servo's no-load speed: the rest turns the joint against its load."""

_VERSIONS = FormatVersions(
    kind="get-up file", oldest=1, newest=1, migration='change it as docs/drivers.md, "Getting up", says'
)


class GetUpStepConfig(Strict):
    """One key pose.

    Attributes:
        name: what the robot does, for messages.
        pose: joint angles by name [rad]; joints that are not named are at 0.
        seconds: duration of the move from the pose before [s]; the first one takes longer where it is far.
        hold_s: time that the pose is held before the bounds are looked at [s].
        pitch: least and greatest pitch of the torso with which the next step may begin [rad].
        wait_s: time that the pitch has to come into these bounds after the hold [s].
    """

    name: Name
    pose: dict[Name, float]
    seconds: float = Field(gt=0, le=10)
    hold_s: float = Field(default=0.0, ge=0, le=5)
    pitch: tuple[float, float]
    wait_s: float = Field(default=0.5, ge=0, le=5)

    @model_validator(mode="after")
    def _ordered(self) -> GetUpStepConfig:
        if not self.pitch[0] < self.pitch[1]:
            raise ValueError(f"step {self.name!r}: pitch {list(self.pitch)} must be [lower, higher]")
        return self


Steps = Annotated[tuple[GetUpStepConfig, ...], Field(min_length=1)]


class GetUpFile(Strict):
    """The whole file.

    Attributes:
        version: of the file format.
        front, back: steps of a robot that lies on this side; None: it does not get up from there.
    """

    version: int = 1
    front: Steps | None = None
    back: Steps | None = None


@dataclass(frozen=True)
class GetUpStep:
    """A step with its pose in the order of the robot file.

    Attributes:
        q: pose, (n,) [rad], read-only. The others: see `GetUpStepConfig`.
    """

    name: str
    q: Float
    seconds: float
    hold_s: float
    pitch: tuple[float, float]
    wait_s: float


GetUp = dict[str, tuple[GetUpStep, ...]]
"""Steps by side; sides that the robot does not get up from are missing."""


def read_get_up(robot: Robot) -> GetUp:
    """The steps of a robot; empty where there is no file.

    Raises:
        ConfigError: the file is malformed, names an unknown joint, or asks for an angle outside a joint's limits or a
            speed that its servo does not reach.
    """
    file = robot.folder / FILE
    if not file.is_file():
        return {}
    content = load(GetUpFile, file)
    _VERSIONS.check(content.version, file)
    written = {"front": content.front, "back": content.back}
    return {side: steps_of(robot, steps, f"{file}: {side}") for side, steps in written.items() if steps is not None}


def steps_of(robot: Robot, written: Steps, origin: str) -> tuple[GetUpStep, ...]:
    """Steps with their poses as arrays, checked against the robot. Raises `ConfigError` (see `read_get_up`)."""
    longest_s = sum(one.seconds + one.hold_s + one.wait_s for one in written)
    if longest_s > LONGEST_S:
        raise ConfigError(f"{origin}: the steps take up to {longest_s:.0f} s, expected at most {LONGEST_S:g}")
    steps: list[GetUpStep] = []
    for one in written:
        q = robot.pose(f"{origin}, step {one.name!r}", one.pose)
        if steps:
            _check_speed(robot, steps[-1].q, q, one, origin)
        steps.append(GetUpStep(one.name, q, one.seconds, one.hold_s, one.pitch, one.wait_s))
    return tuple(steps)


def least_seconds(robot: Robot, before: Float, after: Float) -> float:
    """Shortest duration of a step between two poses, (n,) each [rad], at which every servo keeps up [s]."""
    return float(np.max(MINIMUM_JERK_PEAK * np.abs(after - before) / (SPEED_SHARE * robot.no_load_speed)))


def _check_speed(robot: Robot, before: Float, after: Float, step: GetUpStepConfig, origin: str) -> None:
    speed = MINIMUM_JERK_PEAK * np.abs(after - before) / step.seconds
    most = SPEED_SHARE * robot.no_load_speed
    worst = int(np.argmax(speed / most))
    if speed[worst] > most[worst] * (1 + 1e-9):
        raise ConfigError(
            f"{origin}, step {step.name!r}: field seconds: {step.seconds:g} is too short, joint "
            f"{robot.joint_names[worst]!r} would turn with {speed[worst]:.1f} rad/s, expected at most "
            f"{most[worst]:.1f}: at least {least_seconds(robot, before, after):.2f} s"
        )
