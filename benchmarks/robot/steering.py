"""How long after the stick does the robot move, and after a STOP does it stand, at every phase of a step?

In lockstep, at the simulated robot's true pose. From a stand a velocity is asked for at several moments between two
plans; the robot moves once it has 10 % of the asked speed, in its own size. While it walks, at equal parts of a gait
cycle, a STOP is asked for in a copy of the run; the robot stands once both feet bear it and neither the centre of mass
nor the heading moves any more. Beside each time stands what it consists of: the plan's lead (that of the stream
settings here; about 35 ms on the wall clock, see `realtime/gateway`), the wait until the first foot lifts, and the
steps to the stop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.robot.emergency_stop import UPRIGHT, WALKS, gait_cycle
from benchmarks.robot.simulation import simulator
from benchmarks.shared.branches import copied_memory, in_branch
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.human.body import Body
from flexmotion.streamer import api
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Velocity
from flexmotion.streamer.motion.robot_pace import human_pace, human_scale
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

SHARE = 0.1
"""The robot moves from this share of the asked speed on."""
STOOD_S, WALKED_S, STOPPED_S = 3.0, 7.0, 6.0
"""Time until the stick, with it, and after a STOP [s]."""
STEADY_S = 3.0
"""The last part of a walk, whose speed is its own [s]."""
WINDOW_S, STAYS_S = 0.2, 1.0
"""Speed is a mean over the first; over the second it must stay, so that a sway counts for nothing [s]."""
STILL_M_S, STILL_RAD_S = 0.02, 0.1
"""A robot that stands moves less than this, over `WINDOW_S`."""


@dataclass(frozen=True)
class Start:
    """A stick from a stand.

    Attributes:
        walk: what was asked for.
        lead_s: until a plan that follows it plays [s].
        lifted_s: until the first foot lifts, by plan [s].
        moves_s: until the robot has 10 % of the asked speed [s]; NaN: never.
        settled_s: until it has 90 % of the speed that it keeps, as a mean over a gait cycle [s].
        kept: speed that it keeps over the asked one, over the last `STEADY_S`.
        upright: the robot did not fall.
    """

    walk: str
    lead_s: float
    lifted_s: float
    moves_s: float
    settled_s: float
    kept: float
    upright: bool


@dataclass(frozen=True)
class Stopped:
    """A STOP while the robot walks.

    Attributes:
        phase: of the gait cycle, in [0, 1), from the lift of the left foot.
        lead_s: until a plan that stops plays [s].
        steps: landings after the STOP.
        landed_s: until the last of them [s].
        stands_s: until the robot stands [s].
        hold_s: until the ladder is in HOLD [s].
        way_m, turn_rad: from the STOP to the stand.
    """

    walk: str
    phase: float
    lead_s: float
    steps: int
    landed_s: float
    stands_s: float
    hold_s: float
    way_m: float
    turn_rad: float
    upright: bool


def asked_at(robot: Robot, velocity: Velocity) -> tuple[float, float, float]:
    """A velocity of the human, slowed to the robot's pace, in the robot's size [m/s, rad/s]."""
    body = Body()
    pace, ratio = human_pace(robot, body), human_scale(robot, body)
    wanted = (velocity.forward, velocity.left, velocity.turning)
    forward, left, turning = wanted if pace is None else pace.slowed(wanted)
    return forward / ratio, left / ratio, turning


def way_along(record: RunTrace, asked: tuple[float, float, float], rows: slice) -> tuple[Float, float]:
    """The way of the torso in the asked direction of its own heading, or its turn, at each row; and the asked speed."""
    yaw = np.unwrap(torso_yaw(record.true_base[rows]))
    speed = float(np.hypot(asked[0], asked[1]))
    if speed == 0.0:
        return yaw * np.sign(asked[2]), abs(asked[2])
    step = np.diff(record.true_base[rows, :2], axis=0)
    middle = yaw[:-1]
    ahead = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
    left = -np.sin(middle) * step[:, 0] + np.cos(middle) * step[:, 1]
    along = (ahead * asked[0] + left * asked[1]) / speed
    return np.concatenate([[0.0], np.cumsum(along)]), speed


def torso_yaw(base: Float) -> Float:
    """Heading of poses (T, 7), (T,) [rad], within half a turn."""
    w, x, y, z = base[:, 3:].T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def stays_upright(base: Float) -> bool:
    """Whether no pose (T, 7) is tilted as a fallen robot is."""
    _, x, y, _ = base[:, 3:].T
    return bool((1 - 2 * (x * x + y * y) > UPRIGHT).all())


def _first(true: Any, rate: float) -> float:
    """Time of the first true value [s]; NaN without one."""
    found = np.flatnonzero(true)
    return float(found[0]) / rate if len(found) else float("nan")


def start_of(record: RunTrace, walk: str, asked: tuple[float, float, float], tick: int, target: int) -> Start:
    """What became of a stick that was moved at a tick."""
    rate = record.rate_hz
    begin = int(np.searchsorted(record.ticks.tick, tick))
    rows = slice(begin, None)
    way, speed = way_along(record, asked, rows)
    window, stays = round(WINDOW_S * rate), round(STAYS_S * rate)
    recent = np.concatenate([np.zeros(window), way[window:] - way[:-window]]) / WINDOW_S
    later = np.full(len(way), -np.inf)
    later[:-stays] = (way[stays:] - way[:-stays]) / STAYS_S
    steady = round(STEADY_S * rate)
    kept = float(way[-1] - way[-steady - 1]) / STEADY_S
    lifts = np.flatnonzero(np.diff(record.ticks.contact_ref[rows, 0].astype(int)) < 0)
    cycle = int(np.median(np.diff(lifts))) if len(lifts) > 2 else round(rate)
    mean = (way[cycle:] - way[:-cycle]) / (cycle / rate)  # at the middle of its cycle
    return Start(
        walk,
        lead_s=_first(record.ticks.target[rows] >= target, rate),
        lifted_s=_first(~record.ticks.contact_ref[rows].all(axis=1), rate),
        moves_s=_first((recent >= SHARE * speed) & (later >= SHARE * speed), rate),
        settled_s=_first(mean >= (1.0 - SHARE) * kept, rate) + 0.5 * cycle / rate,
        kept=kept / speed,
        upright=stays_upright(record.true_base[rows]),
    )


def stop_of(session: Session, walk: str, phase: float) -> Stopped:
    """Ask a session that walks for a STOP, and step it until it has stood for long."""
    begin, rate = session.state.tick, session.robot.rate_hz
    session.ask(Request.STOP)
    while session.state.tick < begin + STOPPED_S * rate and session.step():
        pass
    record = session.record
    rows = slice(int(np.searchsorted(record.ticks.tick, begin)), None)
    ticks, window = record.ticks, round(WINDOW_S * rate)
    landed = np.flatnonzero((np.diff(ticks.contact_ref[rows].astype(int), axis=0) > 0).any(axis=1))
    com, yaw = record.true_com[rows, :2], np.unwrap(torso_yaw(record.true_base[rows]))
    moving = np.linalg.norm(com[window:] - com[:-window], axis=1) > STILL_M_S * WINDOW_S
    moving |= np.abs(yaw[window:] - yaw[:-window]) > STILL_RAD_S * WINDOW_S
    last_landing = (int(landed[-1]) + 1) / rate if len(landed) else 0.0
    still = (int(np.flatnonzero(moving)[-1]) + 1 if moving.any() else 0) / rate
    stops = (ticks.asked_tick[rows] >= begin) & (ticks.plan[rows] != ticks.plan[rows][0])
    return Stopped(
        walk,
        phase,
        lead_s=_first(stops, rate),
        steps=len(landed),
        landed_s=last_landing,
        stands_s=max(last_landing, still),
        hold_s=_first(ticks.state[rows] == State.HOLD, rate),
        way_m=float(np.linalg.norm(com[-1] - com[0])),
        turn_rad=float(abs(yaw[-1] - yaw[0])),
        upright=stays_upright(record.true_base[rows]),
    )


def trials_of(walk: str, moments: int, phases: int, robot_name: str, seed: int) -> tuple[list[Start], list[Stopped]]:
    """All of one walk."""
    robot = load_robot(robot_name)
    asked = asked_at(robot, WALKS[walk])
    with copied_memory():
        session = api.open_session(robot, simulator(robot, False, seed), seed=seed)

    def start() -> Start:
        tick, target = session.state.tick, session.send(WALKS[walk])
        session.advance(WALKED_S)
        return start_of(session.record, walk, asked, tick, target.id)

    starts, stops = [], []
    with session:
        session.advance(STOOD_S)
        for _ in range(moments):
            starts.append(in_branch(start))
            session.advance(session.settings.replan_s / moments)
        if phases:
            session.send(WALKS[walk])
            session.advance(WALKED_S - STEADY_S)
            ticks, begin = gait_cycle(session), session.state.tick
            for number in range(phases):
                while session.state.tick < begin + round(number * ticks / phases):
                    session.step()
                stops.append(in_branch(partial(stop_of, session, walk, number / phases)))
        session.finish()
    return starts, stops


def percentiles(values: Sequence[float]) -> dict[str, float]:
    """p50, p90 and the greatest value; NaN where one is not known."""
    return dict(zip(("p50", "p90", "max"), map(float, np.percentile(values, (50, 90, 100))), strict=True))


def _table(title: str, groups: dict[str, list[Any]], columns: dict[str, tuple[str, str]]) -> Table:
    """A row a walk, and all: p50, p90 and the greatest of each column."""
    out = Table("walk", *columns, title=f"{title}: p50 / p90 / max")
    for walk, group in {**groups, "all": [one for own in groups.values() for one in own]}.items():
        cells = []
        for name, form in columns.values():
            found = percentiles([float(getattr(one, name)) for one in group])
            cells.append(" / ".join(format(value, form) for value in found.values()))
        out.add_row(walk, *cells)
    return out


def main(
    walks: Annotated[list[str] | None, typer.Option("--walk", help="Walks; all without.")] = None,
    moments: Annotated[int, typer.Option(min=1, help="Starts of each walk, at moments between two plans.")] = 6,
    phases: Annotated[int, typer.Option(min=0, help="Stops of each walk, at phases of its gait cycle.")] = 12,
    robot: Annotated[str, typer.Option("--robot", help="Robot.")] = "op3",
    jobs: JobsOption = 1,
    seed: Annotated[int, typer.Option(help="Of the model and the robot.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Start and stop each walk, and measure."""
    unknown = set(walks or ()) - set(WALKS)
    if unknown:
        raise typer.BadParameter(f"--walk {', '.join(sorted(unknown))}: expected some of {', '.join(WALKS)}")
    chosen = walks or list(WALKS)
    measured = partial(trials_of, moments=moments, phases=phases, robot_name=robot, seed=seed)
    found = dict(zip(chosen, in_order(measured, chosen, jobs), strict=True))
    starts = {walk: own[0] for walk, own in found.items()}
    stops = {walk: own[1] for walk, own in found.items()}
    columns = {
        "plan's lead [s]": ("lead_s", ".2f"),
        "first lift [s]": ("lifted_s", ".2f"),
        "10 % of the asked speed [s]": ("moves_s", ".2f"),
        "90 % of the kept one [s]": ("settled_s", ".2f"),
        "kept / asked": ("kept", ".2f"),
    }
    console = Console(width=140)
    console.print(_table("Stick, from a stand", starts, columns))
    every_start = [one for group in starts.values() for one in group]
    every_stop = [one for group in stops.values() for one in group]
    if every_stop:
        columns = {
            "plan's lead [s]": ("lead_s", ".2f"),
            "steps": ("steps", ".0f"),
            "last landing [s]": ("landed_s", ".2f"),
            "stands [s]": ("stands_s", ".2f"),
            "HOLD [s]": ("hold_s", ".2f"),
            "way [m]": ("way_m", ".3f"),
        }
        console.print(_table("STOP while it walks", stops, columns))
    if csv_out is not None:
        rows = [{"what": "stick", **asdict(one)} for one in every_start]
        keys = dict.fromkeys([*rows[0], *(asdict(every_stop[0]) if every_stop else ())])
        rows += [{"what": "STOP", **asdict(one)} for one in every_stop]
        write_csv(csv_out, [{key: row.get(key, "") for key in keys} for row in rows])
    fell = sum(not one.upright for one in every_start) + sum(not one.upright for one in every_stop)
    never = sum(not np.isfinite(one.moves_s) for one in every_start)
    standing = sum(one.stands_s < STOPPED_S - 2 * WINDOW_S for one in every_stop)
    verdicts = [
        Verdict(f"falls: {fell} of {len(every_start) + len(every_stop)} (0)", fell == 0),
        Verdict(f"the stick moves the robot: {len(every_start) - never} of {len(every_start)}", never == 0),
        Verdict(f"stands after STOP: {standing} of {len(every_stop)}", standing == len(every_stop)),
    ]
    return Outcome(verdicts, {"stick": _figures(starts), "stop": _figures(stops)})


def _figures(groups: dict[str, list[Any]]) -> dict[str, dict[str, dict[str, float]]]:
    return {
        walk: {
            name: percentiles([float(getattr(one, name)) for one in group])
            for name in asdict(group[0])
            if name not in ("walk", "phase", "upright")
        }
        for walk, group in groups.items()
        if group
    }
