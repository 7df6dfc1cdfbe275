"""Does a robot that bows as deep as its file allows stand up again, whatever ends the bow, and is a fall noticed?

A clip's human bows at least as deep as the robot's `safety.bow_tilt`, holds it and straightens up; the robot follows in
lockstep, its clip's way slow and fast. At moments from the first lean to the last the run is split: an operator stops
it, stops it at once, disarms it, its IMU's cable is pulled, or a hand pushes it from behind and from ahead; or nothing
happens. A robot has toppled if it is tilted further than its plan (`flexmotion/spatial/tilt.py`) before its torque is
off. Other pushes throw it over, to each side, and while it parks after an emergency stop: each fall must be noticed.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated

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
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.importers.default_clip import Script, build_clip
from flexmotion.spatial.tilt import tilt_of
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_totals import toppled
from flexmotion.streamer.motion.sources import ClipSource
from flexmotion.streamer.run.requests import Request
from flexmotion.streamer.run.session import Session

DEPTHS, SECONDS = (55.0, 85.0), (0.6, 1.2)
"""Pitches of the trunk [degrees], and times in which the human reaches them [s]."""
FIRST_S, HELD_S, AFTER_S = 1.0, 0.8, 2.5
"""The human stands, holds the bow, and stands again for so long [s]."""
REQUESTS = {"stop": Request.STOP, "emergency stop": Request.ESTOP, "disarm": Request.DISARM}
PUSHES = {
    "push ahead": (0.3, 0.0),
    "push back": (-0.3, 0.0),
    "thrown ahead": (4.0, 0.0),
    "thrown back": (-4.0, 0.0),
    "thrown left": (0.0, 4.0),
    "thrown right": (0.0, -4.0),
    "thrown as it parks": (2.0, 0.0),
}
"""Impulses of a hand at the torso, ahead and to the left [N·s]; no robot of this size stands those of throws."""
EVENTS = ("nothing", *REQUESTS, "no IMU", *PUSHES)
PUSH_S = 0.1
"""Time of a push [s]."""
PARKS_S = 1.5
"""After an emergency stop the robot is on its way to rest [s]."""
WATCHED_S = 6.0
"""Longest time that a run is watched after an event [s]."""
LIES = np.radians(60.0)
"""Tilt of a torso that lies once it has come to rest, on whatever it lies [rad]; parked ones lean by 30 degrees."""
NOTICED_DEG = 80.0
"""Tilt at which a fall is noticed at the latest."""


@dataclass(frozen=True)
class Trial:
    """One bow that one event meets.

    Attributes:
        pitch_deg: of the torso at the event.
        deepest_deg: greatest tilt before the torque was off.
        beyond_deg: how much further than its plan it was tilted at most, upright parts left out.
        upright: it never toppled before its torque was off.
        lies: whether it lay in the end.
        noticed_deg: tilt at which its fall was noticed, or that at the end where none was; NaN: it did not lie.
        touches: ticks in which the robot touched itself before its torque was off.
        violations: goals outside the servos' envelope.
    """

    depth_deg: float
    seconds: float
    perturbed: bool
    seed: int
    event: str
    pitch_deg: float
    deepest_deg: float
    beyond_deg: float
    upright: bool
    lies: bool
    noticed_deg: float
    touches: int
    violations: int


def bowing(depth_deg: float, seconds: float) -> Motion:
    """A human with hanging arms who bows, holds the bow, and straightens up; hips and back bend."""
    down, held = FIRST_S + seconds, FIRST_S + seconds + HELD_S
    end = held + seconds

    def keys(angle: float) -> list[tuple[float, float]]:
        return [(0.0, 0.0), (FIRST_S, 0.0), (down, angle), (held, angle), (end, 0.0)]

    hips = 0.6 * depth_deg
    script = Script(
        fps=30.0,
        seconds=end + AFTER_S,
        joints={"lumbar_extension": keys(hips - depth_deg)}
        | {f"shoulder_adduction_{side}": [(0.0, -8.0)] for side in "lr"},
        pelvis_tilt=keys(hips),
        pelvis_drop=[(0, 0.02)],
        clearance=0.09,
        steps=[],
    )
    return build_clip(script, Body())


def pull_imu(driver: SimDriver) -> None:
    """From now on the IMU does not answer."""
    read, missed = driver.read, 0

    def silent(state: RobotState) -> None:
        nonlocal missed
        missed += 1
        read(state)
        state.imu_stale = missed

    setattr(driver, "read", silent)  # noqa: B010


def met(session: Session, event: str, depth_deg: float, seconds: float, perturbed: bool, seed: int) -> Trial:
    """Let an event meet a session that bows, and watch it until the torque is off, or it stands again."""
    begin, rate = session.state.tick, session.robot.rate_hz
    pitch = float(np.degrees(tilt_of(session.record.true_base[-1, 3:])))
    if event in REQUESTS:
        session.ask(REQUESTS[event])
    driver = session.driver
    assert isinstance(driver, SimDriver)
    if event == "thrown as it parks":
        session.ask(Request.ESTOP)
        session.advance(PARKS_S)
    if event in PUSHES:
        driver.push((*PUSHES[event], 0.0), PUSH_S)
    if event == "no IMU":
        pull_imu(driver)
    while session.state.tick < begin + WATCHED_S * rate and session.step():
        pass
    record = session.record
    rows = slice(begin, record.used)
    held = np.isin(record.state[rows], (State.OFF, State.FAULT)).argmax() or record.used - begin
    base, planned = record.true_base[rows][:held], record.base_ref[rows][:held]
    lean = tilt_of(base[:, 3:])
    wanted = tilt_of(planned[:, 3:])
    bends = wanted > np.radians(30.0)
    beyond = (lean - wanted)[bends]
    every = tilt_of(record.true_base[rows, 3:])
    lies = bool(every[-1] > LIES)
    noticed = np.flatnonzero(record.state[rows] == State.DAMPED)
    return Trial(
        depth_deg,
        seconds,
        perturbed,
        seed,
        event,
        pitch_deg=pitch,
        deepest_deg=float(np.degrees(lean.max())),
        beyond_deg=float(np.degrees(beyond.max())) if len(beyond) else 0.0,
        upright=not toppled(base, planned).any(),
        lies=lies,
        noticed_deg=float(np.degrees(every[noticed[0] if len(noticed) else -1])) if lies else float("nan"),
        touches=int(np.count_nonzero(record.true_self_contact[rows][:held])),
        violations=record.violations_sent,
    )


def bow_once(task: tuple[float, float, bool, int], moments: int, robot_name: str) -> list[Trial]:
    """All events of one bow, at moments from its first lean to its end."""
    depth_deg, seconds, perturbed, seed = task
    robot, source = load_robot(robot_name), ClipSource(bowing(depth_deg, seconds))
    trials: list[Trial] = []
    with copied_memory():
        opened = Session(robot, simulator(robot, perturbed, seed), source, load_stream(), source.seconds)
    with opened as session:
        while not np.isfinite(session.record.source_s[-1:]).any() or session.record.source_s[-1] < FIRST_S:
            session.step()
        begin, ticks = session.state.tick, (2 * seconds + HELD_S + 0.4) * robot.rate_hz
        for number in range(moments):
            while session.state.tick < begin + round((number + 0.5) / moments * ticks):
                session.step()
            for event in EVENTS:
                trials.append(in_branch(partial(met, session, event, *task)))
        session.finish()
    return trials


def table(done: list[Trial]) -> Table:
    """One row an event and robot."""
    out = Table(
        "event",
        "robot",
        "upright",
        "deepest °",
        "beyond its plan °",
        "fell",
        "noticed at °",
        "touches itself",
        "outside",
    )
    for event in EVENTS:
        for hard in (False, True):
            group = [t for t in done if t.event == event and t.perturbed == hard]
            if not group:
                continue
            late = [t.noticed_deg for t in group if t.lies]
            out.add_row(
                event,
                "perturbed" if hard else "nominal",
                f"{sum(t.upright for t in group)} of {len(group)}",
                f"{max(t.deepest_deg for t in group):.0f}",
                f"{max((t.beyond_deg for t in group if t.upright), default=0.0):.1f}",
                str(len(late)),
                f"{max(late):.0f}" if late else "",
                f"{sum(t.touches for t in group)} ticks",
                str(sum(t.violations for t in group)),
            )
    return out


def main(
    robot: Annotated[str, typer.Option(help="Name or folder of the robot.")] = "op3",
    moments: Annotated[int, typer.Option(min=1, help="Moments of a bow.")] = 6,
    seeds: Annotated[int, typer.Option(min=1, help="Perturbed robots of each bow.")] = 2,
    jobs: JobsOption = 2,
    seed: Annotated[int, typer.Option(help="Of the first robot.")] = 0,
    csv_out: CsvOption = None,
) -> Outcome:
    """Meet every bow with every event."""
    bows = [(depth, seconds) for depth in DEPTHS for seconds in SECONDS]
    tasks = [(*bow, number > 0, seed + 100 * at + number) for at, bow in enumerate(bows) for number in range(seeds + 1)]
    runs = in_order(partial(bow_once, moments=moments, robot_name=robot), tasks, jobs)
    done = [trial for found in runs for trial in found]
    Console(width=120).print(table(done))
    stays = [t for t in done if not t.event.startswith("thrown")]
    fell = [t for t in done if t.lies]
    verdicts = []
    for hard in (False, True):
        up = [t.upright for t in stays if t.perturbed == hard]
        verdicts.append(Verdict(f"{'perturbed' if hard else 'nominal'}: upright {sum(up)} of {len(up)} (all)", all(up)))
    late = max((t.noticed_deg for t in fell), default=0.0)
    verdicts.append(
        Verdict(f"{len(fell)} falls noticed at {late:.0f}° at the latest (<= {NOTICED_DEG:g})", late <= NOTICED_DEG)
    )
    outside = sum(t.violations for t in stays)
    verdicts.append(Verdict(f"goals outside the envelope: {outside} (0)", outside == 0))
    if csv_out is not None:
        write_csv(csv_out, [asdict(t) for t in done])
    beyond = max((t.beyond_deg for t in stays if t.upright), default=0.0)
    figures = {"upright": share([t.upright for t in stays]), "beyond_deg": beyond, "noticed_deg": late}
    return Outcome(verdicts, figures)
