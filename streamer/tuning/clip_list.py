"""Lists of motions that a robot is measured on: `ClipList`.

A list is a YAML file by kind of motion:

```yaml
walking:
  - walk.bvh                                     # a motion file; paths start at the list's folder
  - {clip: walk_fast.bvh, seconds: 6}            # its first seconds
  - {text: walk forward, seconds: 5}             # sampled from the shipped model
  - {velocity: [0.5, 0, 0.5], seconds: 5}
turning:
  - {script: turns.yaml}
```

Every second entry of a kind (from the second on) runs with the standard perturbations of the simulated robot, the
others as the robot file says.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.schema import Strict, parse, read_yaml
from flexmotion.streamer.motion.intents import Clip, Intent, Text, Velocity
from flexmotion.streamer.motion.script import Item, load_script

SHIPPED = {"tuning": "tuning_clips.yaml", "reporting": "reporting_clips.yaml"}
"""Lists in `flexmotion/data`, by name."""

Sort = Literal["clip", "script", "text", "velocity"]


class ClipEntry(Strict):
    """One entry of a list: one of `clip`, `script`, `text` and `velocity`.

    Attributes:
        clip, script: a file; its path starts at the list's folder.
        text: what to do, in words.
        velocity: of the human, ahead and to the left [m/s], turning left [rad/s].
        seconds: how long it is followed [s]; None: to the end of a clip, or to the stop of a script.
    """

    clip: str | None = None
    script: str | None = None
    text: str | None = None
    velocity: tuple[float, float, float] | None = None
    seconds: float | None = Field(default=None, gt=0, le=600)

    @model_validator(mode="after")
    def _one(self) -> ClipEntry:
        given = [name for name in ("clip", "script", "text", "velocity") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of clip, script, text and velocity, found {' and '.join(given) or 'none'}")
        if given[0] in ("text", "velocity") and self.seconds is None:
            raise ValueError(f"{given[0]} goes on without an end; give seconds")
        return self


@dataclass(frozen=True)
class TuningClip:
    """A motion to measure a robot on.

    Attributes:
        kind: of motion, such as `walking`.
        name: for tables, such as "walk.bvh" or "walk forward".
        sort: what it is.
        items: what to do from when on; a clip is an item at time 0.
        seconds: how long it is followed [s]; None: to its end.
        perturbed: whether the simulated robot is perturbed.
        digest: of what is followed; equal for the same file, words or velocity, however long they are followed.
    """

    kind: str
    name: str
    sort: Sort
    items: tuple[Item, ...]
    seconds: float | None
    perturbed: bool
    digest: str

    @property
    def identity(self) -> str:
        """In words, what distinguishes it from other entries of a list."""
        length = "" if self.seconds is None else f" {self.seconds:g} s"
        return f"{self.kind}: {self.name}{length}{' perturbed' if self.perturbed else ''} {self.digest[:12]}"


class ClipList:
    """The motions of a list.

    Args:
        name: a shipped list's (`SHIPPED`), or a YAML file.

    Attributes:
        name: as given.
        clips: kind by kind.

    Raises:
        ConfigError: there is no such list, an entry is wrong, a file cannot be read, or the list is empty.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        if name in SHIPPED:
            with as_file(files("flexmotion") / "data") as folder:
                self.clips = _read(folder / SHIPPED[name])
        elif not Path(name).is_file():
            raise ConfigError(f"list of clips {name}: no such file, and none of: {', '.join(SHIPPED)}")
        else:
            self.clips = _read(Path(name))


def refuse_shared(tuning: ClipList, reporting: ClipList) -> None:
    """Raise `ConfigError` if two lists share a clip: figures on what was tuned on say nothing about other motion."""
    own = {clip.digest: clip for clip in tuning.clips}
    if shared := [clip.name for clip in reporting.clips if clip.digest in own]:
        raise ConfigError(
            f"lists {tuning.name} and {reporting.name} share {', '.join(shared)}: a robot is reported on other motion "
            "than it is tuned on"
        )


def _read(file: Path) -> tuple[TuningClip, ...]:
    found = []
    for kind, entries in read_yaml(file).items():
        if not isinstance(entries, list) or not entries:
            raise ConfigError(f"{file}: field {kind}: expected a list of clips, found {type(entries).__name__}")
        for place, entry in enumerate(entries):
            origin = f"{file}: {kind}, entry {place + 1}"
            content = {"clip": entry} if isinstance(entry, str) else entry
            if not isinstance(content, dict):
                raise ConfigError(f"{origin}: expected a file or a mapping, found {type(entry).__name__}")
            found.append(_clip(str(kind), parse(ClipEntry, content, origin), place, file, origin))
    if not found:
        raise ConfigError(f"{file}: has no clips, expected kind: [FILE, ...]")
    return tuple(found)


def _clip(kind: str, entry: ClipEntry, place: int, file: Path, origin: str) -> TuningClip:
    def made(name: str, sort: Sort, items: tuple[Item, ...], digest: str) -> TuningClip:
        return TuningClip(kind, name, sort, items, entry.seconds, perturbed=place % 2 == 1, digest=digest)

    try:
        if entry.text is not None:
            return made(entry.text, "text", (Item(0.0, Text(entry.text)),), _digest(entry.text.casefold().split()))
        if entry.velocity is not None:
            name = f"velocity {', '.join(f'{speed:g}' for speed in entry.velocity)}"
            return made(name, "velocity", (Item(0.0, Velocity(*entry.velocity)),), _digest(entry.velocity))
    except ConfigError as error:
        raise ConfigError(f"{origin}: {error}") from error
    path = file.parent / Path(str(entry.clip or entry.script)).expanduser()
    if not path.is_file():
        raise ConfigError(f"{origin}: no such file: {path}")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if entry.clip is not None:
        # Absolute: another process reads it.
        return made(path.name, "clip", (Item(0.0, Clip(str(path.absolute()))),), digest)
    return made(path.name, "script", tuple(Item(item.at, _absolute(item.intent)) for item in load_script(path)), digest)


def _absolute(intent: Intent) -> Intent:
    return Clip(str(Path(intent.name).absolute())) if isinstance(intent, Clip) else intent


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()
