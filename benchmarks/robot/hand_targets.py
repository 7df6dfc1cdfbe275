"""Does the robot's hand come where it is asked to be, and in time, whatever the rest of the body does?

In lockstep, at the simulated robot's true joint angles, by MuJoCo's kinematics. Each run follows one prompt and is sent
a new target every two seconds: a place that one hand can take, drawn from random joint angles at which the robot does
not touch itself, and a direction for the head; both due after a random time. What cannot be done is asked for as well,
and has to end as docs/live.md says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from benchmarks.shared.prompt_table import answers, by_prompt, degrees, millimetres, percent, show, states, within
from flexmotion.configs.robot import Robot, load_robot
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.motion.intents import Intent, Text
from flexmotion.streamer.motion.part_intents import Hand, JointAngle, Look, Relax
from flexmotion.streamer.motion.part_values import SIDES

Float = NDArray[np.float64]

PROMPTS = ("stand still", "walk forward", "wave with both hands", "turn left", "stand still")
EVERY_S, FIRST_S, LAST_S = 2.0, 3.0, 2.5
"""Time between two targets, before the first, and after the last [s]."""
IN_S = (0.8, 1.6)
"""Range of the time that a target is given [s]."""
HOLDS_S = 2.5
PAN_RAD, TILT_RAD = 1.2, 0.6
"""Greatest angles of the head that are asked for [rad]."""
NEAR_M, FAR_M, HEAD_DEG = 0.015, 0.04, 5.0
NEAR_SHARE, FAR_SHARE, HEAD_SHARE = 0.8, 0.95, 0.95
_OTHERS: tuple[tuple[str, Intent, float, str], ...] = (
    ("a hand 30 cm out of reach", Hand("right", (0.5, -0.1, 0.1)), 2.0, "refused"),
    ("a hand 2 cm out of reach", Hand("left", (0.0, 0.305, 0.1)), 2.0, "moved"),
    ("a hand inside the trunk", Hand("left", (0.0, 0.0, 0.05)), 2.0, "refused"),
    ("a look straight back", Look((-1.0, 0.0, 0.0)), 2.0, "refused"),
    ("a joint beyond its limit", JointAngle("r_el", 2.6), 2.0, "refused"),
    ("a joint of a leg", JointAngle("l_knee", 0.5), 2.0, "refused"),
    ("a joint that there is not", JointAngle("third_arm", 0.5), 2.0, "refused"),
    ("a hand that is let go before it is there", Hand("right", (0.1, -0.15, 0.0), 1.0), 0.5, "refused"),
    ("to let go what is not held", Relax("left hand"), 2.0, "refused"),
    ("both feet up", Text("lift both feet off the ground"), 2.0, "refused"),
)
"""What cannot be done as asked: what, the target, how long it holds [s], and the state of its answer."""


@dataclass(frozen=True)
class Row:
    """One target of a hand and of the head.

    Attributes:
        prompt, seed: of the run; side, in_s: of the target.
        state: of the hand's answer.
        hand_m: distance of the hand from its place at the asked time [m].
        later_m: the same .3 s later [m].
        head_deg: angle of the head from its direction at the asked time [°].
    """

    prompt: str
    seed: int
    side: str
    in_s: float
    state: str
    hand_m: float
    later_m: float
    head_deg: float


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        rows: its targets.
        upright: whether the robot stayed up and did not fault.
        self_contacts: ticks in which it touched itself.
        violations: goals outside the envelope.
        asked_for: states of the answers to what cannot be done, by what it was; of the first run alone.
    """

    rows: list[Row]
    upright: bool
    self_contacts: int
    violations: int
    asked_for: dict[str, str]


class Measured:
    """Where hands and head of a robot are at given joint angles, seen from its trunk, by MuJoCo."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.data = robot, mujoco.MjData(robot.model)

    def pose(self, q: Float) -> None:
        """Take joint angles (n,) [rad]."""
        self.data.qpos[:7], self.data.qpos[self.robot.qpos_address] = (0, 0, 1, 1, 0, 0, 0), q
        mujoco.mj_kinematics(self.robot.model, self.data)

    def hand(self, side: str) -> Float:
        """Place of a hand, (3,) [m]."""
        hands = self.robot.config.hands
        assert hands is not None
        hand, data = getattr(hands, side), self.data
        body = data.body(hand.body)
        place = body.xpos + body.xmat.reshape(3, 3) @ np.asarray(hand.point) - data.xpos[self.robot.torso_id]
        found: Float = data.xmat[self.robot.torso_id].reshape(3, 3).T @ place
        return found

    def gaze(self) -> Float:
        """Direction of the head, (3,)."""
        joint = self.robot.joint_names[self.robot.chain("head")["tilt"]]
        head = self.data.xmat[self.robot.model.joint(joint).bodyid[0]].reshape(3, 3)
        found: Float = self.data.xmat[self.robot.torso_id].reshape(3, 3).T @ head[:, 0]
        return found

    def touches(self) -> bool:
        """Whether the robot touches itself."""
        mujoco.mj_collision(self.robot.model, self.data)
        return bool(self.data.ncon)


def drawn(robot: Robot, measured: Measured, rng: np.random.Generator) -> tuple[Hand, Look]:
    """A place in reach of a hand, and a direction in that of the head."""
    side = SIDES[int(rng.integers(2))]
    arm = list(robot.chain(f"{side}_arm").values())
    in_s = float(rng.uniform(*IN_S))
    while True:
        q = robot.stand_pose.copy()
        q[arm] = rng.uniform(robot.lower[arm], robot.upper[arm])
        measured.pose(q)
        if not measured.touches():
            break
    x, y, z = map(float, measured.hand(side))
    pan, tilt = rng.uniform(-1.0, 1.0, 2) * (PAN_RAD, TILT_RAD)
    gaze = (float(np.cos(pan) * np.cos(tilt)), float(np.sin(pan) * np.cos(tilt)), float(np.sin(tilt)))
    return Hand(side, (x, y, z), in_s), Look(gaze, in_s)


def run(seed: int, targets: int, perturbed: bool, first: int) -> Run:
    """One run; the first one is asked for what cannot be done as well."""
    robot, prompt, rng = load_robot("op3"), PROMPTS[seed % len(PROMPTS)], np.random.default_rng(seed)
    others = list(_OTHERS) if seed == first else []
    measured = Measured(robot)
    asked = [(FIRST_S + EVERY_S * place, *drawn(robot, measured, rng)) for place in range(targets)]
    seconds = FIRST_S + EVERY_S * (targets + len(others)) + LAST_S
    session = prompted_session(prompt, seed, seconds, perturbed=perturbed)
    sent: dict[int, tuple[int, Hand, Look]] = {}
    impossible: dict[int, str] = {}

    def ask() -> None:
        tick = passed_ticks(session)
        passed = tick / robot.rate_hz
        if len(sent) < targets and passed >= asked[len(sent)][0]:
            _, hand, look = asked[len(sent)]
            sent[session.targets.send(hand, holds_s=HOLDS_S).id] = tick, hand, look
            session.targets.send(look, holds_s=HOLDS_S)
        elif others and passed >= FIRST_S + EVERY_S * (targets + len(impossible)):
            what, intent, holds_s, _ = others.pop(0)
            impossible[session.targets.send(intent, holds_s=holds_s).id] = what

    session.next_request = ask
    record = session.run()
    answered, up = {heard.id: heard.state for heard in session.heard}, up_ticks(record)
    return Run(
        rows=[_row(record, measured, prompt, seed, answered.get(number, "-"), *one) for number, one in sent.items()],
        upright=bool(up.all()),
        self_contacts=int(np.count_nonzero(record.ticks.true_self_contact & up)),
        violations=record.violations_sent,
        asked_for={what: answered.get(number, "-") for number, what in impossible.items()},
    )


def _row(
    record: RunTrace, measured: Measured, prompt: str, seed: int, state: str, tick: int, hand: Hand, look: Look
) -> Row:
    due = tick + round(hand.in_s * record.rate_hz)
    later = due + round(0.3 * record.rate_hz)
    places = [_at(record, measured, tick, partial(measured.hand, hand.side)) for tick in (due, later)]
    gaze = _at(record, measured, due, measured.gaze)
    hand_m, later_m = (float(np.linalg.norm(place - hand.place)) for place in places)
    head = float(np.degrees(np.arccos(np.clip(gaze @ look.direction, -1.0, 1.0))))
    return Row(prompt, seed, hand.side, hand.in_s, state, hand_m, later_m, head)


def _at(record: RunTrace, measured: Measured, tick: int, what: Callable[[], Float]) -> Float:
    state = true_state(record, tick)
    if state is None:
        return np.full(3, np.nan)
    measured.pose(state[1])
    return what()


def verdicts(runs: Sequence[Run]) -> list[Verdict]:
    """What has to hold over all runs."""
    rows = [row for run in runs for row in run.rows]
    near, far = (within([row.hand_m for row in rows], bound) for bound in (NEAR_M, FAR_M))
    head = within([row.head_deg for row in rows], HEAD_DEG)
    expected = {what: state for what, _, _, state in _OTHERS}
    return [
        Verdict(f"hand within 1.5 cm at the asked time: {near:.0%} of {len(rows)} (>= 80 %)", near >= NEAR_SHARE),
        Verdict(f"hand within 4 cm: {far:.0%} (>= 95 %)", far >= FAR_SHARE),
        Verdict(f"head within 5°: {head:.0%} (>= 95 %)", head >= HEAD_SHARE),
        untouched(sum(run.self_contacts for run in runs)),
        *safety(runs),
        as_documented((run.asked_for for run in runs), expected),
    ]


def figures(runs: Sequence[Run]) -> dict[str, Any]:
    """Figures over all targets, and by prompt."""
    rows = [row for run in runs for row in run.rows]

    def of(own: Sequence[Row]) -> dict[str, Any]:
        hand = np.array([row.hand_m for row in own])
        return {
            "targets": len(own),
            "within_near": float(np.mean(hand <= NEAR_M)),
            "within_far": float(np.mean(hand <= FAR_M)),
            "median_m": float(np.median(hand)),
            "p95_m": float(np.percentile(hand, 95)),
            "later_median_m": float(np.median([row.later_m for row in own])),
            "head_p95_deg": float(np.percentile([row.head_deg for row in own], 95)),
            "states": states(own),
        }

    impossible = {what: state for run in runs for what, state in run.asked_for.items()}
    return by_prompt(rows, of) | {
        "self_contacts": sum(run.self_contacts for run in runs),
        "impossible": impossible,
    }


COLUMNS = {
    "within 1.5 cm": percent("within_near"),
    "within 4 cm": percent("within_far"),
    "median": millimetres("median_m"),
    "95 %": millimetres("p95_m"),
    "later": millimetres("later_median_m"),
    "head 95 %": degrees("head_p95_deg"),
    "answers": answers,
}


def main(
    runs: RunsOption = 10,
    targets: TargetsOption = 10,
    perturbed: PerturbedOption = False,
    jobs: JobsOption = 1,
    seed: SeedOption = 1000,
    csv_out: CsvOption = None,
) -> Outcome:
    """Run them all, and measure where the hands are."""
    one = partial(run, targets=targets, perturbed=perturbed, first=seed)
    done = in_order(one, range(seed, seed + runs), jobs)
    found = figures(done)
    show(found, COLUMNS)
    if csv_out is not None:
        write_csv(csv_out, [asdict(row) for run in done for row in run.rows])
    return Outcome(verdicts(done), found)
