"""`replay`: runs the source of a log again, in lockstep on the simulated robot, and compares the runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.drivers.registry import create
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.log.judged import Subject
from flexmotion.streamer.log.reader import Log
from flexmotion.streamer.motion.intents import from_content
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.report.report import Report
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

TOLERANCES = {
    "fell": 0.0,
    "joint_rmse_rad": 0.01,
    "lag_s": 0.016,
    "foot_slip_mm_s": 3.0,
    "net_path_ratio": 0.05,
    "robot_went.ahead_m": 0.1,
    "robot_went.left_m": 0.1,
    "robot_went.turned_rad": 0.1,
    "heading_rms_rad": 0.05,
    "steps_planned": 1.0,
    "steps_inserted": 1.0,
    "hand_error_share": 0.01,
}
"""Largest difference of a figure for logs of the real clock, where plans join at other ticks.

At least twice the difference between 8 perturbed walks, turns and stands on the real clock and their replays: 5 mrad,
0 s, 1 mm/s, 0.007, 0.013 rad, no step, 0.003. In lockstep figures must be equal.

Of the way: in 3 of 7 live runs with targets it differed by up to 45 mm and 51 mrad. In the others a stop or a turn
ended with another step, and the robot went on from there (up to .25 m and .44 rad): such a replay is another run, and
differs.
"""
_TIMING = {
    *("stamp_ns", "work_s", "lateness_s", "robot_lateness_s", "sample_s", "retarget_s"),
    *("target_to_command_s", "target_to_effect_s", "seen_to_command_s"),
}
"""Columns that depend on the wall clock and differ between equal runs."""


@dataclass(frozen=True)
class Compared:
    """One figure of both runs; None if unknown. `tolerance` None: shown, not compared."""

    name: str
    logged: float | None
    replayed: float | None
    tolerance: float | None

    @property
    def difference(self) -> float | None:
        """Replayed minus logged value."""
        return None if self.logged is None or self.replayed is None else self.replayed - self.logged

    @property
    def agrees(self) -> bool:
        """Whether the difference is within tolerance; a figure that is unknown in the log always agrees."""
        if self.tolerance is None or self.logged is None:
            return True
        return self.difference is not None and abs(self.difference) <= self.tolerance


@dataclass(frozen=True)
class Replay:
    """Comparison of both runs.

    Attributes:
        figures: the motion figures.
        differing: columns of the ticks that are not equal bit for bit, except timing.
    """

    figures: list[Compared]
    differing: list[str]

    @property
    def agrees(self) -> bool:
        """Whether every figure agrees."""
        return all(figure.agrees for figure in self.figures)


def replay(log: Log, subject: Subject, progress: Callable[[float], None] | None = None) -> Replay:
    """Run a log's source again with its settings, seed, targets and requests, and compare.

    If the log ends early, the second run ends after that tick.

    Args:
        progress: called with the share done, in [0, 1].

    Raises:
        ConfigError: the log has no source that can be run again or lacks its first ticks, or the robot's joints have
            changed.
        DriverError: the simulation failed.
    """
    if not len(log.rows) or log.rows["tick"][0]:
        raise ConfigError(f"{log.path}: cannot be replayed, its first ticks are missing")
    if log.missing:
        numbers = ", ".join(map(str, log.missing))
        raise ConfigError(
            f"{log.path}: cannot be replayed, its parts {numbers} were removed; the first part alone can be, "
            "copied to another folder"
        )
    if subject.robot.joint_names != log.header.joints:
        raise ConfigError(f"{log.path}: cannot be replayed, robot {log.header.robot} has other joints now")
    again = _run(log, subject, progress)
    logged = log.record()
    kept = again.rows[again.rows["tick"] <= log.rows["tick"][-1]]
    cut = RunTrace(again.rate_hz, again.joint_names, kept_s=len(kept) / again.rate_hz + 1.0)
    cut.append(kept)
    cut.events.extend(event for event in again.events if event.tick <= log.rows["tick"][-1])
    lockstep = log.header.clock == "lockstep"
    figures = _compare(subject.report(log, logged), subject.report(log, cut), exact=lockstep)
    return Replay(figures, _differing(logged, cut))


def _run(log: Log, subject: Subject, progress: Callable[[float], None] | None) -> RunTrace:
    header = log.header
    options = header.driver_options if header.driver == "sim" else {}
    driver = create("sim", subject.robot, **options, seed=header.seed)
    session = Session(
        subject.robot,
        driver,
        log.source(),
        header.settings,
        header.seconds,
        feedback=header.feedback,
        allow_refused=header.allow_refused,
        min_likeness=header.min_likeness,
        armed=header.armed,
        attended=header.attended,
        stay=header.stay,
    )
    end = int(log.rows["tick"][-1])
    targets, requests, persons = _targets(log), _requests(log), _persons(log)

    def operate() -> Request | None:
        tick = 0 if session.loop is None else session.loop.tick_count
        while targets and targets[0][0] <= tick:
            content = targets.pop(0)[1]
            session.targets.send(from_content(content), holds_s=content.get("holds_s", math.inf))
        while persons and persons[0][0] <= tick and isinstance(session.source, MirrorSource):
            session.source.channel.publish_row(persons.pop(0)[1])
        if progress is not None:
            progress(min(tick / max(end, 1), 1.0))
        if tick > end:
            return Request.QUIT  # a source that follows targets would go on for ever where the log lacks its end
        while requests and requests[0][0] <= tick:
            session.requests.send(*requests.pop(0)[1:])
        return None

    session.next_request = operate
    return session.run()


def _targets(log: Log) -> list[tuple[int, dict[str, Any]]]:
    """Each target with the first tick after its arrival."""
    rows = np.searchsorted(log.rows["stamp_ns"], [target["stamp_ns"] for target in log.targets])
    return [
        (int(log.rows["tick"][row]), target)
        for row, target in zip(rows, log.targets, strict=True)
        if row < len(log.rows)
    ]


def _persons(log: Log) -> list[tuple[int, Any]]:
    """Each pose of a person with the tick that came after its arrival; its times in lockstep are those of ticks."""
    rows = log.persons.copy()
    if log.header.clock == "lockstep":
        return [(round(float(row["arrived_s"]) * log.header.rate_hz), row) for row in rows]
    stamps, period_s = log.rows["stamp_ns"] * 1e-9, 1.0 / log.header.rate_hz
    after = np.searchsorted(stamps, rows["arrived_s"])
    found = []
    for row, place in zip(rows, after, strict=True):
        if place >= len(stamps):
            break
        # The source's clock runs with the ticks: a moment is as long before the tick as it was.
        offset_s = log.rows["tick"][place] * period_s - stamps[place]
        row["arrived_s"] += offset_s
        row["time_s"] += offset_s
        found.append((int(log.rows["tick"][place]), row))
    return found


def _requests(log: Log) -> list[tuple[int, Request, str]]:
    """Requests of operators with the tick at which each acted, and the joints that it named."""
    asked = [(event.tick, *event.message.partition(" ")[::2]) for event in log.events if event.kind == "request"]
    return [(tick, Request[name], joints) for tick, name, joints in asked if name in Request.__members__]


def _compare(logged: Report, replayed: Report, *, exact: bool) -> list[Compared]:
    before, after = _numbers(logged.motion.model_dump()), _numbers(replayed.motion.model_dump())
    return [
        Compared(name, before.get(name), after.get(name), 0.0 if exact else TOLERANCES.get(name))
        for name in dict.fromkeys((*before, *after))
    ]


def _numbers(section: dict[str, Any], prefix: str = "") -> dict[str, float | None]:
    """The figures of a section and its subsections, by dotted names."""
    found: dict[str, float | None] = {}
    for name, value in section.items():
        if isinstance(value, dict):
            found |= _numbers(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = None if value is None else float(value)
    return found


def _differing(logged: RunTrace, replayed: RunTrace) -> list[str]:
    if logged.used != replayed.used:
        return ["tick"]
    names = [name for name in logged.rows.dtype.names or () if name not in _TIMING]
    return [n for n in names if not np.array_equal(logged.rows[n], replayed.rows[n], equal_nan=_is_float(logged, n))]


def _is_float(record: RunTrace, name: str) -> bool:
    return bool(record.rows.dtype[name].base.kind == "f")
