"""Does a hand press less on an obstacle where arms follow the human's tension, and what does that cost the tracking?

In lockstep on the simulated OP3. Each gesture is done three times: freely; and twice with a plate across the way of a
hand, where the free hand was when it had gone half of its way, and most of it. With a plate and without it, arms and
head follow stiffly (`least_stiffness` 1) and by tension (that of the robot file, or `--least`). The force is that of
MuJoCo's contacts at the plate in every physics step: its greatest value in the first 50 ms, the impact, and its mean
from then until half a second after the first touch, the pressing. A hand that slips past the plate, stiff, presses not
at all, and is left out of the latter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated, Any

import mujoco
import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.robot.hand_targets import Measured
from benchmarks.robot.model_run import sampler_of
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.drivers.sim.driver import SimDriver
from flexmotion.drivers.sim.options import Plate, SimOptions
from flexmotion.drivers.sim.world import plate_name
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Text
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.robot_pace import human_pace
from flexmotion.streamer.motion.script import Item
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

STIFF, TENSION = "stiff", "by tension"
GESTURES = {
    "wave with the right hand": "right",
    "wave with both hands": "left",
    "raise both arms": "right",
    "salute": "right",
    "point ahead with the right hand": "right",
    "walk forward": "left",
}
"""Prompt -> the hand that meets the plate."""
PARTS = (0.5, 0.8)
"""Share of a hand's greatest distance from where it began, at which the plate is in its way."""
SECONDS, FREE_SECONDS = 5.0, 8.0
"""Lengths of runs with a plate, and of free ones [s]."""
AHEAD_M = 0.02
"""From the hand's point to the plate's face: the forearm's radius and some more [m]."""
IMPACT_S, PRESSES_S = 0.05, 0.5
SLIPPED = 0.5
"""A hand that touches the plate for less than this share of `PRESSES_S` has slipped past it."""
LESS, HARDER, TRACKING_DEG = 0.8, 1.1, 1.0
"""What has to hold: pressing and impact over those of stiff arms, mean tracking error of arms and head [°]."""


@dataclass(frozen=True)
class Touch:
    """One hand at one plate.

    Attributes:
        gesture: the prompt; part: of the hand's way; way: `STIFF` or `TENSION`.
        impact_n: greatest force in the first 50 ms [N]; 0: it did not touch the plate.
        presses_n: mean force from there to half a second after the first touch [N].
        touches: share of that half second in which it touches the plate.
        stiffness: mean of the arm's share of its stiffness in it.
        upright: the robot did not fall.
        violations: goals outside the envelope.
    """

    gesture: str
    part: float
    way: str
    impact_n: float
    presses_n: float
    touches: float
    stiffness: float
    upright: bool
    violations: int


@dataclass(frozen=True)
class Free:
    """One gesture without a plate.

    Attributes:
        gesture, way: see `Touch`.
        tracking_deg: RMS error of the joints of arms and head against their reference [°].
        stiffness: mean share of their stiffness.
        upright, violations: see `Touch`.
    """

    gesture: str
    way: str
    tracking_deg: float
    stiffness: float
    upright: bool
    violations: int


class Watched(SimDriver):
    """Measures the force at its first plate in every physics step.

    Attributes:
        forces: of the steps so far [N].
    """

    def __init__(self, robot: Robot, options: SimOptions) -> None:
        super().__init__(robot, options=options)
        self.forces: list[float] = []
        self._seconds = options.timestep
        self._plate = self.model.geom(plate_name(0)).id if options.plates else -1
        self._wrench = np.zeros(6)

    def advance(self, seconds: float) -> None:
        """See `LockstepDriver`."""
        for _ in range(round(seconds / self._seconds)):
            super().advance(self._seconds)
            total = 0.0
            for number in range(self.data.ncon):
                contact = self.data.contact[number]
                if self._plate in (contact.geom1, contact.geom2):
                    mujoco.mj_contactForce(self.model, self.data, number, self._wrench)
                    total += float(np.linalg.norm(self._wrench[:3]))
            self.forces.append(total)


def _yielding(robot_name: str, least: float) -> Robot:
    robot = load_robot(robot_name)
    robot.config = robot.config.model_copy(update={"least_stiffness": least})
    return robot


def _run(robot: Robot, prompt: str, seed: int, seconds: float, plate: Plate | None) -> tuple[RunTrace, Watched]:
    sampler = sampler_of(None)
    source = ModelSource(
        sampler, [Item(0.0, Text(prompt))], prompt, seed, seconds + 5.0, human_pace(robot, sampler.body)
    )
    driver = Watched(robot, SimOptions(seed=seed, plates=() if plate is None else (plate,)))
    return Session(robot, driver, source, load_stream(), seconds).run(), driver


def _upright(record: RunTrace) -> bool:
    x, y = record.true_base[:, 4:6].T
    tilted = 1.0 - 2.0 * (x * x + y * y) < np.cos(np.radians(45.0))
    return not bool((tilted & (record.ticks.state != State.FAULT)).any())


def _hands(robot: Robot, record: RunTrace, side: str) -> Float:
    """Way of a hand through the world, (T, 3) [m]."""
    measured, places = Measured(robot), np.empty((len(record.true_q), 3))
    for row, (base, q) in enumerate(zip(record.true_base, record.true_q, strict=True)):
        measured.pose(q)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, base[3:])
        places[row] = base[:3] + turn.reshape(3, 3) @ measured.hand(side)
    return places


def plates(robot: Robot, record: RunTrace, side: str) -> list[Plate]:
    """A plate for each of `PARTS`, across the way of a hand in a free run."""
    places = _hands(robot, record, side)
    plays = np.flatnonzero(np.isfinite(record.source_s))
    away = np.linalg.norm(places - places[plays[0]], axis=1)
    found = []
    for part in PARTS:
        row = int(plays[np.argmax(away[plays] >= part * away[plays].max())])
        way = places[row + 2] - places[row - 2]
        way /= np.linalg.norm(way)
        x, y, z = map(float, places[row] + AHEAD_M * way)
        found.append(Plate(position=(x, y, z), normal=(-float(way[0]), -float(way[1]), -float(way[2]))))
    return found


def gesture(prompt: str, robot_name: str, leasts: dict[str, float], seed: int) -> tuple[list[Free], list[Touch]]:
    """All runs of one gesture, each in every way of following: way -> least stiffness."""
    side = GESTURES[prompt]
    robots = {way: _yielding(robot_name, least) for way, least in leasts.items()}
    freely: list[Free] = []
    obstacles: list[Plate] = []
    for way, robot in robots.items():
        record, _ = _run(robot, prompt, seed, FREE_SECONDS, None)
        upper = [joint for limb in ("left_arm", "right_arm", "head") for joint in robot.chain(limb).values()]
        plays = np.isfinite(record.source_s)
        error = (record.true_q - record.ticks.q_ref)[plays][:, upper]
        freely.append(
            Free(
                prompt,
                way,
                tracking_deg=float(np.degrees(np.sqrt((error**2).mean()))),
                stiffness=float(record.ticks.stiffness[plays][:, upper].mean()),
                upright=_upright(record),
                violations=record.violations_sent,
            )
        )
        obstacles = obstacles or plates(robot, record, side)
    touches = [
        _touch(robot, prompt, seed, plate, replace(_NO_TOUCH, gesture=prompt, part=part, way=way))
        for part, plate in zip(PARTS, obstacles, strict=True)
        for way, robot in robots.items()
    ]
    return freely, touches


_NO_TOUCH = Touch("", 0.0, "", 0.0, 0.0, 0.0, float("nan"), True, 0)


def _touch(robot: Robot, prompt: str, seed: int, plate: Plate, named: Touch) -> Touch:
    """A run with a plate: `named` with what was measured."""
    record, driver = _run(robot, prompt, seed, SECONDS, plate)
    forces, timestep = np.array(driver.forces), driver.model.opt.timestep
    named = replace(named, upright=_upright(record), violations=record.violations_sent)
    if not forces.any():
        return named
    first = int(np.argmax(forces > 0.0))
    half = forces[first : first + round(PRESSES_S / timestep)]
    impact = round(IMPACT_S / timestep)
    tick = int(first * timestep * robot.rate_hz)
    arm = list(robot.chain(f"{GESTURES[prompt]}_arm").values())
    shares = record.ticks.stiffness[tick : tick + round(PRESSES_S * robot.rate_hz), arm]
    return replace(
        named,
        impact_n=float(half[:impact].max()),
        presses_n=float(half[impact:].mean()),
        touches=float((half > 0.0).mean()),
        stiffness=float(np.nanmean(shares)),
    )


def figures(freely: Sequence[Free], touches: Sequence[Touch]) -> dict[str, Any]:
    """Figures by way of following, and those of the touches."""
    stays = {(t.gesture, t.part) for t in touches if t.way == STIFF and t.touches >= SLIPPED}
    found: dict[str, Any] = {}
    for way in (STIFF, TENSION):
        free, own = [f for f in freely if f.way == way], [t for t in touches if t.way == way]
        held = [t for t in own if (t.gesture, t.part) in stays]
        found[way] = {
            "tracking_deg": float(np.mean([f.tracking_deg for f in free])),
            "worst_tracking_deg": max(f.tracking_deg for f in free),
            "stiffness": float(np.mean([f.stiffness for f in free])),
            "touched": sum(t.impact_n > 0.0 for t in own),
            "impact_n": float(np.mean([t.impact_n for t in own if t.impact_n > 0.0] or [0.0])),
            "pressed": len(held),
            "presses_n": float(np.mean([t.presses_n for t in held] or [0.0])),
            "upright_freely": sum(f.upright for f in free),
            "upright_at_plates": sum(t.upright for t in own),
            "violations": sum(f.violations for f in free) + sum(t.violations for t in own),
        }
    return found


def verdicts(found: dict[str, Any], gestures: int) -> list[Verdict]:
    """What has to hold."""
    stiff, tension = found[STIFF], found[TENSION]
    presses = tension["presses_n"] / stiff["presses_n"] if stiff["presses_n"] else float("nan")
    impact = tension["impact_n"] / stiff["impact_n"] if stiff["impact_n"] else float("nan")
    freely = stiff["upright_freely"] + tension["upright_freely"]
    sent = stiff["violations"] + tension["violations"]
    return [
        Verdict(
            f"pressing {tension['presses_n']:.1f} N, stiff {stiff['presses_n']:.1f} N, of {stiff['pressed']} hands: "
            f"{presses:.2f} (<= {LESS})",
            presses <= LESS,
        ),
        Verdict(
            f"impact {tension['impact_n']:.0f} N, stiff {stiff['impact_n']:.0f} N: {impact:.2f} (<= {HARDER})",
            impact <= HARDER,
        ),
        Verdict(
            f"tracking of arms and head {tension['tracking_deg']:.2f}°, stiff {stiff['tracking_deg']:.2f}° "
            f"(<= {TRACKING_DEG})",
            tension["tracking_deg"] <= TRACKING_DEG,
        ),
        Verdict(f"upright without a plate: {freely} of {2 * gestures} (all)", freely == 2 * gestures),
        Verdict(
            f"upright at plates: {tension['upright_at_plates']} of {len(PARTS) * gestures}, "
            f"stiff {stiff['upright_at_plates']} (no fewer)",
            tension["upright_at_plates"] >= stiff["upright_at_plates"],
        ),
        Verdict(f"goals outside the envelope: {sent} (0)", sent == 0),
    ]


def main(
    robot: Annotated[str, typer.Option(help="Name or folder of the robot.")] = "op3",
    least: Annotated[
        float | None, typer.Option(min=0.1, max=1.0, help="Least stiffness; default: the robot file's.")
    ] = None,
    gestures: Annotated[list[str] | None, typer.Option("--gesture", help="Only this one (repeatable).")] = None,
    jobs: JobsOption = 1,
    seed: Annotated[int, typer.Option(help="Of motion and robot; results are kept of 1000, 1 is for tuning.")] = 1000,
    csv_out: CsvOption = None,
) -> Outcome:
    """Let hands meet plates, stiff and by tension, and do the gestures freely."""
    names = gestures or list(GESTURES)
    leasts = {STIFF: 1.0, TENSION: load_robot(robot).config.least_stiffness if least is None else least}
    done = in_order(partial(gesture, robot_name=robot, leasts=leasts, seed=seed), names, jobs)
    freely, touches = [one for free, _ in done for one in free], [one for _, own in done for one in own]
    out = Table("gesture", "way", "follows", "impact [N]", "presses [N]", "touches", "stiffness", "upright")
    for t in touches:
        out.add_row(
            t.gesture,
            f"{t.part:.0%}",
            t.way,
            f"{t.impact_n:.0f}",
            f"{t.presses_n:.1f}",
            f"{t.touches:.0%}",
            f"{t.stiffness:.2f}",
            "yes" if t.upright else "no",
        )
    console = Console(width=120)
    console.print(out)
    free_table = Table("gesture", "follows", "tracking [°]", "stiffness")
    for f in freely:
        free_table.add_row(f.gesture, f.way, f"{f.tracking_deg:.2f}", f"{f.stiffness:.2f}")
    console.print(free_table)
    if csv_out is not None:
        write_csv(csv_out, [asdict(t) for t in touches])
    found = figures(freely, touches)
    return Outcome(verdicts(found, len(names)), found | {"least": leasts[TENSION]})
