"""The state of a campaign in its folder: what it is, and all that was measured; written after every generation."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.report.figure import Section
from flexmotion.streamer.tuning.figures import AskedWay, RunFigures

FILE = "state.json"


class Campaign(Section):
    """What a campaign is. Two of which anything differs cannot share a folder.

    Attributes:
        robot: name of the robot.
        robot_folder: digest of all files in its folder.
        numbers: bounds of the numbers that are tuned, in the unit of the robot file.
        clips, report: identities of the clips of both lists, in order.
        seed, population: of the search.
        flexmotion, cma: versions of what measures and what searches.
    """

    robot: str
    robot_folder: str
    numbers: dict[str, tuple[float, float]]
    clips: tuple[str, ...]
    report: tuple[str, ...]
    seed: int
    population: int
    flexmotion: str
    cma: str

    def differences(self, other: Campaign) -> list[str]:
        """What differs, in words: this one's first."""
        found = []
        for name, own, others in (
            (field, getattr(self, field), getattr(other, field)) for field in type(self).model_fields
        ):
            if own != others:
                found.append(f"{name.replace('_', ' ')} ({_told(own)}; here {_told(others)})")
        return found


class Candidate(Section):
    """A candidate of a generation: its numbers, cost, runs that did not stay upright, and the first failure."""

    numbers: dict[str, float]
    cost: float
    down: int
    failure: str | None = None


class Measured(Section):
    """Numbers, their cost, and their runs on the tuning list."""

    numbers: dict[str, float]
    cost: float
    runs: tuple[RunFigures, ...]


class Reported(Section):
    """Runs on the reporting list of the numbers of the robot file, and of those found."""

    before: tuple[RunFigures, ...]
    after: tuple[RunFigures, ...]
    numbers: dict[str, float]


class CampaignState(Section):
    """All of a campaign.

    Attributes:
        asked, report_asked: ways of the clips of both lists.
        start: the numbers of the robot file.
        best: the numbers of the least cost; the start, where none cost less.
        generations: candidates of each.
        reported: on the reporting list; None: not measured yet.
    """

    schema_: Literal["flexmotion.tuning-state/1"] = Field(default="flexmotion.tuning-state/1", alias="schema")
    campaign: Campaign
    asked: tuple[AskedWay, ...]
    report_asked: tuple[AskedWay, ...]
    start: Measured
    best: Measured
    generations: tuple[tuple[Candidate, ...], ...] = ()
    reported: Reported | None = None


def read_state(folder: Path, campaign: Campaign) -> CampaignState | None:
    """The state of a campaign in its folder; None where it has not begun.

    Raises:
        ConfigError: the folder holds another campaign, or something else.
    """
    file = folder / FILE
    if not file.exists():
        others = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
        if others:
            raise ConfigError(
                f"{folder}: holds no campaign, but {', '.join(others[:3])}; give a new or an empty folder"
            )
        return None
    try:
        state = CampaignState.model_validate_json(file.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"{file}: field {where or '(file)'}: {first['msg']}; expected a file of `robots tune`"
        ) from error
    if differences := state.campaign.differences(campaign):
        raise ConfigError(
            f"{folder}: was begun with another {'; another '.join(differences)}. Give the same command to go on, or "
            "another folder"
        )
    return state


def write_state(folder: Path, state: CampaignState) -> Path:
    """Write the state, completely or not at all. Raises `ConfigError` if the file cannot be written."""
    return write_whole(folder / FILE, state.model_dump_json(by_alias=True, indent=1) + "\n")


def write_whole(file: Path, text: str) -> Path:
    """Write a text file, completely or not at all. Raises `ConfigError` if it cannot be written."""
    unfinished = file.with_name(f".{file.name}.unfinished")
    try:
        with unfinished.open("w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(unfinished, file)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror}") from error
    return file


def folder_digest(folder: Path) -> str:
    """Digest of the names and contents of all files in a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"{path.relative_to(folder)}\0{hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()


def _told(value: object) -> str:
    """A value in a message, shortened."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in value.items())
    if isinstance(value, tuple):
        return ", ".join(str(one) for one in value)
    text = str(value)
    return text[:12] if len(text) == hashlib.sha256().digest_size * 2 else text
