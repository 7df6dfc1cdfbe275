"""`FootTargets`: the target for the place of a foot: which of them holds, and the one answer that each gets.

One foot is asked for at a time: the other one stands, and its sole is the frame. A newer target, of either foot, goes
on from where the feet are then. It replaces no target for the whole body; one that needs the feet ends it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexmotion.configs.errors import ConfigError
from flexmotion.retarget.foot_goal import FootGoal
from flexmotion.retarget.measured_foot import measured_foot
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.restrictions import Restrictions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.steps import Step
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, Over
from flexmotion.streamer.motion.heard import State as Fate
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.part_intents import FootPlace, Relax
from flexmotion.streamer.motion.part_values import SIDES
from flexmotion.streamer.motion.restriction_intents import FEET, FOOT_PARTS
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.answers import Answers
from flexmotion.streamer.planning.arrival import ARRIVES_S, LEAST_M, arrived
from flexmotion.streamer.planning.left import Left
from flexmotion.streamer.planning.target_ledger import ended_by, not_held

_LATE_S = 0.05
"""A foot that is there later than asked by more than this is called slowed [s]."""
_LEFT = "a stop came: the feet stay as they are until one is relaxed, or asked for, or the whole body is"
_STANDS = (State.READY, State.STREAMING, State.HOLD)
"""States in which a stop leaves the robot where its feet are."""


@dataclass(frozen=True)
class _Held:
    """The target that holds.

    Attributes:
        until: tick at which it is over.
        lands: tick at which the foot is there by the newest plan; None: none was made yet.
    """

    target: Target
    intent: FootPlace
    goal: FootGoal
    until: float
    heard: Heard
    revision: int
    lands: float | None = None
    answered: bool = False

    @property
    def foot(self) -> str:
        """Name of the part of the body, as `relax` takes it."""
        return FOOT_PARTS[FEET[self.goal.side]]


class FootTargets:
    """The planner's record of them.

    Args:
        retargeter: knows what is in reach.
        publish: is given the answer to every target, once, and later versions; on_note: a message for the operator.

    Attributes:
        astride: a stop has ended one, or a leg may not bear a step: the feet stay as they have landed until something
            new is asked for.
    """

    def __init__(
        self, retargeter: Retargeter, publish: Callable[[Heard], None], on_note: Callable[[str], None]
    ) -> None:
        self._retargeter, self._rate = retargeter, retargeter.rate
        self._answers = Answers(retargeter.rate, publish, on_note)
        self._revisions = self._answers.revisions
        self.astride = False
        self._left = Left(publish, _LEFT)
        self.all_held: Callable[[], Iterable[str]] = tuple  # what holds of all records, in the names of `Relax`
        self._waiting: list[tuple[Target, float]] = []
        self._going: list[str] = []  # parts that were let go since the last update
        self._held: _Held | None = None
        self._gathers = 0  # revision from which on plans bring the feet side by side
        self._weak_leg = ""  # why no step can be made for the caps that hold; empty: it can

    def take(self, target: Target, born_s: float) -> None:
        """Take a target that has arrived, and when it was sent on the planner's clock [s]."""
        self._waiting.append((target, born_s))

    def holds(self, part: str) -> bool:
        """Whether a foot of a name of `Relax` is asked to be somewhere."""
        asked = [target.intent for target, _ in self._waiting] + ([] if self._held is None else [self._held.intent])
        placed = any(isinstance(intent, FootPlace) and Relax(part).ends(intent.part) for intent in asked)
        return placed or (self.astride and part in FOOT_PARTS.values())

    def let_go(self, part: str) -> None:
        """Let feet go on a request that is answered elsewhere; `part`: as of `Relax`."""
        for target, _ in [one for one in self._waiting if _is_of(one[0], part)]:
            self._answers.unfollowed(target, "superseded", "it was let go right after it")
        self._waiting = [one for one in self._waiting if not _is_of(one[0], part)]
        self._going.append(part)

    def update(
        self,
        row: TickRow,
        tick: float,
        now_s: float,
        playing: Plan | None,
        travels: bool,
        restrictions: Restrictions,
        stays: str | None = None,
    ) -> None:
        """Take what has arrived, and answer what is known.

        Args:
            row: newest one of the loop.
            tick: of the loop, at the time `now_s` of the planner's clock.
            playing: the newest plan that plays or will; None: none.
            travels: whether the robot is asked to walk or to turn.
            restrictions: that hold.
            stays: why else no foot may lift; None: it may.
        """
        waiting, self._waiting = self._waiting, []
        going, self._going = self._going, []
        self._weak_leg = self._capped(restrictions)
        ended = ended_by(row)
        if ended is not None:
            # What was let go with it is not: a step would follow the stop.
            for target, _ in waiting:
                self._answers.unfollowed(target, "refused", ended)
            unknown = self._gathers > self._revisions.known(int(row.plan), int(row.pending))
            self.astride = (self.astride or self._held is not None or unknown) and State(int(row.state)) in _STANDS
            # The plan that stops makes no step for it, and none is asked for once the stop is released.
            self._end(ended, "refused", "stopped", stays=self.astride)
            if not self.astride:
                self._left.end("stopped")
            self._answers.nothing_holds()
            return
        self._answer(row)
        for part in going:
            if self._held is None or _is_of(self._held.target, part):
                self._let_feet_go()
        self._arrive(row, tick, playing)
        held = self._held
        if held is not None and held.until <= tick:
            self.give_way(f"its time is over ({held.target.holds_s:g} s)", over="expired")
        elif travels:
            self.give_way("the robot is to walk")
        elif held is not None and held.goal.side in restrictions.planted:
            self.give_way(_kept(held.foot))
        elif held is not None and self._weak_leg and tick < (held.lands or np.inf):
            self.give_way(self._weak_leg)
        for target, born_s in waiting:
            if self._answers.expired(target, now_s - born_s):
                continue
            born = tick + (born_s - now_s) * self._rate
            try:
                if isinstance(target.intent, Relax):
                    self._relax(target, target.intent)
                else:
                    why_not = stays or self._why_not(target, born, playing, travels, restrictions.planted)
                    self._begin(target, born, why_not)
            except ConfigError as error:
                self._answers.unfollowed(target, "refused", str(error))

    def refuse_all(self, reason: str) -> None:
        """No target can be followed; the one that holds is over."""
        for target, _ in self._waiting:
            self._answers.unfollowed(target, "refused", reason)
        self._waiting = []
        self.give_way(reason, over="stopped")
        self._answers.nothing_holds()

    def give_way(self, reason: str, state: Fate = "refused", over: Over = "superseded") -> None:
        """The one that holds is over: the robot needs its feet, or may not place them.

        Args:
            state: of the answer, where it has none yet; over: how it ended, where it has one.
        """
        if self._held is not None:
            self._revisions.change()
            self.astride |= bool(self._weak_leg)
        self._end(reason, state, over)

    def begin_with(self, plan: Plan, inherited: Sequence[Heard] = ()) -> None:
        """Go on from a plan of another process: feet that it has placed stay as they are.

        Args:
            inherited: answers of that process to targets that held.
        """
        last = self._retargeter.layout.view(plan.states[-1].copy())
        self.astride = bool(last.placed[0] >= 0 or last.astride)
        for heard in inherited:
            self._left.end("superseded")
            if self.astride:
                self._left.take(heard)
            else:
                self._answers.later(heard, over="stopped")

    def gather(self) -> None:
        """Feet that a stop has left as they were may come side by side, unless a leg is too weak for a step."""
        if self._weak_leg:
            return
        if self.astride:
            self._revisions.change()
        self.astride = False
        self._left.end("superseded")

    def _end(self, reason: str, state: Fate, over: Over, *, stays: bool = False) -> None:
        held, self._held = self._held, None
        if held is None:
            return
        if held.answered and stays:
            self._left.take(held.heard)
        else:
            self._answers.ended(held.heard, answered=held.answered, over=over, state=state, reason=reason)
        self._answers.on_note(f"over: {held.intent}: {reason}")

    @property
    def goal(self) -> FootGoal | None:
        """Where a foot is to be, for the retargeter."""
        return None if self._held is None else self._held.goal

    @property
    def leads(self) -> bool:
        """Whether plans bring a foot to a place, also those that follow no human: a stop needs another one."""
        return self._held is not None

    @property
    def newest(self) -> int:
        """Id of the target that holds; 0: none."""
        return 0 if self._held is None else self._held.target.id

    @property
    def stays(self) -> str | None:
        """Why the robot makes none of its human's steps; None: it may."""
        if self._held is None:
            return None
        return f"{self._held.foot} at its own place: let it go first (relax {self._held.foot!r})"

    def wants(self, plan: int, tick: int) -> bool:
        """Whether a plan is due because the one with this id does not know what holds; 0: none plays."""
        if not plan and not (self._held or self._answers.waits):
            return False
        return self._revisions.wants(plan, tick)

    def comes(self, plan: Plan | None) -> str | None:
        """Which foot has not lifted yet for its step to a place, in words; None: none has to."""
        held = self._held
        if held is None or (plan is not None and not self.is_coming(plan)):
            return None
        return f"the {held.foot} is to be placed"

    def is_coming(self, plan: Plan) -> bool:
        """Whether the step to the place is still to be planned: a plan does not end with it."""
        return self._held is not None and not self._held.goal.is_there(plan.feet[-1])

    def made(self, plan: int, rows: Plan, playing: int, tick: int) -> None:
        """A plan was made with what holds; arguments as of `PartTargets.made`."""
        self._revisions.made(plan, playing, tick)
        held = self._held
        if held is None:
            return
        step, due = self._step(rows, held.goal), held.goal.due
        if step is not None:
            lands = float(step.land)
        elif held.goal.is_there(rows.feet[0]):
            lands = float(rows.start_tick) if held.lands is None else held.lands
        else:
            lands = max(due, float(rows.start_tick))  # its step comes in a later plan
        if held.lands is not None and abs(lands - held.lands) <= _LATE_S * self._rate:
            return
        late_s = (lands - due) / self._rate
        late = late_s > _LATE_S
        slowed = f"{held.intent.in_s + late_s:.2f} s until it is there" if late else None
        state = "moved" if held.heard.moved else "slowed" if slowed else "accepted"
        known = {} if held.answered else {"tick": rows.start_tick}
        heard = held.heard.model_copy(update={"slowed": slowed, "state": state, **known})
        if held.answered and late:
            self._answers.tell(heard)  # a later version: plans have found that its swing takes longer
        self._held = replace(held, heard=heard, lands=lands, until=max(held.until, lands))

    # ------------------------------------------------------------------ targets

    def _why_not(
        self, target: Target, born: float, playing: Plan | None, travels: bool, planted: frozenset[int]
    ) -> str | None:
        """Why a foot cannot be placed now, whatever the place; None: it can."""
        intent = target.intent
        assert isinstance(intent, FootPlace)
        side = SIDES.index(intent.side)
        if side in planted:
            return _kept(FOOT_PARTS[intent.side])
        if self._weak_leg:
            return self._weak_leg
        if travels or (playing is not None and self._steps(playing, born)):
            return "the robot walks, or makes steps of another motion: expected one that stands (hold)"
        if target.holds_s <= intent.in_s:
            return f"it holds {target.holds_s:g} s only, expected more than the {intent.in_s:g} s"
        return None

    def _begin(self, target: Target, born: float, why_not: str | None) -> None:
        """Let a target hold. Raises `ConfigError` where it cannot be followed; names what is valid."""
        intent = target.intent
        assert isinstance(intent, FootPlace)
        if why_not is not None:
            raise ConfigError(f"{FOOT_PARTS[intent.side]}: {why_not}")
        found = self._retargeter.foot_places.nearest(
            intent.side, intent.place, intent.heading, intent.tolerance, intent.tolerance_rad
        )
        due = born + intent.in_s * self._rate
        goal = FootGoal(SIDES.index(intent.side), found.ahead, found.left, found.turn, due)
        words = words_of(intent)
        part = FOOT_PARTS[intent.side]
        heard = Heard(id=target.id, asked=words, state="accepted", heard_as=part, moved=found.moved, holds="part")
        self._supersede("superseded")
        self.gather()
        until = born + target.holds_s * self._rate
        self._held = _Held(target, intent, goal, until, heard, self._revisions.change())

    def _relax(self, target: Target, intent: Relax) -> None:
        if not self.holds(intent.part):
            raise not_held(intent.part, self.all_held())
        if self._weak_leg:
            raise ConfigError(f"relax: {self._weak_leg}")
        self._let_feet_go()
        self._answers.relaxed(target)

    def _let_feet_go(self) -> None:
        apart = self._held is not None or self.astride
        self._supersede("let go")
        if not self._weak_leg:
            self._left.end("let go")
        self.gather()
        if apart:
            self._gathers = self._revisions.newest

    def _capped(self, restrictions: Restrictions) -> str:
        """Why a step cannot be made for the torque caps that hold; empty: it can.

        A step of a robot that follows no human is judged by no cap, and would go beyond it.
        """
        legs, names = self._retargeter.legs, self._retargeter.robot.joint_names
        capped = [names[joint] for joint in legs if int(joint) in restrictions.caps]
        return f"the torque of {', '.join(capped)} is capped: let it go first" if capped else ""

    def _steps(self, plan: Plan, tick: float) -> bool:
        """Whether a plan makes steps of a human from a tick on."""
        return any(step.land > tick and not step.inserted for step in self._retargeter.steps_of(plan))

    def _step(self, plan: Plan, goal: FootGoal) -> Step | None:
        """The step of a plan that brings the foot to its place; None: it makes none."""
        target = goal.pose(plan.feet[-1][1 - goal.side])
        own = (step for step in self._retargeter.steps_of(plan) if step.side == goal.side)
        return next((step for step in own if np.abs(step.target - target).max() < 1e-6), None)

    # ------------------------------------------------------------------ answers

    def _arrive(self, row: TickRow, tick: float, playing: Plan | None) -> None:
        """Tell whether the foot is there, once that is known; see `arrived`."""
        held = self._held
        if held is None or playing is None or held.lands is None or not held.answered or tick < held.lands:
            return
        planned = min(int(tick) - playing.start_tick, len(playing.feet) - 1)
        if planned < 0 or not held.goal.is_there(playing.feet[planned]):
            return  # its step is still to come
        goal, found = held.goal, measured_foot(self._retargeter.robot, held.goal.side, np.array(row.q))
        off = None if found is None else float(np.hypot(found[0] - goal.ahead, found[1] - goal.left))
        told = "not measured" if off is None else f"{100 * off:.1f} cm from there"
        last = tick >= min(held.lands + ARRIVES_S * self._rate, held.until)
        heard = arrived(held.heard, off, max(held.intent.tolerance, LEAST_M), told, last=last)
        if heard is not held.heard:
            self._held = replace(held, heard=heard)
            self._answers.later(heard)

    def _answer(self, row: TickRow) -> None:
        """Answer what the loop has taken a plan for."""
        known, held = self._answers.taken(row), self._held
        if held is not None and not held.answered and held.heard.tick is not None and known >= held.revision:
            heard = self._answers.followed(held.heard)
            self._held = replace(held, heard=heard, answered=True)
            self._answers.tell(heard)

    def _supersede(self, over: Over) -> None:
        """The one that holds is let go, or a newer one takes its place."""
        held, self._held = self._held, None
        if held is None:
            return
        self._revisions.change()
        self.astride |= bool(self._weak_leg)
        reason = "a newer target for a foot came before a plan followed it"
        self._answers.ended(held.heard, answered=held.answered, over=over, state="superseded", reason=reason)


def _is_of(target: Target, part: str) -> bool:
    return isinstance(target.intent, FootPlace) and Relax(part).ends(target.intent.part)


def _kept(foot: str) -> str:
    return f"it is kept down: let it go first (relax {foot!r})"
