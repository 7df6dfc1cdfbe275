"""Which kinds of motion a robot was judged to do: figures of `benchmarks/robot/kinds.py`, in `repertoire.yaml`.

The file lies beside the robot file. A robot without it was never judged, and is offered every kind. A robot that was
judged is offered what passed; as of a bundle, what no judge has seen is not offered either. Whether a kind is one at
all is checked where models are known (`flexmotion.text.phrases.check_kinds`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from pydantic import Field

from flexmotion.configs.judged import Judged
from flexmotion.configs.robot_file import Name
from flexmotion.configs.schema import Strict, load, store
from flexmotion.configs.versions import FormatVersions

if TYPE_CHECKING:
    from flexmotion.configs.robot import Robot

FILE = "repertoire.yaml"
JUDGE = "benchmarks robot/kinds"
"""What writes the file: `python -m`."""

_VERSIONS = FormatVersions(
    kind="repertoire", oldest=1, newest=1, migration=f"remove it and judge the robot again: python -m {JUDGE} --write"
)


class RepertoireFile(Strict):
    """The whole file.

    Attributes:
        version: of the file format.
        kinds: figures by kind of motion, as bundles name them.
        done_as: kinds that the robot's pace makes others, such as a run a walk, and which.
    """

    version: int = 1
    kinds: dict[Name, Judged] = Field(min_length=1)
    done_as: dict[Name, Name] = {}


@dataclass(frozen=True)
class RobotRepertoire:
    """What one robot was judged to do.

    Attributes:
        robot: its name.
        place: what commands call it: the name of a shipped robot, or the folder of another.
        kinds: figures by kind of motion.
        done_as: kinds that the robot's pace makes others, and which.
    """

    robot: str
    place: str
    kinds: Mapping[str, Judged]
    done_as: Mapping[str, str] = field(default_factory=dict)

    def offers(self, kind: str) -> bool:
        """Whether the robot passed the judge of a kind of motion."""
        return kind in self.kinds and self.kinds[kind].passed

    def figure(self, kind: str) -> str:
        """What was found of a kind of motion, in words."""
        found = self.kinds.get(kind)
        if found is None:
            return f"not judged: {judging(self.place)} --kind {kind}"
        done = round(found.share * found.samples)
        return f"{found.judge}: {done} of {found.samples} runs did, {100 * found.least:.0f} % pass"


def judging(place: str) -> str:
    """The command that judges a robot and writes its file. `place`: see `RobotRepertoire`."""
    return f"python -m {JUDGE} --robot {quote(place)} --write"


def read_repertoire(robot: Robot) -> RobotRepertoire | None:
    """The repertoire of a robot; None where there is no file.

    Raises:
        ConfigError: the file is malformed, or there is something of its name that cannot be read; it names the file,
            and the field.
    """
    file = robot.folder / FILE
    # A robot without this name was never judged, and offers every kind. A broken link or a folder is an error instead.
    if not os.path.lexists(file):
        return None
    content = load(RepertoireFile, file)
    _VERSIONS.check(content.version, file)
    return RobotRepertoire(robot.name, robot.place, content.kinds, content.done_as)


def write_repertoire(robot: Robot, kinds: Mapping[str, Judged], done_as: Mapping[str, str] | None = None) -> Path:
    """Write figures into a robot's folder; those of other kinds stay.

    Args:
        done_as: of these kinds, those that the robot's pace makes others, and which.

    Raises:
        ConfigError: the file cannot be written.
    """
    before = robot.repertoire or RobotRepertoire(robot.name, robot.place, {})
    other = {kind: made for kind, made in before.done_as.items() if kind not in kinds}
    content = RepertoireFile(kinds={**before.kinds, **kinds}, done_as={**other, **(done_as or {})})
    return store(content, robot.folder / FILE)
