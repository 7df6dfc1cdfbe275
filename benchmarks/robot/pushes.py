"""Does the robot stay up when it is pushed, standing and walking, in any direction at any phase of a step?

In lockstep, nominal: the robot stands, or walks as the shipped model does. At equal parts of a gait cycle the run is
split, and the torso of each copy is pushed for .1 s in one direction. A robot is upright if it never tilts by 45° in
the seconds after the push. Beside the share upright stands the share of pushes that N-step capturability calls
recoverable (`benchmarks/shared/capturability.py`), from the true pose and speed at the push, with this robot's
shortest steps, its longest strides, its soles, and the time that its plan leaves the foot that swings. That is an upper
bound: a push acts on the torso, above the centre of mass, and turns the robot too. What is left for one that may not
turn is told beside it (`pushed_by`). A push before which the robot is on its way to a fall counts as all others.

`--search FOLDER` searches the robot's push correction (`configs/push_correction.py`) by CMA-ES for the given time, or
goes on with what is in the folder; the result is `FOLDER/push_correction.yaml`. It needs the extra `tune`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.robot.emergency_stop import UPRIGHT, WALKS, gait_cycle
from benchmarks.shared.branches import copied_memory, in_branch
from benchmarks.shared.capturability import Walker, steps_to_capture
from benchmarks.shared.cells import percent, share
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.drivers.registry import create
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.streamer import api
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.run.session import Session

STAND = "standing"
SIZES = {STAND: (0.3, 0.9, 1.2, 1.6), "walking": (0.3, 0.6, 0.9, 1.2)}
"""Impulses of robots that stand and that walk [N·s]."""
PUSHED_S = 0.1
"""How long a push lasts [s]."""
STOOD_S, WALKED_S, AFTER_S = 2.0, 3.0, 2.0
"""Time until the walk begins, of the walk before its pushes, and after a push [s]."""
STAND_CYCLE_S = 0.5
"""The pushes of a robot that stands are spread over the time between two plans, about [s]."""
SMALL, SMALL_STANDING, SMALL_WALKING, RECOVERABLE = 0.3, 0.98, 0.90, 0.95
"""Size of push [N·s] and share upright that is wanted; that of all recoverable pushes."""
SOLE_M = 0.002
"""Corners of a foot's boxes that are within this of the plane of its sole belong to the sole [m]."""
TURNED = 0.381966
"""Part of the step between two directions, or phases, by which those of the next seed are turned: none repeats."""


@dataclass(frozen=True)
class Trial:
    """One push.

    Attributes:
        walk: what the robot did.
        phase: of the gait cycle, in [0, 1), from the lift of the left foot.
        single: whether the robot stood on one foot.
        direction_deg: of the push, from the robot's heading, counterclockwise.
        size: impulse [N·s].
        steps: fewest steps that capture it, as if it acted at the centre of mass; -1: it is not recoverable.
        steps_unturned: likewise, of a robot that takes all of the moment as speed, and may not turn.
        steps_after: fewest steps that capture what the robot has become by its end; -1: none do.
        upright: the robot did not fall.
        landings: of feet, by plan, in the seconds after the push.
        violations: goals outside the servos' envelope.
    """

    walk: str
    seed: int
    phase: float
    single: bool
    direction_deg: float
    size: float
    steps: int
    steps_unturned: int
    steps_after: int
    upright: bool
    landings: int
    violations: int

    @property
    def recoverable(self) -> bool:
        """Whether N-step capturability calls it so."""
        return self.steps >= 0


def sole_of(robot: Robot) -> np.ndarray:
    """Half the length and width of the box around all that a foot stands on, of the smaller foot, (2,) [m].

    Plans keep to the box of the robot file, which may be smaller: OP3 stands on a wide and a long one.
    """
    model, found = robot.model, []
    ends = np.array(list(product((-1.0, 1.0), repeat=3)))
    for body, centre in zip(robot.foot_ids, robot.soles, strict=True):
        corners = []
        for geom in np.flatnonzero((model.geom_bodyid == body) & ((model.geom_contype | model.geom_conaffinity) != 0)):
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
            box = model.geom_aabb[geom, :3] + ends * model.geom_aabb[geom, 3:]
            corners.append(model.geom_pos[geom] + box @ rotation.reshape(3, 3).T - centre)
        away = np.abs(np.concatenate(corners))
        found.append(away[away[:, 2] <= SOLE_M, :2].max(axis=0))
    smaller: np.ndarray = np.min(found, axis=0)
    return smaller


def walker_of(session: Session) -> Walker:
    """What the steps of a session's robot can do."""
    retargeter = session.planner.retargeter
    gait, swings = session.robot.gait, retargeter.swings
    stride = swings.longest_stride
    return Walker(
        omega=retargeter.omega,
        step_s=swings.least_s + gait.double_support_min_s,
        sole=sole_of(session.robot),
        ahead=np.array([-stride, stride]),
        aside=np.array(gait.lateral),
    )


def pushed_by(driver: SimDriver, walker: Walker, impulse: np.ndarray, *, height: float) -> np.ndarray:
    """How far a push of `PUSHED_S` that begins now moves the divergent component, (2,) [m].

    A linear inverted pendulum has no angular momentum about its centre of mass. So all of the moment of a push about
    the ground, impulse times height, becomes that of its speed, mass times speed times height of the centre of mass: a
    push above that counts for more. A robot that lets its torso turn pays later, until the torso leans too far.

    Args:
        impulse: in the world frame, (2,) [N·s].
        height: above the ground at which it acts [m].
    """
    mass, com = driver.model.body_subtreemass[0], driver.data.subtree_com[0]
    # A push that lasts moves the pendulum as a shorter one at its begin does.
    lasts = walker.omega * PUSHED_S
    spread = float((1.0 - np.exp(-lasts)) / lasts)
    found: np.ndarray = impulse * spread * (height / com[2]) / (mass * walker.omega)
    return found


def needed_steps(session: Session, driver: SimDriver, impulse: np.ndarray, *, at_com: bool = False) -> int:
    """Fewest steps that capture a push from now on, by the robot's true state; -1: none do.

    Args:
        impulse: in the world frame, (2,) [N·s].
        at_com: the push acts at the centre of mass, not that of the torso.
    """
    walker, data, robot = walker_of(session), driver.data, session.robot
    mujoco.mj_subtreeVel(driver.model, data)
    com, speed = data.subtree_com[0], data.subtree_linvel[0]
    height = float(com[2] if at_com else data.xipos[robot.torso_id, 2])
    dcm = com[:2] + speed[:2] / walker.omega + pushed_by(driver, walker, impulse, height=height)
    truth = driver.truth()
    matrices = data.xmat[np.asarray(robot.foot_ids)].reshape(2, 3, 3)
    feet = np.column_stack([truth.foot_position[:, :2], np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])])
    contacts = session.state.contacts
    assert session.loop is not None
    plan, tick = session.loop.intake.plan, session.loop.tick_count
    if contacts.all() or plan is None:
        found = steps_to_capture(walker, dcm, feet, None, 0.0)
    else:
        swing = 0 if not contacts[0] else 1
        rows = plan.contacts[max(tick - plan.start_tick, 0) :, swing]
        found = steps_to_capture(walker, dcm, feet, swing, float(np.argmax(rows)) / robot.rate_hz)
    return -1 if found is None else found


def pushed(session: Session, walk: str, seed: int, phase: float, direction_deg: float, size: float) -> Trial:
    """Push the torso of a session now, and step it."""
    driver = session.driver
    assert isinstance(driver, SimDriver) and session.loop is not None
    forward = driver.data.xmat[session.robot.torso_id].reshape(3, 3)[:, 0]
    angle = np.arctan2(forward[1], forward[0]) + np.radians(direction_deg)
    x, y = size * np.cos(angle), size * np.sin(angle)
    steps, unturned = (needed_steps(session, driver, np.array([x, y]), at_com=at_com) for at_com in (True, False))
    single = not session.state.contacts.all()
    driver.push((float(x), float(y), 0.0), PUSHED_S)
    upright, landings, before, steps_after = True, 0, session.state.contacts, -1
    for tick in range(round(AFTER_S * session.robot.rate_hz)):
        if tick == round(PUSHED_S * session.robot.rate_hz):
            steps_after = needed_steps(session, driver, np.zeros(2))
        if not session.step() or driver.torso_up < UPRIGHT or session.state.ladder is State.DAMPED:
            upright = False
            break
        contacts = session.state.contacts
        landings += int((contacts & ~before).sum())
        before = contacts
    return Trial(
        walk,
        seed,
        phase,
        single,
        direction_deg,
        size,
        steps,
        unturned,
        steps_after,
        upright,
        landings,
        driver.violations,
    )


def moments(walk: str, seed: int, phases: int, robot: Robot) -> Iterator[tuple[Session, float]]:
    """A robot that stands or walks, at equal parts of a gait cycle: its session, and the phase in [0, 1)."""
    with copied_memory():
        opened = api.open_session(robot, create("sim", robot, seed=seed), seed=seed)
    with opened as session:
        session.advance(STOOD_S)
        ticks = round(STAND_CYCLE_S * robot.rate_hz)
        if walk != STAND:
            session.send(WALKS[walk])
            session.advance(WALKED_S)
            ticks = gait_cycle(session)
        begin = session.state.tick
        for number in range(phases):
            phase = (number + turned_by(seed)) / phases
            while session.state.tick < begin + round(phase * ticks):
                session.step()
            yield session, phase


def turned_by(seed: int) -> float:
    """Part of a step between two directions, or phases, in [0, 1)."""
    return (seed * TURNED) % 1.0


def push_all(
    task: tuple[str, int], phases: int, directions: int, sizes: Sequence[float], robot_name: str
) -> list[Trial]:
    """All pushes of one run."""
    walk, seed = task
    return [
        in_branch(partial(pushed, session, walk, seed, phase, 360.0 * (sector + turned_by(seed)) / directions, size))
        for session, phase in moments(walk, seed, phases, load_robot(robot_name))
        for size in sizes
        for sector in range(directions)
    ]


def search(folder: Path, robot_name: str, minutes: float, seed: int) -> None:
    """Search a push correction.

    Raises:
        ConfigError: the extra is missing.
    """
    if find_spec("cma") is None:
        raise ConfigError("--search needs the extra 'tune': in a clone, pip install '.[tune]'")
    from benchmarks.robot.learned.push_search import search_correction

    Console(stderr=True).print(f"written: {search_correction(load_robot(robot_name), folder, minutes, seed)}")


def main(
    robot: Annotated[str, typer.Option(help="Name or folder of the robot.")] = "op3",
    phases: Annotated[int, typer.Option(min=1, help="Moments of a gait cycle.")] = 5,
    directions: Annotated[int, typer.Option(min=1, help="Directions of pushes.")] = 6,
    walks: Annotated[list[str] | None, typer.Option("--walk", help="Only this one (repeatable).")] = None,
    size: Annotated[list[float] | None, typer.Option(help="Only this impulse [N·s] (repeatable).")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the first one: of motion, robot, phases and directions.")] = 0,
    search_in: Annotated[
        Path | None, typer.Option("--search", help="Search a push correction in this folder, and measure nothing.")
    ] = None,
    minutes: Annotated[float, typer.Option(min=0.0, help="Of this part of the search.")] = 60.0,
    jobs: JobsOption = 1,
    csv_out: CsvOption = None,
) -> Outcome:
    """Push in all directions, at all phases, with all sizes."""
    if search_in is not None:
        search(search_in, robot, minutes, seed)
        return Outcome()
    found: list[Trial] = []
    names = walks or [STAND, "ahead"]
    for walk in names:
        sizes = size or SIZES[STAND if walk == STAND else "walking"]
        # A third of the moments is enough for a robot that does not move.
        parts = (phases + 2) // 3 if walk == STAND else phases
        work = partial(push_all, phases=parts, directions=directions, sizes=sizes, robot_name=robot)
        tasks = [(walk, seed + number) for number in range(seeds)]
        found += [trial for trials in in_order(work, tasks, jobs) for trial in trials]
    console = Console(width=140)
    figures = {}
    for walk in names:
        own = [t for t in found if t.walk == walk]
        console.print(table(walk, own))
        figures[walk] = figures_of(own)
    if csv_out is not None:
        write_csv(csv_out, [asdict(t) for t in found])
    return Outcome(verdicts(found), figures)


QUARTERS = ("ahead", "left", "back", "right")
"""Directions within 45° of which a push is counted."""


def quarter(trial: Trial) -> str:
    """The direction of a push."""
    return QUARTERS[round(trial.direction_deg / 90.0) % 4]


def table(walk: str, trials: list[Trial]) -> Table:
    """One row a size: share upright, in all directions and in each.

    "Recoverable" knows the push before it begins. "At its end" is what the robot has become by then, before most of an
    answer: what is lost by then, no later answer wins back; that it turns, as walks do too, is left out. Behind both
    stands the share of these pushes upright.
    """
    names = (
        "N·s",
        "pushes",
        "upright",
        "recoverable",
        "upright",
        "at its end",
        "upright",
        *QUARTERS,
        "one foot",
        "two",
    )
    out = Table(*names, title=walk)
    for size in sorted({t.size for t in trials}):
        own = [t for t in trials if t.size == size]
        can = [t for t in own if t.recoverable]
        groups = [[t for t in own if quarter(t) == name] for name in QUARTERS]
        groups += [[t for t in own if t.single], [t for t in own if not t.single]]
        cells = [percent([t.upright for t in group]) for group in (own, can)]
        shares = [percent([t.upright for t in group]) for group in groups]
        left = [t for t in own if t.steps_after >= 0]
        cells += [percent([t.steps_after >= 0 for t in own]), percent([t.upright for t in left])]
        out.add_row(f"{size:g}", str(len(own)), cells[0], percent([t.recoverable for t in own]), *cells[1:], *shares)
    return out


def figures_of(trials: list[Trial]) -> dict[str, dict[str, float]]:
    """Shares by size."""
    found = {}
    for size in sorted({t.size for t in trials}):
        own = [t for t in trials if t.size == size]
        can = [t for t in own if t.recoverable]
        low = [t for t in own if t.steps_unturned >= 0]
        found[f"{size:g}"] = {
            "pushes": float(len(own)),
            "upright": share([t.upright for t in own]),
            "recoverable": share([t.recoverable for t in own]),
            "recoverable_upright": share([t.upright for t in can]),
            "recoverable_unturned": share([t.steps_unturned >= 0 for t in own]),
            "recoverable_unturned_upright": share([t.upright for t in low]),
            "recoverable_at_its_end": share([t.steps_after >= 0 for t in own]),
            "without_a_step": share([t.steps == 0 for t in own]),
            "landings": float(np.mean([t.landings for t in own])),
        }
    return found


def verdicts(trials: list[Trial]) -> list[Verdict]:
    """What is wanted."""
    found = []
    for name, wanted in ((STAND, SMALL_STANDING), ("walking", SMALL_WALKING)):
        small = [t.upright for t in trials if t.size == SMALL and (t.walk == STAND) == (name == STAND)]
        if small:
            text = f"{name}, {SMALL:g} N·s: upright {percent(small)} of {len(small)} (>= {100 * wanted:.0f} %)"
            found.append(Verdict(text, share(small) >= wanted))
    can = [t.upright for t in trials if t.recoverable]
    text = (
        f"of {len(can)} recoverable pushes ({len(trials)} in all) upright {percent(can)} (>= {100 * RECOVERABLE:.0f} %)"
    )
    left = [t.upright for t in trials if t.recoverable and t.steps_after >= 0]
    text += f"; of {len(left)} that are so when the push ends {percent(left)}"
    low = [t.upright for t in trials if t.steps_unturned >= 0]
    text += f"; of {len(low)} that are so for a robot that may not turn {percent(low)}"
    sent = sum(t.violations for t in trials)
    return [
        *found,
        Verdict(text, share(can) >= RECOVERABLE),
        Verdict(f"goals outside the envelope: {sent} (0)", sent == 0),
    ]
