"""Are sequences, amounts and changes of speed heard as meant, or plainly refused?

Sentences are judged by their answers; `robot/sentences` runs them. A sentence is wrong where its motions, their order
or their amounts are others than the list says. One that could be done and is refused counts as refused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.cells import share
from benchmarks.shared.model import open_sampler
from benchmarks.shared.options import BundleOption
from benchmarks.shared.outcome import Outcome, Verdict
from benchmarks.shared.sentences import SENTENCES, UNITS, Task, tasks_of
from flexmotion.configs.robot import load_robot
from flexmotion.streamer.motion.hearing import Hearing
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.programs import Program
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.text.phrases import STAND

ANSWERED = 0.9
"""Least share of sentences that are heard as meant or plainly refused."""


def faults(task: Task, program: Program) -> list[str]:
    """What is wrong with an answer, in words; a refusal is never wrong but where the motion is to go on."""
    heard = program.heard
    if task.refused or task.goes_on:
        moves = any(step.kind != STAND for step in program.steps)
        wrong = [] if heard.state == "refused" else [f"not refused: {heard.heard_as}"]
        return wrong + ([] if moves == task.goes_on else ["moves" if moves else "does not go on"])
    if heard.state == "refused":
        return []
    wanted = task.does or ()
    kinds = [step.told.motion for step in program.steps]
    if kinds != [kind for kind, *_ in wanted]:
        return [f"heard as {', '.join(kinds)}"]
    wrong = [f"does not say that it dropped {part!r}" for part in task.dropped if part not in heard.dropped]
    for step, (kind, *amount) in zip(program.steps, wanted, strict=True):
        if not amount:
            continue
        value, unit = amount[0].split()
        size = float(value) * (0.017453292519943295 if unit == "deg" else 1.0)
        found = step.amount
        if found is None or found.quantity != UNITS[unit] or abs(found.value - size) > 1e-3 * max(size, 1.0):
            wrong.append(f"{kind}: {found} of {amount[0]}")
    return wrong


def main(
    bundle: BundleOption = None,
    sentences: Annotated[Path, typer.Option(help="YAML: sentences, with what should happen.")] = SENTENCES,
) -> Outcome:
    """Hear all sentences of a list."""
    sampler = open_sampler(bundle)
    hearing = Hearing(sampler, human_pace(load_robot("op3"), sampler.body))
    tasks = tasks_of(sentences, bundle, 0)
    table = Table("sentence", "state", "heard as", "", "what was wrong")
    marks: list[str] = []
    for task in tasks:
        before = None if task.after is None else hearing(Text(task.after))
        program = hearing(Text(task.say), before, before)
        wrong = faults(task, program)
        refused = program.heard.state == "refused" and not (task.refused or task.goes_on)
        marks.append("WRONG" if wrong else "refused" if refused else "as meant")
        said = task.say if task.after is None else f"{task.after} … {task.say}"
        told = str(program.heard.reason) if refused else "; ".join(wrong)
        table.add_row(said, program.heard.state, program.heard.heard_as or "-", marks[-1], told)
    Console(width=150).print(table)
    answered, meant = share([mark != "WRONG" for mark in marks]), share([mark == "as meant" for mark in marks])
    told = f"heard as meant or plainly refused: {100 * answered:.0f} % of {len(tasks)} (>= {100 * ANSWERED:.0f} %)"
    figures = {"sentences": len(tasks), "answered": answered, "as_meant": meant}
    return Outcome([Verdict(told, answered >= ANSWERED)], figures)
