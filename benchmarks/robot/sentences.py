"""Does the robot do sequences, amounts and changes of speed, or say plainly that it does not?

Every sentence runs on the simulated robot, in lockstep, after two seconds of standing or six of the motion that it is
said in. What the robot did is judged by its true motion (`shared/sentence_judge.py`), request by request, between the
moments at which its own measurement ended them. A sentence counts as answered if it is done or plainly refused; nothing
may move for one that is to be refused. Without `does` in the file a sentence is judged by what its own answer says, and
a reader compares that with what was meant (--show). By default only the sentences that stand for all run (`screen`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.shared.cells import share
from benchmarks.shared.gaze import LOOKS
from benchmarks.shared.options import BundleOption, CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from benchmarks.shared.sentence_judge import Seen, speed_fault
from benchmarks.shared.sentences import SENTENCES, UNITS, Task, tasks_of
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer import api
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.run.session import Session

ANSWERED = 0.9
"""Least share of sentences that are done or plainly refused."""

_READY_S, _AFTER_S, _OPEN_S, _LONGEST_S, _UNTWISTED_S = 2.0, 6.0, 6.0, 200.0, 1.0
"""Time before a sentence, of the motion that it is said in, of a motion without an end, of a sentence at most, and in
which a torso untwists after a turn [s]."""


@dataclass
class Judged:
    """What became of a sentence: `right` if it is done or plainly refused, as it should be."""

    say: str
    state: str
    heard_as: str
    done: bool
    refused: bool
    moved: bool
    upright: bool
    faults: list[str] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)

    @property
    def answered(self) -> bool:
        """Whether it was done, or plainly refused."""
        return self.upright and (self.done or (self.refused and not self.faults))


def run(task: Task) -> Judged:
    """Run one sentence and judge it."""
    robot = load_robot("op3")
    source = api.open_source(
        robot, Text("stand still"), bundle=None if task.bundle is None else Path(task.bundle), seed=task.seed
    )
    ends: list[int] = []

    def note(event: Event) -> None:
        if event.kind == "note" and any(f": {end}, " in event.message for end in ("done", "time limit")):
            ends.append(event.tick)

    with api.open_session(robot, "sim", source, seed=task.seed) as session:
        session.on_event = note
        session.advance(4.0 + _READY_S)
        if task.after is not None:
            session.send(Text(task.after))
            session.advance(_AFTER_S)
        ends.clear()
        begin, target = session.record.used, session.send(Text(task.say)).id
        session.advance(1.0)
        heard = _answer(session, target)
        _finish(session, target)
        end, heard = session.record.used, _answer(session, target)
        return _judge(task, robot, session, heard, begin, end, [session.record.used if e < 0 else e for e in ends])


def _answer(session: Session, target: int) -> Heard:
    return next(heard for heard in session.heard if heard.id == target)


def _finish(session: Session, target: int) -> None:
    """Step until every request is done, or for a while where one has no end."""
    heard = _answer(session, target)
    if heard.state == "refused" or any(step.amount is None for step in heard.steps):
        session.advance(_OPEN_S)
        return
    for _ in range(int(_LONGEST_S)):
        if not session.advance(1.0) or all(step.end is not None for step in _answer(session, target).steps):
            break
    session.advance(1.0)


def _judge(task: Task, robot: Robot, session: Session, heard: Heard, begin: int, end: int, ends: list[int]) -> Judged:
    record = session.record
    fell = bool((record.true_base[begin:end, 2] < 0.6 * np.nanmedian(record.true_base[begin - 50 : begin, 2])).any())
    seen = Seen(robot, record, begin, end)
    moved = seen.moved
    refused = heard.state == "refused"
    judged = Judged(task.say, heard.state, heard.heard_as or "-", False, refused, moved, not fell)
    judged.figures = [seen.text()] if refused else []
    judged.figures += [str(heard.reason)] if heard.reason else []
    if task.refused or (task.does is None and not task.goes_on and refused):
        judged.done = refused and not (moved and task.after is None)
        judged.faults += [] if refused else ["was not refused"]
        judged.faults += ["moved"] if moved and task.after is None else []
        return judged
    if task.goes_on:
        judged.done = refused and moved
        judged.faults += [] if judged.done else ["did not go on, or was not refused"]
        return judged
    if refused:
        return judged  # plainly
    wanted = _own(heard) if task.does is None else task.does
    kinds = [step.motion for step in heard.steps] or [str(heard.heard_as)]
    # A look is a direction of the head: the human does not move for it.
    looks = heard.heard_as == "head" and len(wanted) == 1 and wanted[0][0] in LOOKS
    if not looks and [kind for kind, *_ in wanted] != kinds:
        judged.faults.append(f"heard as {', '.join(map(str, kinds))}")
        return judged
    if task.speed is not None:
        judged.faults += speed_fault(record, begin, end, task.speed)
    missing = [part for part in task.dropped if part not in heard.dropped]
    judged.faults += [f"does not say that it dropped {part!r}" for part in missing]
    bounds = [begin, *ends[: len(wanted)]]
    bounds += [end] * (len(wanted) + 1 - len(bounds))
    for number, (kind, *amount) in enumerate(wanted):
        # The arms of the request before may still come down; the robot's own measurement ends it when it stands.
        if bounds[number + 1] - bounds[number] < 2:
            judged.faults.append(f"{kind}: never came to it")
            continue
        last = bounds[number + 1]
        if amount and amount[0].endswith("deg") and number == len(wanted) - 1:
            # It ends once the feet have turned; the torso, by which it is judged here, untwists over them afterwards.
            last = min(last + round(_UNTWISTED_S * record.rate_hz), end)
        part = Seen(robot, record, bounds[number], last)
        judged.figures.append(f"{kind}: {part.text()}")
        main, _, gesture = kind.partition(" with ")
        judged.faults += [f"{main}: {fault}" for fault in part.faults(main, amount[0] if amount else None)]
        judged.faults += [f"{gesture}: {fault}" for fault in (part.faults(gesture, None) if gesture else ())]
    judged.done = not judged.faults
    return judged


def _own(heard: Heard) -> tuple[tuple[str, ...], ...]:
    """What an answer says that the robot does."""
    units = {quantity: unit for unit, quantity in UNITS.items()}
    if heard.heard_as == "head" and not heard.steps:
        return (("head",),)
    return tuple(
        (step.motion,)
        if step.amount is None or step.unit is None
        else (
            step.motion,
            f"{np.degrees(step.amount) if step.unit == 'angle' else step.amount} {units[step.unit]}",
        )
        for step in heard.steps
    )


def main(
    bundle: BundleOption = None,
    sentences: Annotated[Path, typer.Option(help="YAML: sentences, with what should happen.")] = SENTENCES,
    every: Annotated[bool, typer.Option("--all", help="All sentences, not only those that stand for all.")] = False,
    only: Annotated[str | None, typer.Option(help="Only sentences that contain this.")] = None,
    seed: Annotated[int, typer.Option(help="Of model and simulation.")] = 1,
    show: Annotated[bool, typer.Option("--show", help="Show what the robot did, request by request.")] = False,
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run the sentences of a list."""
    tasks = [task for task in tasks_of(sentences, bundle, seed) if only is None or only in task.say]
    few = [task for task in tasks if task.screen]
    tasks = tasks if every or only is not None or not few else few
    results = in_order(run, tasks, jobs)
    table = Table(title="Sentences with sequences, amounts, changes of speed, and impossible ones")
    for column in ("sentence", "state", "heard as", "", "what was wrong"):
        table.add_column(column)
    for task, judged in zip(tasks, results, strict=True):
        mark = "done" if judged.done else "refused" if judged.answered else "WRONG"
        said = task.say if task.after is None else f"{task.after} … {task.say}"
        table.add_row(said, judged.state, judged.heard_as, mark, "; ".join(judged.faults))
        if show:
            told = [*(f"expected: {one}" for one in task.expect), *judged.figures]
            table.add_row("", "", "", "", "\n".join(told))
    Console(width=150).print(table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(judged) for judged in results])
    answered = share([judged.answered for judged in results])
    wrongly = [t.say for t, judged in zip(tasks, results, strict=True) if t.refused and judged.moved and not t.after]
    fell = [judged.say for judged in results if not judged.upright]
    verdicts = [
        Verdict(
            f"done or plainly refused: {100 * answered:.0f} % of {len(results)} (>= {100 * ANSWERED:.0f} %)",
            answered >= ANSWERED,
        ),
        Verdict(f"moved though impossible: {len(wrongly)} (0)", not wrongly),
        Verdict(f"fell: {len(fell)} (0)", not fell),
    ]
    done = share([judged.done for judged in results])
    return Outcome(verdicts, {"sentences": len(results), "answered": answered, "done": done, "moved": wrongly})
