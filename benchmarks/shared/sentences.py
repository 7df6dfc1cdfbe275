"""`Task`: a sentence for a robot, and what should happen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from flexmotion.configs.errors import ConfigError

SENTENCES = Path(__file__).parents[2] / "tests" / "flexmotion" / "text" / "data" / "requests.yaml"
UNITS = {"deg": "angle", "m": "length", "steps": "steps", "s": "time", "times": "times"}


@dataclass(frozen=True)
class Task:
    """One sentence, what it is said in, and what should happen; keys as in `tests/.../requests.yaml`."""

    say: str
    after: str | None = None
    does: tuple[tuple[str, ...], ...] | None = None
    refused: bool = False
    goes_on: bool = False
    dropped: tuple[str, ...] = ()
    speed: str | None = None
    on_the_spot: bool = False
    expect: tuple[str, ...] = ()
    screen: bool = False
    bundle: str | None = None
    seed: int = 1


def tasks_of(file: Path, bundle: Path | None, seed: int) -> list[Task]:
    """The sentences of a file: rows as in `requests.yaml`, or sentences alone.

    Raises:
        ConfigError: the file cannot be read, or a row has unknown keys.
    """
    try:
        rows: list[Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise ConfigError(f"{file}: cannot be read as a list of sentences: {error}") from error
    found = []
    for row in rows:
        row = {"say": row} if isinstance(row, str) else dict(row)
        row["does"] = None if "does" not in row else tuple(tuple(map(str, one)) for one in row["does"])
        row |= {name: tuple(row.get(name, ())) for name in ("dropped", "expect")}
        try:
            found.append(Task(**row, bundle=None if bundle is None else str(bundle), seed=seed))
        except TypeError as error:
            raise ConfigError(f"{file}: {row.get('say', row)}: {error}") from error
    return found
