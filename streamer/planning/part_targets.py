"""`PartTargets`: the targets for arms and head: which of them hold, and the one answer that each gets.

They replace no target for the whole body. Each is solved when it arrives, from where the robot is then; every plan is
given all that hold (`goals`), and the retargeter goes on with those that it has already begun.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.tension import LIMBS
from flexmotion.configs.errors import ConfigError, RetargetError
from flexmotion.retarget.part_paths import LONGEST_FADE_S, PartGoal, PartGoals
from flexmotion.retarget.part_solver import Solved
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.whole_body import POSTURE
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, Over
from flexmotion.streamer.motion.heard import State as Fate
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.part_intents import Hand, Look, Placed, Point, Relax
from flexmotion.streamer.motion.part_words import WORDS_HOLD_S, part_of_words, unoffered_part
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.answers import Answers
from flexmotion.streamer.planning.arrival import ARRIVES_S, LEAST_M, LEAST_RAD, arrived
from flexmotion.streamer.planning.target_ledger import ended_by, not_held

Float = NDArray[np.float64]

_LEAST_ROOM = 0.1
"""Share of a torque cap that moves a joint at least, on a way from where it needs more than the cap at rest."""
_LATE_S = 0.05
"""A part that is there later than asked by more than this is called slowed [s]."""


@dataclass(frozen=True)
class _Holding:
    """A part's target that holds, and its goal."""

    target: Target
    intent: Placed
    goal: PartGoal
    asked_due: float
    heard: Heard
    revision: int
    answered: bool = False
    delivered: bool = False
    """Whether a plan has reached the time at which it is due."""
    there: float = math.inf
    """Tick at which it is there, by the newest plan."""


class PartTargets:
    """The planner's record of targets for parts.

    Args:
        retargeter: solves them.
        publish: is given the answer to every target, once; on_note: a message for the operator.
        caps: gives the greatest torque by column of the joint [N·m]; see `Restrictions`.
    """

    def __init__(
        self,
        retargeter: Retargeter,
        publish: Callable[[Heard], None],
        on_note: Callable[[str], None],
        caps: Callable[[], Mapping[int, float]] = dict,
    ) -> None:
        self._caps = caps
        self._retargeter, self._rate = retargeter, retargeter.rate
        self._answers = Answers(retargeter.rate, publish, on_note)
        self._revisions = self._answers.revisions
        self.all_held: Callable[[], Iterable[str]] = tuple  # what holds of all records, in the names of `Relax`
        self._waiting: list[tuple[Target, float]] = []
        self._holding: list[_Holding] = []
        self._ended = 0.0

    def take(self, target: Target, born_s: float) -> None:
        """Take a target that has arrived, and when it was sent on the planner's clock [s]."""
        self._waiting.append((target, born_s))

    def update(self, row: TickRow, tick: float, now_s: float, q: Float) -> None:
        """Solve what has arrived, and answer what is known.

        Args:
            row: newest one of the loop.
            tick: of the loop, at the time `now_s` of the planner's clock.
            q: all joint angles as planned now, (n,) [rad].
        """
        ended = ended_by(row)
        if ended is not None:
            self.refuse_all(ended)
            return
        self._answer(row)
        self._follow(row, tick)
        waiting, self._waiting = self._waiting, []
        for target, born_s in waiting:
            if self._answers.expired(target, now_s - born_s):
                continue
            try:
                self._begin(target, tick + (born_s - now_s) * self._rate, q)
            except (ConfigError, RetargetError) as error:
                self._answers.unfollowed(target, "refused", str(error))

    def refuse_all(self, reason: str) -> None:
        """No target can be followed; those that hold are over."""
        for target, _ in self._waiting:
            self._answers.unfollowed(target, "refused", reason)
        for one in self._holding:
            self._end(one, "stopped", "refused", reason)
        self._answers.nothing_holds()
        numbers = [target.id for target, _ in self._waiting] + [one.target.id for one in self._holding]
        self._ended = max([self._ended, *numbers])
        self._waiting, self._holding = [], []

    def wants(self, plan: int, tick: int) -> bool:
        """Whether a plan is due because the one with this id does not know all targets."""
        if not plan and not (self._waiting or self._holding or self._answers.waits):
            return False  # no plan plays, and nothing is asked: what is over needs none
        return self._revisions.wants(plan, tick)

    @property
    def goals(self) -> PartGoals:
        """What holds, for the retargeter."""
        return PartGoals([one.goal for one in self._holding], self._ended)

    def made(self, plan: int, rows: Plan, playing: int, tick: int) -> None:
        """A plan was made with all that hold.

        Args:
            plan: its id; rows: it; playing: id of the plan that plays.
            tick: that the loop does next.
        """
        self._revisions.made(plan, playing, tick)
        state = self._retargeter.layout.view(rows.states[0].copy())
        for place, one in enumerate(self._holding):
            own = one.goal.channels
            if (one.answered and one.delivered) or (state.part[own] != one.goal.number).any():
                continue
            due = float(state.part_due[own].max())
            delivered, away = one.delivered, None
            first = max(math.ceil(due) - rows.start_tick, 0)
            if not delivered and first < len(rows.q):
                q = rows.q[first:]
                delivered, away = True, self._retargeter.solver.kept_away(own - len(POSTURE), one.goal.angles, q)
            late_s = (due - one.asked_due) / self._rate
            slowed = f"{one.intent.in_s + late_s:.2f} s until it is there" if late_s > _LATE_S else None
            moved = one.heard.moved if away is None else away
            answer = "moved" if moved else "slowed" if slowed else "accepted"
            known = {} if one.answered else {"slowed": slowed, "tick": rows.start_tick}
            heard = one.heard.model_copy(update={"moved": moved, "state": answer, **known})
            if one.answered and away is not None:
                self._answers.tell(heard)  # a later version: the plan that was answered did not reach so far
            self._holding[place] = replace(one, heard=heard, delivered=delivered, there=due)

    def begin_with(self, plan: Plan) -> None:
        """Go on from a plan of another process, whose targets are not known: their joints stay where they are."""
        self._ended = max(self._ended, float(self._retargeter.layout.view(plan.states).part.max()))

    def leads(self, plan: Plan) -> bool:
        """Whether a part is led in a plan, under way or held."""
        state = self._retargeter.layout.view(plan.states[0].copy())
        return bool(self._retargeter.parts.led(state, plan.start_tick).any())

    def moves(self, plan: Plan, tick: int) -> bool:
        """Whether a part is under way in a plan, at a tick or soon after it."""
        return self._retargeter.parts.moves(self._retargeter.layout.view(plan.states[0].copy()), tick)

    # ------------------------------------------------------------------ targets

    def _begin(self, target: Target, born_tick: float, q: Float) -> None:
        """Let a target hold. Raises `ConfigError` where it cannot be followed; names what is valid."""
        unoffered = unoffered_part(target.intent, self._retargeter.robot.repertoire)
        if unoffered is not None:
            raise ConfigError(unoffered)
        words = part_of_words(target.intent)
        intent = words or target.intent
        if isinstance(intent, Relax):
            self._relax(target, intent)
            return
        assert isinstance(intent, Placed)
        holds_s = target.holds_s if words is None else min(target.holds_s, WORDS_HOLD_S)
        due, until = born_tick + intent.in_s * self._rate, born_tick + holds_s * self._rate
        if until < due:
            raise ConfigError(f"{intent}: it holds {holds_s:g} s only, expected more than the {intent.in_s:g} s")
        solved = self._solved(intent, self._ahead(q))
        channels = solved.columns + len(POSTURE)
        bound = self._bound(intent.part, solved, q)
        goal = PartGoal(target.id, channels, solved.angles, due, until, bound)
        kept = []
        for one in self._holding:
            if np.isin(one.goal.channels, channels).any():
                self._supersede(one, "superseded")
            else:
                kept.append(one)
        heard = Heard(
            id=target.id,
            asked=words_of(target.intent),
            state="accepted",
            heard_as=intent.part,
            moved=solved.moved,
            holds="part",
        )
        self._holding = [*kept, _Holding(target, intent, goal, due, heard, self._revisions.change())]

    def _relax(self, target: Target, intent: Relax) -> None:
        """Let parts go."""
        gone = [one for one in self._holding if intent.part in ("all", one.intent.part)]
        if not gone and intent.part != "all":
            raise not_held(intent.part, [*(one.intent.part for one in self._holding), *self.all_held()])
        for one in gone:
            self._supersede(one, "let go")
        self._holding = [one for one in self._holding if one not in gone]
        self._revisions.change()
        self._answers.relaxed(target)

    def _solved(self, intent: Placed, q: Float) -> Solved:
        solver = self._retargeter.solver
        match intent:
            case Hand(side, place, _, tolerance):
                return solver.hand(side, np.array(place), tolerance, q)
            case Point(side, direction, _, tolerance):
                return solver.point(side, np.array(direction), tolerance, q)
            case Look(direction, _, tolerance):
                return solver.look(np.array(direction), tolerance)
        return solver.joint(intent.joint, intent.angle, intent.tolerance)

    def _bound(self, part: str, solved: Solved, q: Float) -> Float | None:
        """Bounds on the acceleration of a part's joints for which none needs more torque than its cap, (K,) [rad/s²].

        None where none is capped. What a joint needs at rest at either end of its way is not there for its motion.

        Raises:
            ConfigError: staying there needs more than a cap.
        """
        caps, robot, upper = self._caps(), self._retargeter.robot, self._retargeter.body.upper.joints
        joints = upper[solved.columns]
        if not any(joint in caps for joint in map(int, joints)):
            return None
        there = self._ahead(q)
        there[joints] = solved.angles
        needs = np.abs([self._retargeter.holding_torque(angles[upper]) for angles in (q, there)])
        bound = np.full(len(joints), np.inf)
        for place, joint in enumerate(map(int, joints)):
            most = caps.get(joint, np.inf)
            if needs[1, joint] > most:
                raise ConfigError(
                    f"{part}: {robot.joint_names[joint]} needs {needs[1, joint]:.2f} N·m to stay there, its cap is "
                    f"{most:g} N·m"
                )
            # The share of its torque that moves it, over its inertia; see `ServoCommand`.
            room = max(most - float(needs[:, joint].max()), _LEAST_ROOM * most)
            bound[place] = room * robot.model.dof_invweight0[robot.dof_address[joint]]
        return bound

    @property
    def held(self) -> Float:
        """Angles of arms and head with the parts that hold at their goals, else of the stand pose, (C,) [rad]."""
        upper = self._retargeter.body.upper.joints
        return self._ahead(self._retargeter.robot.stand_pose)[upper]

    def holding(self, before: int) -> list[tuple[str, str]]:
        """Limbs (of `LIMBS`) that targets older than this number hold, with the names of their parts."""
        robot, upper = self._retargeter.robot, self._retargeter.body.upper.joints
        chains = {limb: list(robot.chain(limb).values()) for limb in LIMBS if limb in robot.mapping.chains()}
        return [
            (limb, one.intent.part)
            for one in self._holding
            if one.target.id < before and one.heard.over is None
            for limb, joints in chains.items()
            if np.isin(upper[one.goal.channels - len(POSTURE)], joints).any()
        ]

    def _ahead(self, q: Float) -> Float:
        """Joint angles (n,) with the parts that hold at their goals."""
        q, joints = q.copy(), self._retargeter.body.upper.joints
        for one in self._holding:
            q[joints[one.goal.channels - len(POSTURE)]] = one.goal.angles
        return q

    # ------------------------------------------------------------------ answers

    def _answer(self, row: TickRow) -> None:
        """Answer what the loop has taken a plan for."""
        known = self._answers.taken(row)
        for place, one in enumerate(self._holding):
            if not one.answered and one.heard.tick is not None and known >= one.revision:
                heard = self._answers.followed(one.heard)
                self._holding[place] = replace(one, heard=heard, answered=True)
                self._answers.tell(heard)

    def _follow(self, row: TickRow, tick: float) -> None:
        """Tell which parts are there, and whose time is over."""
        held = list[_Holding]()
        for one in self._holding:
            # A part that its servos bring there later is not let go on its way.
            until = max(one.goal.until, one.there) if math.isfinite(one.there) else one.goal.until
            if one.answered and one.there <= tick:
                one = self._arrived(one, row, tick >= min(one.there + ARRIVES_S * self._rate, until))
            if until <= tick:
                one = self._over(one, "expired")
            if tick < until + LONGEST_FADE_S * self._rate:
                held.append(one)
        self._holding = held

    def _arrived(self, one: _Holding, row: TickRow, last: bool) -> _Holding:
        """Tell whether a part that is due is there, once that is known; see `arrived`."""
        columns, q = one.goal.channels - len(POSTURE), np.array(row.q)
        off, told = self._retargeter.solver.measured(columns, one.goal.angles, q, place=isinstance(one.intent, Hand))
        tolerance = max(one.intent.tolerance, LEAST_M if isinstance(one.intent, Hand) else LEAST_RAD)
        heard = arrived(one.heard, off, tolerance, told, last=last)
        if heard is one.heard:
            return one
        return replace(one, heard=self._answers.later(heard))

    def _over(self, one: _Holding, how: Over) -> _Holding:
        """A part's target that was followed holds no longer: that is told once."""
        if not one.answered or one.heard.over is not None:
            return one
        return replace(one, heard=self._answers.later(one.heard, over=how))

    def _supersede(self, one: _Holding, how: Over) -> None:
        self._end(one, how, "superseded", "a newer target for this part came before a plan followed it")

    def _end(self, one: _Holding, how: Over, state: Fate, reason: str) -> None:
        if one.heard.over is None:  # while its part fades out, that is told already
            self._answers.ended(one.heard, answered=one.answered, over=how, state=state, reason=reason)
