"""Does the robot's head come where it is asked to be, and in time, and does the robot stand there?

In lockstep, at the simulated robot's true pose, by MuJoCo's kinematics. Each run stands or gestures by one prompt and
is sent a new place of the head every three seconds, drawn from what hips and trunk reach over feet that stand, due
after a random time; each goes on from the one before. What cannot be done is asked for as well, and has to end as
docs/live.md says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.robot.asked_run import (
    PerturbedOption,
    RunsOption,
    SeedOption,
    TargetsOption,
    passed_ticks,
    prompted_session,
    safety,
    true_state,
    untouched,
    up_ticks,
)
from benchmarks.shared.impossible import as_documented
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from benchmarks.shared.prompt_table import answers, by_prompt, millimetres, percent, show, states, within
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.configs.stream import load_stream
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.heard import Heard
from flexmotion.streamer.motion.intents import Intent, Stop, Velocity
from flexmotion.streamer.motion.part_intents import FootPlace, HeadPlace, Relax
from flexmotion.streamer.motion.restriction_intents import TorqueCap

Float = NDArray[np.float64]

STANDS = "stand still"
PROMPTS = (STANDS, "wave with both hands", STANDS, "bow", STANDS)
EVERY_S, FIRST_S, LAST_S = 3.0, 3.0, 2.5
"""Time between two targets, before the first, and after the last [s]."""
IN_S = (0.8, 1.6)
"""Range of the time that a target is given [s]."""
LATER_S = 0.5
LOWEST, HIGHEST = np.array([-0.04, -0.04, 0.34]), np.array([0.1, 0.04, 0.455])
"""Box in which places are drawn until one is in reach [m]: what OP3 reaches is inside of it."""
NEAR_M, FAR_M = 0.015, 0.04
NEAR_SHARE, FAR_SHARE = 0.8, 0.95
_DOWN = HeadPlace((0.03, 0.0, 0.4))
_OTHERS: tuple[tuple[str, Intent | None, Intent, float, str], ...] = (
    ("a head 10 cm above the stand", None, HeadPlace((0.0, 0.0, 0.56)), 2.5, "refused"),
    ("a head 15 cm too low", None, HeadPlace((0.03, 0.0, 0.2)), 2.5, "refused"),
    ("a head 8 cm too far aside", None, HeadPlace((0.02, 0.12, 0.4)), 2.5, "refused"),
    ("a head 2 cm too far aside", None, HeadPlace((0.02, 0.06, 0.4)), 2.5, "moved"),
    ("a head sooner than the legs bend", None, HeadPlace((0.03, 0.0, 0.39), in_s=0.1), 2.5, "slowed"),
    ("a head that is let go before it is there", None, _DOWN, 0.5, "refused"),
    ("to let go what is not held", Relax("head place"), Relax("head place"), 2.5, "refused"),
    ("a foot while the head is held", _DOWN, FootPlace("left", (0.0, 0.12)), 2.5, "refused"),
    ("a cap of the knees while the head is held", _DOWN, TorqueCap("knee", 2.0), 2.5, "refused"),
    ("a head with capped knees", TorqueCap("knee", 3.0), _DOWN, 2.5, "refused"),
    ("a head of a robot that walks", Velocity(0.2, 0.0, 0.0), _DOWN, 2.5, "refused"),
)
"""What cannot be done as asked: what, what is asked for half a second before, the target, how long both hold [s], and
the state of its answer. Before each the robot is at rest."""


@dataclass(frozen=True)
class Row:
    """One target.

    Attributes:
        prompt, seed: of the run; x, y, z, in_s: of the target [m, s].
        state: of its answer.
        told_s: time at which the head is there by the answer [s].
        head_m: distance of the head from its place at that time [m].
        later_m: the same half a second later [m].
    """

    prompt: str
    seed: int
    x: float
    y: float
    z: float
    in_s: float
    state: str
    told_s: float
    head_m: float
    later_m: float


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        rows: its targets.
        upright: whether the robot stayed up and did not fault.
        tilt_deg: greatest tilt of the torso [°].
        feet_m: greatest way of a sole while places were asked for [m].
        self_contacts: ticks in which it touched itself.
        violations: goals outside the envelope.
        asked_for: states of the answers to what cannot be done, by what it was; of the first run alone.
    """

    rows: list[Row]
    upright: bool
    tilt_deg: float
    feet_m: float
    self_contacts: int
    violations: int
    asked_for: dict[str, str]


class Measured:
    """Where a robot's head and soles are in a true state, by MuJoCo."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.data = robot, mujoco.MjData(robot.model)

    def soles(self, base: Float, q: Float) -> tuple[Float, Float]:
        """Centres of both soles, (2, 3) [m], and the mean of their headings as a direction on the floor, (2,).

        Args:
            base: place and quaternion of the torso, (7,); q: joint angles, (n,) [rad].
        """
        robot, data, feet = self.robot, self.data, np.array(self.robot.foot_ids)
        data.qpos[:7], data.qpos[robot.qpos_address] = base, q
        mujoco.mj_kinematics(robot.model, data)
        turns = data.xmat[feet].reshape(2, 3, 3)
        ahead = turns[:, :2, 0].sum(axis=0)
        return data.xpos[feet] + np.matmul(turns, robot.soles[:, :, None])[:, :, 0], ahead / np.linalg.norm(ahead)

    def head(self, base: Float, q: Float) -> Float:
        """The head seen from the middle between both soles, (3,) [m]; arguments of `soles`."""
        soles, (cos, sin) = self.soles(base, q)
        named = self.robot.config.head
        assert named is not None
        body = self.data.body(named.body)
        x, y, z = body.xpos + body.xmat.reshape(3, 3) @ np.asarray(named.point) - soles.mean(axis=0)
        return np.array([cos * x + sin * y, cos * y - sin * x, z])


def drawn(retargeter: Retargeter, rng: np.random.Generator) -> HeadPlace:
    """A place in reach."""
    robot, body = retargeter.robot, retargeter.body
    while True:
        x, y, z = map(float, rng.uniform(LOWEST, HIGHEST))
        try:
            retargeter.head_places.nearest((x, y, z), 0.0, body.home_feet, robot.stand_pose[body.upper.joints])
        except ConfigError:
            continue
        return HeadPlace((x, y, z), float(rng.uniform(*IN_S)))


def run(seed: int, targets: int, perturbed: bool, first: int) -> Run:
    """One run; the first one is asked for what cannot be done as well."""
    robot, prompt, rng = load_robot("op3"), PROMPTS[seed % len(PROMPTS)], np.random.default_rng(seed)
    others = list(_OTHERS) if seed == first else []
    retargeter = Retargeter(robot, load_stream())
    asked = [(FIRST_S + EVERY_S * place, drawn(retargeter, rng)) for place in range(targets)]
    other_s = 2.0 * EVERY_S
    seconds = FIRST_S + EVERY_S * targets + other_s * len(others) + LAST_S
    session = prompted_session(prompt, seed, seconds, perturbed=perturbed)
    sent: dict[int, tuple[int, HeadPlace]] = {}
    impossible: dict[int, str] = {}
    done = [0]  # steps of the other that is asked for

    def ask() -> None:
        tick = passed_ticks(session)
        passed = tick / robot.rate_hz
        if len(sent) < targets:
            if passed >= asked[len(sent)][0]:
                place, last = asked[len(sent)][1], len(sent) + 1 == targets
                holds_s = EVERY_S - 0.5 if last else math.inf
                sent[session.targets.send(place, holds_s=holds_s).id] = tick, place
        elif others:
            due_s = FIRST_S + EVERY_S * targets + other_s * (len(impossible) + 0.5)
            what, before, intent, holds_s, _ = others[0]
            if done[0] == 0 and passed >= due_s - 0.5:
                if before is not None:
                    session.targets.send(before, holds_s=holds_s)
                done[0] = 1
            if passed >= due_s:
                others.pop(0)
                done[0] = 0
                impossible[session.targets.send(intent, holds_s=holds_s).id] = what
                if isinstance(before, Velocity):
                    session.targets.send(Stop())

    session.next_request = ask
    record = session.run()
    told, up = {heard.id: heard for heard in session.heard}, up_ticks(record)
    measured = Measured(robot)
    return Run(
        rows=[_row(record, measured, prompt, seed, told.get(number), *one) for number, one in sent.items()],
        upright=bool(up.all()),
        tilt_deg=float(np.degrees(np.linalg.norm(record.ticks.tilt, axis=1).max())),
        feet_m=_slip(record, measured, FIRST_S, FIRST_S + EVERY_S * targets),
        self_contacts=int(np.count_nonzero(record.ticks.true_self_contact & up)),
        violations=record.violations_sent,
        asked_for={what: told[number].state if number in told else "-" for number, what in impossible.items()},
    )


def _row(
    record: RunTrace, measured: Measured, prompt: str, seed: int, heard: Heard | None, tick: int, place: HeadPlace
) -> Row:
    told_s = place.in_s
    if heard is not None and heard.slowed is not None:
        told_s = float(heard.slowed.split()[0])
    due = tick + round(told_s * record.rate_hz)
    now, later = (_at(record, measured, at) for at in (due, due + round(LATER_S * record.rate_hz)))
    x, y, z = (math.nan if value is None else value for value in place.place)
    return Row(
        prompt,
        seed,
        x,
        y,
        z,
        place.in_s,
        "-" if heard is None else heard.state,
        told_s,
        head_m=float(np.linalg.norm(now - (x, y, z))),
        later_m=float(np.linalg.norm(later - (x, y, z))),
    )


def _at(record: RunTrace, measured: Measured, tick: int) -> Float:
    state = true_state(record, tick)
    return np.full(3, np.nan) if state is None else measured.head(*state)


def _slip(record: RunTrace, measured: Measured, begin_s: float, end_s: float) -> float:
    """Greatest way of a sole from where it was, on the floor [m]; every twentieth tick counts."""
    rows = np.flatnonzero(
        (record.ticks.tick >= begin_s * record.rate_hz) & (record.ticks.tick < end_s * record.rate_hz)
    )
    soles = np.array([measured.soles(record.ticks.true_base[k], record.ticks.true_q[k])[0] for k in rows[::20]])
    return float(np.linalg.norm((soles - soles[0])[:, :, :2], axis=2).max())


def verdicts(runs: Sequence[Run]) -> list[Verdict]:
    """What has to hold over all runs."""
    rows = [row for run in runs for row in run.rows]
    near, far = (within([row.head_m for row in rows], bound) for bound in (NEAR_M, FAR_M))
    expected = {what: state for what, _, _, _, state in _OTHERS}
    return [
        Verdict(f"head within 1.5 cm at the told time: {near:.0%} of {len(rows)} (>= 80 %)", near >= NEAR_SHARE),
        Verdict(f"within 4 cm: {far:.0%} (>= 95 %)", far >= FAR_SHARE),
        untouched(sum(run.self_contacts for run in runs)),
        *safety(runs),
        as_documented((run.asked_for for run in runs), expected),
    ]


def figures(runs: Sequence[Run]) -> dict[str, Any]:
    """Figures over all targets, and by prompt."""
    rows = [row for run in runs for row in run.rows]

    def of(own: Sequence[Row]) -> dict[str, Any]:
        head, later = np.array([row.head_m for row in own]), np.array([row.later_m for row in own])
        return {
            "targets": len(own),
            "within_near": float(np.mean(head <= NEAR_M)),
            "within_far": float(np.mean(head <= FAR_M)),
            "median_m": float(np.median(head)),
            "p95_m": float(np.percentile(head, 95)),
            "later_median_m": float(np.median(later)),
            "later_p95_m": float(np.percentile(later, 95)),
            "states": states(own),
        }

    return by_prompt(rows, of) | {
        "greatest_tilt_deg": max(run.tilt_deg for run in runs),
        "greatest_slip_m": max(run.feet_m for run in runs),
        "self_contacts": sum(run.self_contacts for run in runs),
        "impossible": {what: state for run in runs for what, state in run.asked_for.items()},
    }


COLUMNS = {
    "within 1.5 cm": percent("within_near"),
    "within 4 cm": percent("within_far"),
    "median": millimetres("median_m"),
    "95 %": millimetres("p95_m"),
    "later": millimetres("later_median_m"),
    "later 95 %": millimetres("later_p95_m"),
    "answers": answers,
}


def main(
    runs: RunsOption = 5,
    targets: TargetsOption = 10,
    perturbed: PerturbedOption = False,
    jobs: JobsOption = 1,
    seed: SeedOption = 1000,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run them all, and measure where the head is."""
    one = partial(run, targets=targets, perturbed=perturbed, first=seed)
    done = in_order(one, range(seed, seed + runs), jobs)
    found = figures(done)
    show(found, COLUMNS)
    if csv_out is not None:
        write_csv(csv_out, [asdict(row) for run in done for row in run.rows])
    return Outcome(verdicts(done), found)
