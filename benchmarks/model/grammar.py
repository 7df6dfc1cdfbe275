"""Does the robot do sequences, amounts and changes of speed, or say plainly that it does not?

Every sentence runs on the simulated robot, in lockstep, after two seconds of standing or six of the motion that it is
said in. What the robot did is judged by its true motion, request by request, between the moments at which its own
measurement ended them: a turn within 15° (long ones 12 %), a way within a quarter and 5 cm, footsteps that carry a foot
in the right direction (one more may close the stance), seconds within half a second, arms that go up and come back as
often as was said, a speed that changes by a tenth. A sentence counts as answered if it is done or plainly refused;
nothing may move for one that is to be refused. Without `does` in the file a sentence is judged by what its own answer
says, and a reader compares that with what was meant (--show).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.ndimage import uniform_filter1d
from scipy.signal import find_peaks

from benchmarks.shared.cells import share
from benchmarks.shared.options import BundleOption, CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import load_robot
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer import api
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.control.telemetry import Event
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.run.session import Session
from flexmotion.text.phrases import STAND
from flexmotion.text.vocabulary import vocabulary

Float = NDArray[np.float64]

SENTENCES = Path(__file__).parents[2] / "tests" / "flexmotion" / "text" / "data" / "requests.yaml"
ANSWERED = 0.9
"""Least share of sentences that are done or plainly refused."""
UNITS = {"deg": "angle", "m": "length", "steps": "steps", "s": "time", "times": "times"}

_READY_S, _AFTER_S, _OPEN_S, _LONGEST_S = 2.0, 6.0, 6.0, 200.0
"""Time before a sentence, of the motion that it is said in, of a motion without an end, of a sentence at most [s]."""
_TURN, _TURN_SHARE = np.radians(15.0), 0.12
_WAY_SHARE, _WAY_M = 0.25, 0.05
_TIME_S = 0.5
_STEP_M = 0.015
"""Way that a foot is carried in a step, in its direction [m]."""
_UP_RAD, _SWING_S = 0.3, 0.8
"""A gesture moves a joint away and back by this, in the mean over the second [rad, s]."""
_STILL_M, _STILL_RAD = 0.06, np.radians(12.0)
"""Greatest way and turn of a robot that stands."""
_CHANGE = 0.1
"""Least change of speed, as a share."""


@dataclass(frozen=True)
class Task:
    """One sentence, what it is said in, and what should happen (see `tests/.../requests.yaml`; `expect`: in words)."""

    say: str
    after: str | None = None
    does: tuple[tuple[str, ...], ...] | None = None
    refused: bool = False
    goes_on: bool = False
    dropped: tuple[str, ...] = ()
    speed: str | None = None
    expect: tuple[str, ...] = ()
    bundle: str | None = None
    seed: int = 1


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
        return _judge(task, session, heard, begin, end, [session.record.used if e < 0 else e for e in ends])


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


def _judge(task: Task, session: Session, heard: Heard, begin: int, end: int, ends: list[int]) -> Judged:
    record = session.record
    fell = bool((record.true_base[begin:end, 2] < 0.6 * np.nanmedian(record.true_base[begin - 50 : begin, 2])).any())
    seen = _Seen(record, begin, end)
    moved = seen.walked > _STILL_M or abs(seen.turned) > _STILL_RAD
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
    kinds = [step.heard_as for step in heard.steps] or [heard.heard_as]
    if [kind for kind, *_ in wanted] != kinds:
        judged.faults.append(f"heard as {', '.join(map(str, kinds))}")
        return judged
    if task.speed is not None:
        judged.faults += _speed_fault(record, begin, end, task.speed)
    missing = [part for part in task.dropped if part not in heard.dropped]
    judged.faults += [f"does not say that it dropped {part!r}" for part in missing]
    bounds = [begin, *ends[: len(wanted)]]
    bounds += [end] * (len(wanted) + 1 - len(bounds))
    for number, (kind, *amount) in enumerate(wanted):
        # The arms of the request before may still come down; the robot's own measurement ends it when it stands.
        if bounds[number + 1] - bounds[number] < 2:
            judged.faults.append(f"{kind}: never came to it")
            continue
        part = _Seen(record, bounds[number], bounds[number + 1])
        judged.figures.append(f"{kind}: {part.text()}")
        judged.faults += [f"{kind}: {fault}" for fault in part.faults(kind, amount[0] if amount else None)]
    judged.done = not judged.faults
    return judged


def _own(heard: Heard) -> tuple[tuple[str, ...], ...]:
    """What an answer says that the robot does."""
    units = {quantity: unit for unit, quantity in UNITS.items()}
    return tuple(
        (str(step.heard_as),)
        if step.amount is None or step.unit is None
        else (
            str(step.heard_as),
            f"{np.degrees(step.amount) if step.unit == 'angle' else step.amount} {units[step.unit]}",
        )
        for step in heard.steps
    )


class _Seen:
    """The robot's true motion between two ticks."""

    def __init__(self, record: RunTrace, begin: int, end: int) -> None:
        self.rate = record.rate_hz
        rows = record.rows[begin:end]
        base = rows["true_base"]
        yaw = continuous_heading(base[:, 3:])
        step = np.diff(base[:, :2], axis=0)
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        self.ahead = float((np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]).sum())
        self.aside = float((np.cos(middle) * step[:, 1] - np.sin(middle) * step[:, 0]).sum())
        self.turned, self.walked = float(yaw[-1] - yaw[0]), float(np.hypot(*(base[-1] - base[0])[:2]))
        self.seconds = (end - begin) / self.rate
        # The swings of a wave are shorter than the mean is long; a hand that comes down is longer down.
        deviation = np.abs(rows["true_q"] - rows["true_q"][0]).max(axis=1)
        self.deviation = uniform_filter1d(deviation, round(_SWING_S * self.rate))
        self._feet, self._contacts, self._yaw = rows["true_foot"], rows["contact_ref"], yaw

    def text(self) -> str:
        """Its figures in words."""
        return (
            f"{self.ahead:.2f} m ahead, {self.aside:.2f} m left, {np.degrees(self.turned):.0f}° left, "
            f"arms up {self.gestures()} times, {self.seconds:.1f} s"
        )

    def faults(self, kind: str, amount: str | None) -> list[str]:
        """What is wrong with a request's motion, in words."""
        table = vocabulary().table
        axis, turn = table["walks"].get(kind), table["turns"].get(kind, 0)
        value, unit = (None, None) if amount is None else (float(amount.split()[0]), amount.split()[1])
        wrong = []
        if turn:
            asked = np.radians(value) if unit == "deg" and value is not None else None
            wrong += self._turn_faults(turn, asked)
        elif axis is not None:
            wrong += self._way_faults(axis, value, unit)
        elif kind == STAND:
            still = self.walked <= _STILL_M and abs(self.turned) <= _STILL_RAD
            # Robots come to a stand first.
            wrong += [] if still or self.seconds > 3.0 or value is None else ["did not stand"]
        else:
            wrong += self._gesture_faults(value if unit == "times" else None)
        if unit == "s" and value is not None and abs(self.seconds - value) > _TIME_S + (2.0 if kind == STAND else 0.0):
            wrong.append(f"{self.seconds:.1f} s of {value:g} s")
        return wrong

    def _turn_faults(self, turn: int, asked: float | None) -> list[str]:
        turned = turn * self.turned
        if asked is None:
            return [] if turned > np.radians(30.0) else [f"turned {np.degrees(turned):.0f}°"]
        near = abs(turned - asked) <= max(_TURN, _TURN_SHARE * asked)
        return [] if near else [f"turned {np.degrees(turned):.0f}° of {np.degrees(asked):.0f}°"]

    def _way_faults(self, axis: Sequence[int], value: float | None, unit: str | None) -> list[str]:
        went = axis[0] * self.ahead + axis[1] * self.aside
        if unit == "m" and value is not None:
            near = abs(went - value) <= _WAY_SHARE * value + _WAY_M
            return [] if near else [f"went {went:.2f} m of {value:g} m"]
        if unit == "steps" and value is not None:
            steps = self.steps(axis)
            # A step sideways, and a single one, is one of each foot.
            fewest = 2 * value if axis[1] else value
            wrong = [] if fewest <= steps <= fewest + 1 else [f"{steps} footsteps for {value:g} steps"]
            return wrong + ([] if went > 0.01 else [f"went {went:.2f} m"])
        return [] if went > 0.02 else [f"went {went:.2f} m"]

    def steps(self, axis: Sequence[int]) -> int:
        """Footsteps that carried a foot in a direction of the torso."""
        count = 0
        for side in (0, 1):
            contact, foot = self._contacts[:, side].astype(bool), self._feet[:, side, :2]
            lifts = np.flatnonzero(contact[:-1] & ~contact[1:])
            lands = np.flatnonzero(~contact[:-1] & contact[1:])
            for lift in lifts:
                after = lands[lands > lift]
                if not len(after):
                    continue
                dx, dy = foot[after[0] + 1] - foot[lift]
                yaw = self._yaw[lift]
                ahead, aside = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
                count += int(axis[0] * ahead + axis[1] * aside > _STEP_M)
        return count

    def gestures(self) -> int:
        """How often a joint moved away from where it was, and back."""
        peaks, _ = find_peaks(np.concatenate([[0.0], self.deviation, [0.0]]), prominence=_UP_RAD)
        return len(peaks)

    def _gesture_faults(self, times: float | None) -> list[str]:
        count = self.gestures()
        if times is None:
            return [] if count else ["the arms and the trunk did not move"]
        return [] if count == times else [f"{count} of {times:g} times"]


def _speed_fault(record: RunTrace, begin: int, end: int, change: str) -> list[str]:
    """Compare the mean speed before a sentence with that after it."""
    ticks = int(3.0 * record.rate_hz)
    base = record.true_base[:, :2]
    before = float(np.hypot(*(base[begin] - base[begin - ticks])))
    after = float(np.hypot(*(base[end - 1] - base[end - 1 - ticks])))
    ratio = after / max(before, 1e-6)
    right = ratio > 1.0 + _CHANGE if change == "up" else ratio < 1.0 - _CHANGE
    return [] if right else [f"speed times {ratio:.2f}"]


def main(
    bundle: BundleOption = None,
    sentences: Annotated[Path, typer.Option(help="YAML: sentences, with what should happen.")] = SENTENCES,
    only: Annotated[str | None, typer.Option(help="Only sentences that contain this.")] = None,
    seed: Annotated[int, typer.Option(help="Of model and simulation.")] = 1,
    show: Annotated[bool, typer.Option("--show", help="Show what the robot did, request by request.")] = False,
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run all sentences."""
    tasks = [task for task in tasks_of(sentences, bundle, seed) if only is None or only in task.say]
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
