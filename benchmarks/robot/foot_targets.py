"""Does the robot's foot come where it is asked to be, and in time, and does the robot stand there?

In lockstep, at the simulated robot's true pose, by MuJoCo's kinematics. Each run stands or gestures by one prompt and
is sent a new target every five seconds: a place for one sole, seen from the other, drawn from what steps of the gait
reach, due after a random time. Every other one holds until the next, which steps from there; the others end, and the
feet come side by side. What cannot be done is asked for as well, and has to end as docs/live.md says.
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
    up_ticks,
)
from benchmarks.shared.impossible import as_documented
from benchmarks.shared.options import CsvOption, JobsOption
from benchmarks.shared.outcome import Outcome, Verdict, write_csv
from benchmarks.shared.processes import in_order
from benchmarks.shared.prompt_table import answers, by_prompt, degrees, millimetres, percent, show, states, within
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Intent, Velocity
from flexmotion.streamer.motion.part_intents import FootPlace, Relax
from flexmotion.streamer.motion.part_values import SIDES
from flexmotion.streamer.motion.restriction_intents import Contact

Float = NDArray[np.float64]

STANDS = "stand still"
PROMPTS = (STANDS, "wave with both hands", STANDS, "bow", STANDS)
EVERY_S, FIRST_S, LAST_S = 5.0, 3.0, 2.5
"""Time between two targets, before the first, and after the last [s]."""
IN_S = (1.0, 2.0)
"""Range of the time that a target is given [s]."""
HOLDS_S = 1.5
"""How long every other target holds after its time; the feet are side by side again before the next [s]."""
LATER_S = 0.5
AHEAD_M, TURN_RAD = 0.115, 0.35
"""Farthest ahead or back, and greatest turn, that are asked for: what a walk of OP3 does is .120 m and .4 rad."""
NEAR_M, FAR_M, TURN_DEG = 0.01, 0.02, 4.0
GESTURE_M = 0.055
"""A foot that is let go stays while a gesture goes on, if it is within 4.5 cm of its foothold; with what it slips."""
NEAR_SHARE, FAR_SHARE, TURN_SHARE = 0.8, 0.95, 0.95
_LEFT = FootPlace("left", (0.0, 0.12))
_OTHERS: tuple[tuple[str, Intent | None, Intent, float, str], ...] = (
    ("a foot 8 cm out of reach", None, FootPlace("left", (0.2, 0.1)), 2.0, "refused"),
    ("a foot across the other one", None, FootPlace("right", (0.0, 0.1)), 2.0, "refused"),
    ("a foot 2 cm out of reach", None, FootPlace("left", (0.0, 0.165)), 2.0, "moved"),
    ("a foot that turns by 46°", None, FootPlace("left", (0.0, 0.13), 0.8), 2.0, "refused"),
    ("a foot that turns by 2° too much", None, FootPlace("right", (0.0, -0.13), -0.535), 2.0, "moved"),
    ("a foot sooner than a step lasts", None, FootPlace("right", (0.05, -0.1), in_s=0.2), 2.0, "slowed"),
    ("a foot that is let go before it is there", None, FootPlace("left", (0.0, 0.12)), 0.5, "refused"),
    ("to let go what is not held", None, Relax("left foot"), 2.0, "refused"),
    ("a foot that is kept down", Contact("left"), _LEFT, 2.0, "refused"),
    ("a foot of a robot that walks", Velocity(0.2, 0.0, 0.0), _LEFT, 2.0, "refused"),
)
"""What cannot be done as asked: what, what is asked for half a second before, the target, how long both hold [s], and
the state of its answer."""


@dataclass(frozen=True)
class Row:
    """One target.

    Attributes:
        prompt, seed: of the run; side, ahead_m, left_m, turn_rad, in_s: of the target.
        stays: whether it holds until the next one.
        state: of its answer.
        foot_m: distance of the sole from its place at the asked time [m].
        later_m: the same half a second later [m].
        turn_deg: heading of the sole minus the one that is asked for, then [°].
        beside_m: where it is let go: distance of the sole from its place at the beginning, before the next target [m].
    """

    prompt: str
    seed: int
    side: str
    ahead_m: float
    left_m: float
    turn_rad: float
    in_s: float
    stays: bool
    state: str
    foot_m: float
    later_m: float
    turn_deg: float
    beside_m: float


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        rows: its targets.
        upright: whether the robot stayed up and did not fault.
        tilt_deg: greatest tilt of the torso [°].
        violations: goals outside the envelope.
        asked_for: states of the answers to what cannot be done, by what it was; of the first run alone.
    """

    rows: list[Row]
    upright: bool
    tilt_deg: float
    violations: int
    asked_for: dict[str, str]


class Soles:
    """Where a robot's soles are in a true state, by MuJoCo."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.data = robot, mujoco.MjData(robot.model)

    def seen(self, side: str, base: Float, q: Float) -> Float:
        """A sole seen from the other one: ahead, left [m], heading [rad], (3,).

        Args:
            base: place and quaternion of the torso, (7,); q: joint angles, (n,) [rad].
        """
        robot, data, own, feet = self.robot, self.data, SIDES.index(side), np.array(self.robot.foot_ids)
        data.qpos[:7], data.qpos[robot.qpos_address] = base, q
        mujoco.mj_kinematics(robot.model, data)
        turns = data.xmat[feet].reshape(2, 3, 3)
        centres = data.xpos[feet] + np.matmul(turns, robot.soles[:, :, None])[:, :, 0]
        seen = turns[1 - own].T @ (centres[own] - centres[1 - own])
        axis = turns[1 - own].T @ turns[own][:, 0]
        return np.array([seen[0], seen[1], math.atan2(axis[1], axis[0])])


def drawn(robot: Robot, rng: np.random.Generator) -> FootPlace:
    """A place in reach of a step of one foot."""
    side, gait = SIDES[int(rng.integers(2))], robot.gait
    outward = 1.0 if side == "left" else -1.0
    in_s, turn = float(rng.uniform(*IN_S)), float(rng.uniform(-1.0, 1.0)) * TURN_RAD
    narrowest = gait.lateral[0] + float(robot.sole_half_size[:, 0].max()) * abs(math.sin(turn))
    while True:
        ahead, aside = float(rng.uniform(-1.0, 1.0)), float(rng.uniform(0.0, 1.0))
        if math.hypot(ahead, aside) < 1.0:
            break
    x, y = AHEAD_M * ahead, outward * (narrowest + max(gait.lateral[1] - narrowest, 0.0) * aside)
    cos, sin = math.cos(0.5 * turn), math.sin(0.5 * turn)  # ahead in the middle between both feet
    return FootPlace(side, (cos * x - sin * y, sin * x + cos * y), turn, in_s)


def run(seed: int, targets: int, perturbed: bool, first: int) -> Run:
    """One run; the first one is asked for what cannot be done as well."""
    robot, prompt, rng = load_robot("op3"), PROMPTS[seed % len(PROMPTS)], np.random.default_rng(seed)
    others = list(_OTHERS) if seed == first else []
    asked = [(FIRST_S + EVERY_S * place, drawn(robot, rng)) for place in range(targets)]
    seconds = FIRST_S + EVERY_S * (targets + len(others)) + LAST_S
    session = prompted_session(prompt, seed, seconds, perturbed=perturbed)
    sent: dict[int, tuple[int, FootPlace, bool]] = {}
    impossible: dict[int, str] = {}
    prepared = [False]

    def ask() -> None:
        tick = passed_ticks(session)
        passed = tick / robot.rate_hz
        if len(sent) < targets:
            if passed >= asked[len(sent)][0]:
                foot, stays = asked[len(sent)][1], len(sent) % 2 == 0 and len(sent) + 1 < targets
                holds_s = math.inf if stays else foot.in_s + HOLDS_S
                sent[session.targets.send(foot, holds_s=holds_s).id] = tick, foot, stays
        elif others:
            due_s = FIRST_S + EVERY_S * (targets + len(impossible))
            what, before, intent, holds_s, _ = others[0]
            if before is not None and not prepared[0] and passed >= due_s - 0.5:
                session.targets.send(before, holds_s=holds_s)
                prepared[0] = True
            if passed >= due_s:
                others.pop(0)
                prepared[0] = False
                impossible[session.targets.send(intent, holds_s=holds_s).id] = what

    session.next_request = ask
    record = session.run()
    answered = {heard.id: heard.state for heard in session.heard}
    soles = Soles(robot)
    return Run(
        rows=[_row(record, soles, prompt, seed, answered.get(number, "-"), *one) for number, one in sent.items()],
        upright=bool(up_ticks(record).all()),
        tilt_deg=float(np.degrees(np.linalg.norm(record.ticks.tilt, axis=1).max())),
        violations=record.violations_sent,
        asked_for={what: answered.get(number, "-") for number, what in impossible.items()},
    )


def _row(
    record: RunTrace, soles: Soles, prompt: str, seed: int, state: str, tick: int, foot: FootPlace, stays: bool
) -> Row:
    rate, (ahead, left) = record.rate_hz, foot.place
    due = tick + round(foot.in_s * rate)
    now, later, last = (_at(record, soles, foot.side, at) for at in (due, due + LATER_S * rate, tick + EVERY_S * rate))
    begin = _at(record, soles, foot.side, FIRST_S * rate)
    return Row(
        prompt,
        seed,
        foot.side,
        ahead,
        left,
        foot.heading,
        foot.in_s,
        stays,
        state,
        foot_m=math.hypot(*(now[:2] - foot.place)),
        later_m=math.hypot(*(later[:2] - foot.place)),
        turn_deg=math.degrees(later[2] - foot.heading),
        beside_m=math.nan if stays else math.hypot(*(last - begin)[:2]),
    )


def _at(record: RunTrace, soles: Soles, side: str, tick: float) -> Float:
    state = true_state(record, tick)
    return np.full(3, np.nan) if state is None else soles.seen(side, *state)


def verdicts(runs: Sequence[Run]) -> list[Verdict]:
    """What has to hold over all runs."""
    rows = [row for run in runs for row in run.rows]
    near, far = within([row.foot_m for row in rows], NEAR_M), within([row.later_m for row in rows], FAR_M)
    turned = within([abs(row.turn_deg) for row in rows], TURN_DEG)
    back = [row for row in rows if not row.stays]
    beside = sum(row.beside_m <= (FAR_M if row.prompt == STANDS else GESTURE_M) for row in back)
    expected = {what: state for what, _, _, _, state in _OTHERS}
    return [
        Verdict(f"sole within 1 cm at the asked time: {near:.0%} of {len(rows)} (>= 80 %)", near >= NEAR_SHARE),
        Verdict(f"within 2 cm half a second later: {far:.0%} (>= 95 %)", far >= FAR_SHARE),
        Verdict(f"heading within 4° then: {turned:.0%} (>= 95 %)", turned >= TURN_SHARE),
        Verdict(f"side by side again (2 cm, in a gesture 5.5): {beside} of {len(back)} (all)", beside == len(back)),
        *safety(runs),
        as_documented((run.asked_for for run in runs), expected),
    ]


def figures(runs: Sequence[Run]) -> dict[str, Any]:
    """Figures over all targets, and by prompt."""
    rows = [row for run in runs for row in run.rows]

    def of(own: Sequence[Row]) -> dict[str, Any]:
        foot, later = np.array([row.foot_m for row in own]), np.array([row.later_m for row in own])
        return {
            "targets": len(own),
            "within_near": float(np.mean(foot <= NEAR_M)),
            "median_m": float(np.median(foot)),
            "p95_m": float(np.percentile(foot, 95)),
            "later_median_m": float(np.median(later)),
            "later_p95_m": float(np.percentile(later, 95)),
            "turn_p95_deg": float(np.percentile(np.abs([row.turn_deg for row in own]), 95)),
            "states": states(own),
        }

    impossible = {what: state for run in runs for what, state in run.asked_for.items()}
    tilt = max(run.tilt_deg for run in runs)
    return by_prompt(rows, of) | {"greatest_tilt_deg": tilt, "impossible": impossible}


COLUMNS = {
    "within 1 cm": percent("within_near"),
    "median": millimetres("median_m"),
    "95 %": millimetres("p95_m"),
    "later": millimetres("later_median_m"),
    "later 95 %": millimetres("later_p95_m"),
    "heading 95 %": degrees("turn_p95_deg"),
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
    """Run them all, and measure where the soles are."""
    one = partial(run, targets=targets, perturbed=perturbed, first=seed)
    done = in_order(one, range(seed, seed + runs), jobs)
    found = figures(done)
    show(found, COLUMNS)
    if csv_out is not None:
        write_csv(csv_out, [asdict(row) for run in done for row in run.rows])
    return Outcome(verdicts(done), found)
