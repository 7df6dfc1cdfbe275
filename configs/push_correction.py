"""How a robot's joints answer a push beyond balance feedback: gains that were learned, in `push_correction.yaml`.

The file lies beside the robot file. Its gains are those of a robot that stands on its left foot; for the right foot
they are mirrored. `streamer/control/push_correction.py` applies them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import mujoco
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

FILE = "push_correction.yaml"
DIRECTIONS = ("outward", "inward", "ahead")
"""Of the error of the divergent component, from the foot that the robot stands on. There is none for
errors to the back: unpushed walks sway back by up to 53 mm after a foot has lifted, and few pushes to the back end in a
fall."""

_VERSIONS = FormatVersions(
    kind="push correction", oldest=1, newest=1, migration="search it again: benchmarks/robot/pushes.py --search"
)
_PARALLEL = 0.999
"""Least cosine between the axis of a joint and the mirror image of its partner's."""

Gains = dict[Name, float]


class PushCorrectionFile(Strict):
    """The whole file.

    Attributes:
        version: of the file format.
        dead: errors of the divergent component that move no joint, ahead and aside [m].
        begins: errors with which a correction begins, ahead and aside: walks that nobody pushes hardly have them
            [m]. It is over once the joints are back.
        reach: beyond `dead`, errors greater than this move joints no further [m].
        most: greatest offset of a joint [rad].
        outward, inward, ahead: offset of joints, by name, per error beyond `dead` in this direction, of a robot
            that stands on its left foot [rad/m]; outward is to its left.
    """

    version: int = 1
    dead: tuple[Annotated[float, Field(gt=0, le=0.1)], Annotated[float, Field(gt=0, le=0.1)]]
    begins: tuple[Annotated[float, Field(gt=0, le=0.1)], Annotated[float, Field(gt=0, le=0.1)]]
    reach: float = Field(gt=0, le=0.2)
    most: float = Field(gt=0, le=0.5)
    outward: Gains = Field(default_factory=dict)
    inward: Gains = Field(default_factory=dict)
    ahead: Gains = Field(default_factory=dict)

    @model_validator(mode="after")
    def _ordered(self) -> PushCorrectionFile:
        if any(begins < dead for begins, dead in zip(self.begins, self.dead, strict=True)):
            raise ValueError(f"begins {list(self.begins)} is below dead {list(self.dead)}, expected at least as much")
        return self


@dataclass(frozen=True)
class Correction:
    """The gains of one robot.

    Attributes:
        gains: by the foot that it stands on, (2, n, 3): of each joint, for each of `DIRECTIONS` [rad/m], read-only.
        dead, begins, reach, most: see `PushCorrectionFile`.
    """

    gains: Float
    dead: tuple[float, float]
    begins: tuple[float, float]
    reach: float
    most: float


def read_push_correction(robot: Robot) -> Correction | None:
    """The correction of a robot; None where there is no file.

    Raises:
        ConfigError: the file is malformed, or names a joint that is unknown or has no mirror image.
    """
    file = robot.folder / FILE
    if not file.is_file():
        return None
    content = load(PushCorrectionFile, file)
    _VERSIONS.check(content.version, file)
    return correction_of(robot, content, str(file))


def correction_of(robot: Robot, content: PushCorrectionFile, origin: str) -> Correction:
    """The gains as arrays, for both feet. Raises `ConfigError`, which begins with `origin`."""
    gains, partners = np.zeros((2, robot.n, len(DIRECTIONS))), _partners(robot)
    for column, direction in enumerate(DIRECTIONS):
        written: Gains = getattr(content, direction)
        robot.check_joint_names(f"{origin}: field {direction}", written)
        for joint, gain in written.items():
            index = robot.index(joint)
            if index not in partners:
                sides = ", ".join(robot.joint_names[one] for one in sorted(partners))
                raise ConfigError(
                    f"{origin}: field {direction}.{joint}: the joint has no mirror image, expected one of: {sides}"
                )
            partner, sign = partners[index]
            gains[0, index, column] = gain
            gains[1, partner, column] = sign * gain
    gains.setflags(write=False)
    return Correction(gains, content.dead, content.begins, content.reach, content.most)


def _partners(robot: Robot) -> dict[int, tuple[int, float]]:
    """The joint on the other side, and the sign of its angle in the mirror image, of each joint that has one."""
    data, chains = mujoco.MjData(robot.model), robot.mapping.chains()
    mujoco.mj_kinematics(robot.model, data)
    found = {}
    for name in chains:
        if not name.startswith("left_") or (other := f"right_{name.removeprefix('left_')}") not in chains:
            continue
        left, right = robot.chain(name), robot.chain(other)
        for part in left.keys() & right.keys():
            axes = [data.xaxis[robot.model.joint(robot.joint_names[one[part]]).id] for one in (left, right)]
            # The mirror image of a turn about the axes ahead and up is one against it.
            cosine = float(axes[1] @ (axes[0] * [-1.0, 1.0, -1.0]))
            if abs(cosine) >= _PARALLEL:
                sign = float(np.sign(cosine))
                found[left[part]], found[right[part]] = (right[part], sign), (left[part], sign)
    return found
