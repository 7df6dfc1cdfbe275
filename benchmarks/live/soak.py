"""Does a run keep upright, answering and small for hours, with random targets from three transports?

In lockstep the simulated robot is stepped as fast as it computes, with its gateway; on the wall clock the whole program
runs as a daemon. Targets come over a WebSocket, over HTTP and as lines, at random, each with the lease taken from the
others. The same targets at the same times without transports say how often the robot falls without them; a robot that
fell is armed again. Memory is that of each process, after its start. Each segment is a process; with
--state finished ones are not run again, so that an interrupted soak goes on.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from benchmarks.live.figures import SegmentFigures, total
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.program import started
from flexmotion.configs.errors import ConfigError, DriverError

MOST_GROWTH_MB = 1.0
"""Growth of memory in ten minutes."""


def segments(lockstep_min: float, plain_min: float, wall_min: float, segment_min: float, seed: int) -> list[list[str]]:
    """The arguments of each segment, in order."""
    found = []
    for kind, minutes, options in (
        ("lockstep", lockstep_min, []),
        ("lockstep", plain_min, ["--no-targets"]),
        ("real", wall_min, []),
    ):
        left, number = minutes, 0
        while left > 1e-6:
            length = min(left, segment_min)
            found.append([kind, "--seconds", f"{60 * length:g}", "--seed", str(seed + number), *options])
            left, number = left - length, number + 1
    return found


def run_segment(arguments: list[str], interval_s: float) -> SegmentFigures:
    """Run one segment; its progress goes to stderr.

    Raises:
        DriverError: it ended otherwise than with figures.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.live.segment", *arguments]
        command += ["--interval-s", str(interval_s), "--folder", folder]
        with started(command, stdout=subprocess.PIPE, text=True) as segment:
            printed, _ = segment.communicate()
    lines = printed.strip().splitlines()
    if segment.returncode or not lines:
        raise DriverError(f"segment {' '.join(arguments)}: exit code {segment.returncode}")
    return SegmentFigures.model_validate_json(lines[-1])


def known(state: Path | None) -> dict[str, SegmentFigures]:
    """The segments of a checkpoint file, by their arguments. Raises `ConfigError` for any other file."""
    if state is None or not state.exists():
        return {}
    found = {}
    for line in state.read_text(encoding="utf-8").splitlines():
        key, _, content = line.partition("\t")
        try:
            found[key] = SegmentFigures.model_validate_json(content)
        except ValidationError as error:
            raise ConfigError(f"{state}: not a checkpoint file of this benchmark: {line[:60]!r}") from error
    return found


def main(
    lockstep_min: Annotated[float, typer.Option(min=0.0, help="Minutes in lockstep, with targets.")] = 120.0,
    plain_min: Annotated[float, typer.Option(min=0.0, help="Minutes in lockstep, without transports.")] = 30.0,
    wall_min: Annotated[float, typer.Option(min=0.0, help="Minutes on the wall clock.")] = 30.0,
    segment_min: Annotated[float, typer.Option(min=0.1, help="Length of a segment.")] = 30.0,
    interval_s: Annotated[float, typer.Option(min=0.1, help="Mean interval of targets.")] = 3.0,
    seed: Annotated[int, typer.Option(help="Of the first segment of each kind.")] = 0,
    state: Annotated[Path | None, typer.Option("--state", help="Checkpoint file: segments that are done.")] = None,
) -> Outcome:
    """Run all segments that are not done yet, and judge."""
    console = Console(stderr=True)
    finished, found = known(state), []
    planned = segments(lockstep_min, plain_min, wall_min, segment_min, seed)
    for number, arguments in enumerate(planned, start=1):
        key = " ".join([*arguments, f"--interval-s {interval_s:g}"])
        if key not in finished:
            console.print(f"segment {number} of {len(planned)}: {key}")
            finished[key] = run_segment(arguments, interval_s)
            if state is not None:
                with state.open("a", encoding="utf-8") as file:
                    file.write(f"{key}\t{finished[key].model_dump_json()}\n")
        found.append(finished[key])
    _show(found)
    return _judged(found)


def _show(found: list[SegmentFigures]) -> None:
    names = ("clock", "targets", "min", "falls", "violations", "missed", "robot late", "MB in 10 min: most", "parts")
    table = Table(*names)
    for one in found:
        worst = max(one.growths.items(), key=lambda own: own[1].private_mb, default=None)
        growth = "too short" if worst is None else f"{worst[0]} {worst[1].private_mb:.2f}"
        counts = (len(one.falls), one.violations, one.missed, f"{one.robot_late_ms:.0f} ms")
        sent = str(sum(one.sent.values()))
        kind = one.clock if one.targets else f"{one.clock}, without transports"
        table.add_row(kind, sent, f"{one.seconds / 60:.1f}", *map(str, counts), growth, str(one.parts))
    memory = Table("clock", "process", "resident", "private", "95 %", "over s", title="MB in ten minutes")
    for one in found:
        for name, own in sorted(one.growths.items()):
            bounds = f"{own.least_mb:.2f} to {own.most_mb:.2f}"
            memory.add_row(
                one.clock, name, f"{own.resident_mb:.2f}", f"{own.private_mb:.2f}", bounds, f"{own.seconds:.0f}"
            )
    console = Console(width=120)
    console.print(table)
    if memory.row_count:
        console.print(memory)
    console.print(", ".join(f"{name} {number}" for name, number in sorted(total(found, "states").items())))
    for one in found:
        for fall in one.falls:
            ways = "" if one.targets else ", without transports"
            print(f"fell at {fall.at_s:.1f} s, {one.clock}, seed {one.seed}{ways}: {fall.cause}")
            print(f"  asked: {'; '.join(fall.asked)}")


def _judged(found: list[SegmentFigures]) -> Outcome:
    with_targets = [one for one in found if one.targets]
    plain = [one for one in found if not one.targets]
    hours = {True: sum(one.seconds for one in with_targets) / 3600, False: sum(one.seconds for one in plain) / 3600}
    falls = {True: sum(len(one.falls) for one in with_targets), False: sum(len(one.falls) for one in plain)}
    states = total(found, "states")
    sent = sum(total(with_targets, "sent").values())
    violations, parts = sum(one.violations for one in found), sum(one.parts for one in found)
    unreadable = sum(one.unreadable for one in found)
    answered = sum(states.values()) - states["none"]
    codes = {one.exit_code for one in found}
    verdicts = [
        Verdict(f"answered: {answered} of {sent}", answered == sent),
        Verdict(f"goals outside the envelope: {violations} (0)", violations == 0),
        Verdict(f"parts of logs that cannot be read: {unreadable} of {parts} (0)", unreadable == 0 and parts > 0),
        Verdict(f"exit codes after SIGTERM: {', '.join(map(str, sorted(codes)))} (0)", codes <= {0}),
    ]
    growths = [(name, own) for one in found for name, own in one.growths.items() if own.judged]
    if growths:
        name, worst = max(growths, key=lambda one: one[1].private_mb)
        sentence = f"private memory in ten minutes: {worst.private_mb:.2f} MB, {name} (< {MOST_GROWTH_MB:g})"
        verdicts.append(Verdict(sentence, worst.private_mb < MOST_GROWTH_MB))
    if plain and with_targets:
        # As often as without transports; one more may be chance.
        allowed = falls[False] / hours[False] * hours[True] + 1
        sentence = (
            f"falls: {falls[True]} in {hours[True]:.2f} h, without transports {falls[False]} in {hours[False]:.2f} h"
        )
        verdicts.append(Verdict(sentence, falls[True] <= allowed))
    figures = {
        "hours": hours[True],
        "falls": falls[True],
        "falls_without_transports": falls[False],
        "hours_without_transports": hours[False],
        "fallen_after": [fall.model_dump() for one in found for fall in one.falls],
        "sent": dict(total(with_targets, "sent")),
        "answers": dict(states),
        "violations": violations,
        "missed_deadlines": sum(one.missed for one in found),
        "growth_in_ten_minutes": [
            {"clock": one.clock, "process": name, **asdict(own)}
            for one in found
            for name, own in sorted(one.growths.items())
        ],
        "parts": parts,
    }
    return Outcome(verdicts, figures)
