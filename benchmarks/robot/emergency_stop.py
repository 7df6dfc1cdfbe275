"""Does a walking robot stay up after an emergency stop, at every phase of a step?

The robot walks as the shipped model does, in lockstep: ahead, fast and slow, back, aside, in a curve, on the spot.
After some seconds the run is split at equal parts of a gait cycle, from one lift of the left foot to the next. In each
part an emergency stop of each kind is asked for (`flexmotion.configs.robot_file.EmergencyStop`): the goals freeze, the
plan's own stop is played, or the way to the rest pose begins. A robot is upright if it never tilts by 45° until its
torque goes off. Judged is the kind that the robot file names.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, get_args

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.simulation import simulator
from benchmarks.shared.branches import copied_memory, in_branch
from benchmarks.shared.cells import share
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import load_robot
from flexmotion.configs.robot_file import EmergencyStop
from flexmotion.streamer import api
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

KINDS: tuple[EmergencyStop, ...] = get_args(EmergencyStop)
WALKS = {
    "ahead": Velocity(0.9, 0.0, 0.0),
    "ahead, slowly": Velocity(0.4, 0.0, 0.0),
    "back": Velocity(-0.4, 0.0, 0.0),
    "to the left": Velocity(0.0, 0.18, 0.0),
    "to the right": Velocity(0.0, -0.18, 0.0),
    "in a curve": Velocity(0.8, 0.0, 0.4),
    "turning": Velocity(0.0, 0.0, -0.5),
}
"""Velocities of the human."""
WALKED_S = 4.0
"""Time that it walks before [s]."""
LONGEST_CYCLE_S, UNEVEN_S = 4.0, 1.2
"""A walk whose left foot does not lift within the first has no steady gait; its stops are spread over the second, which
is about a gait cycle of the others [s]."""
AFTER_S = 8.0
"""Longest time from the stop until the torque is off [s]."""
UPRIGHT = float(np.cos(np.radians(45.0)))


@dataclass(frozen=True)
class Trial:
    """One emergency stop.

    Attributes:
        kind: what it does.
        phase: of the gait cycle, in [0, 1).
        single: whether the robot stood on one foot.
        upright: it never tilted by 45° until its torque was off.
        still_s: time from the stop until its centre of mass moved by less than 2 cm/s [s]; NaN: never.
        violations: goals outside the servos' envelope.
    """

    walk: str
    perturbed: bool
    seed: int
    kind: EmergencyStop
    phase: float
    single: bool
    upright: bool
    still_s: float
    violations: int


def stopped(session: Session, kind: EmergencyStop, walk: str, perturbed: bool, seed: int, phase: float) -> Trial:
    """Ask a session that walks for an emergency stop, and step it until the torque is off."""
    assert session.loop is not None
    limits = session.loop.ladder.limits
    session.loop.ladder.limits = limits.model_copy(update={"emergency_stop": kind})
    single = not session.state.contacts.all()
    begin, rate = session.state.tick, session.robot.rate_hz
    session.ask(Request.ESTOP)
    while session.state.tick < begin + AFTER_S * rate and session.step():
        pass
    record = session.record
    rows = record.ticks.tick > begin
    _, x, y, _ = record.true_base[rows, 3:].T
    speed = np.linalg.norm(np.diff(record.true_com[rows, :2], axis=0), axis=1) * rate
    moving = np.flatnonzero(speed > 0.02)
    parked = record.state[rows] == State.PARK
    calm = int(moving[moving < int(np.argmax(parked))].max(initial=-1)) + 1 if parked.any() else len(speed)
    return Trial(
        walk,
        perturbed,
        seed,
        kind,
        phase,
        single,
        upright=bool((1 - 2 * (x * x + y * y) > UPRIGHT).all()) and session.state.ladder is State.FAULT,
        still_s=float("nan") if calm >= len(speed) else calm / rate,
        violations=record.violations_sent,
    )


def gait_cycle(session: Session) -> int:
    """Step to a lift of the left foot; returns the ticks of a gait cycle.

    A sideways walk may pause for seconds between its steps: without two lifts it is `UNEVEN_S`, from where it stands.
    """
    first, second = _lift(session), _lift(session)
    return round(UNEVEN_S * session.robot.rate_hz) if first is None or second is None else second - first


def _lift(session: Session) -> int | None:
    """Step to the next lift of the left foot; returns its tick, None where it does not lift."""
    before = False
    for _ in range(round(LONGEST_CYCLE_S * session.robot.rate_hz)):
        stands = bool(session.state.contacts[0])
        if before and not stands:
            return session.state.tick
        before = stands
        session.step()
    return None


def walk_once(
    task: tuple[str, bool, int], phases: int, robot_name: str, kinds: tuple[EmergencyStop, ...]
) -> list[Trial]:
    """All stops of one walk."""
    walk, perturbed, seed = task
    robot = load_robot(robot_name)
    trials: list[Trial] = []
    with copied_memory():
        opened = api.open_session(robot, simulator(robot, perturbed, seed), seed=seed)
    with opened as session:
        session.advance(3.0)
        session.send(WALKS[walk])
        session.advance(WALKED_S)
        ticks = gait_cycle(session)
        begin = session.state.tick
        for number in range(phases):
            while session.state.tick < begin + round(number * ticks / phases):
                session.step()
            for kind in kinds:
                trials.append(in_branch(partial(stopped, session, kind, walk, perturbed, seed, number / phases)))
        session.finish()
    return trials


def table(groups: dict[tuple[EmergencyStop, bool, str], list[Trial]]) -> Table:
    """One row a kind, robot and walk."""
    out = Table("emergency stop", "robot", "walk", "upright", "of them on one foot", "still after [s]", title="by walk")
    for (kind, perturbed, walk), group in groups.items():
        single = [t for t in group if t.single]
        out.add_row(
            kind,
            "perturbed" if perturbed else "nominal",
            walk,
            _counted(group),
            _counted(single),
            f"{np.nanmedian([t.still_s for t in group]):.2f}" if any(np.isfinite(t.still_s) for t in group) else "",
        )
    return out


def _counted(group: list[Trial]) -> str:
    return f"{sum(t.upright for t in group)} of {len(group)}"


def main(
    robot: Annotated[str, typer.Option(help="Name or folder of the robot.")] = "op3",
    phases: Annotated[int, typer.Option(min=1, help="Moments of a gait cycle.")] = 12,
    walks: Annotated[list[str] | None, typer.Option("--walk", help="Only this walk (repeatable).")] = None,
    only: Annotated[list[str] | None, typer.Option("--kind", help="Only this emergency stop (repeatable).")] = None,
    perturbed: Annotated[bool, typer.Option("--perturbed/--nominal", help="Perturbed robots too.")] = True,
    jobs: JobsOption = 2,
    seed: Annotated[int, typer.Option(help="Of motion and robots.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Stop every walk at every phase, in each way."""
    kinds = tuple(kind for kind in KINDS if only is None or kind in only)
    names, robots = walks or list(WALKS), (False, True)[: 1 + perturbed]
    tasks = [(walk, hard, seed + number) for hard in robots for number, walk in enumerate(names)]
    done = [
        t
        for found in in_order(partial(walk_once, phases=phases, robot_name=robot, kinds=kinds), tasks, jobs)
        for t in found
    ]
    console, chosen = Console(), load_robot(robot).safety.emergency_stop
    by_walk = {
        (kind, hard, walk): [t for t in done if (t.kind, t.perturbed, t.walk) == (kind, hard, walk)]
        for kind in kinds
        for hard in robots
        for walk in names
    }
    console.print(table(by_walk))
    figures, verdicts = {}, []
    for kind in kinds:
        for hard in robots:
            group = [t for t in done if (t.kind, t.perturbed) == (kind, hard)]
            name = f"{kind}, {'perturbed' if hard else 'nominal'}"
            console.print(f"{name}: upright {_counted(group)}, on one foot {_counted([t for t in group if t.single])}")
            figures[name] = {
                "stops": float(len(group)),
                "upright": share([t.upright for t in group]),
                "violations": float(sum(t.violations for t in group)),
            }
    group = [t for t in done if t.kind == chosen and not t.perturbed]
    well = all(t.upright and not t.violations for t in group)
    if group:
        verdicts.append(Verdict(f"{robot}: {chosen}, nominal: upright {_counted(group)} (all)", well))
    if csv_out is not None:
        write_csv(csv_out, [asdict(t) for t in done])
    return Outcome(verdicts, figures)
