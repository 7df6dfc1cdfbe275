"""How a robot gets up from its front or its back: key poses, in `get_up.yaml` beside the robot file.

A step moves all joints from the pose before to its own with a minimum-jerk profile, holds it, and is over once the
torso's pitch is inside its bounds. The pitch is that about the torso's own y axis: 0 upright, positive leaned forward,
about pi/2 on the front and -pi/2 on the back.
"""

from __future__ import annotations

from collections.abc import Mapping
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
"""Greatest speed of a way of minimum jerk over its mean speed (Flash and Hogan 1985)."""
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


@dataclass(frozen=True)
class GetUp:
    """From which sides a robot gets up.

    Attributes:
        steps: by side.
        unfit: by side, why the steps of the file are none for this robot. A copy of a robot's folder with other limits
            or servos is a robot all the same; it does not get up from there.
    """

    steps: Mapping[str, tuple[GetUpStep, ...]]
    unfit: Mapping[str, str]


def read_get_up(robot: Robot) -> GetUp:
    """How a robot gets up; from no side where there is no file.

    Raises:
        ConfigError: the file is malformed, names an unknown joint, or takes too long.
    """
    file, steps, unfit = robot.folder / FILE, {}, {}
    if file.is_file():
        content = load(GetUpFile, file)
        _VERSIONS.check(content.version, file)
        for side, written in (("front", content.front), ("back", content.back)):
            if written is None:
                continue
            origin = f"{file}: {side}"
            _check_written(robot, written, origin)
            try:
                steps[side] = steps_of(robot, written, origin)
            except ConfigError as error:
                unfit[side] = str(error)
    return GetUp(steps, unfit)


def _check_written(robot: Robot, written: Steps, origin: str) -> None:
    """Check what a side has that no limit and no servo of a robot makes right or wrong. Raises `ConfigError`."""
    longest_s = sum(one.seconds + one.hold_s + one.wait_s for one in written)
    if longest_s > LONGEST_S:
        raise ConfigError(f"{origin}: the steps take up to {longest_s:.0f} s, expected at most {LONGEST_S:g}")
    for one in written:
        robot.check_joint_names(f"{origin}, step {one.name!r}", one.pose)


def steps_of(robot: Robot, written: Steps, origin: str) -> tuple[GetUpStep, ...]:
    """Steps with their poses as arrays.

    Raises:
        ConfigError: a pose is outside the limits of a joint, or asks for a speed that its servo does not reach.
    """
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
