"""`HeadTargets`: the target for the place of the head: which of them holds, and the one answer that each gets.

Hips and trunk bring the head there while both feet stay where they stand. Arms, hands and looks go on. It replaces no
target for the whole body; one that needs the feet ends it, and the robot rises before its first step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.errors import ConfigError
from flexmotion.retarget.part_paths import PartGoal, PartGoals
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.whole_body import POSTURE
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, Over
from flexmotion.streamer.motion.heard import State as Fate
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.part_intents import HEAD_PLACE, HeadPlace, Relax
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.answers import Answers
from flexmotion.streamer.planning.arrival import ARRIVES_S, LEAST_M, arrived
from flexmotion.streamer.planning.left import Left
from flexmotion.streamer.planning.target_ledger import ended_by, not_held

Float = NDArray[np.float64]

_LATE_S = 0.05
"""A head that is there later than asked by more than this is called slowed [s]."""
_CORRECT_S = 0.5
"""Least time between two corrections of a goal, and their time [s]."""
_OFF_M = 0.004
"""A head whose place the weight of arms has moved by more is brought back [m]: hands ahead move OP3's by 11 mm."""
_STANDS = (State.READY, State.STREAMING, State.HOLD)
"""States in which a stop leaves the robot as it is."""
_TRUNK = np.arange(len(POSTURE))
_LET_GO = f"let it go first (relax {HEAD_PLACE!r})"
_HALTED = f"a stop came: hips and trunk stay as they are until relax {HEAD_PLACE!r}, or a target for the whole body"


@dataclass(frozen=True)
class _Held:
    """The target that holds.

    Attributes:
        place: of the head by its goal, (3,) [m].
        due: tick at which it is asked to be there; until: tick at which it is over.
        corrects: tick from which its goal may be corrected for the weight of arms.
        there: tick at which it is there by the plan.
        kept: its goal could not be corrected for the weight of arms, which was told.
    """

    target: Target
    intent: HeadPlace
    goal: PartGoal
    place: Float
    due: float
    until: float
    corrects: float
    heard: Heard
    revision: int
    answered: bool = False
    there: float = math.inf
    kept: bool = False


class HeadTargets:
    """The planner's record of them.

    Args:
        retargeter: knows what is in reach.
        publish: is given the answer to every target, once; on_note: a message for the operator.

    Attributes:
        halted: a stop has ended one: hips and trunk stay as they are until something new is asked for.
    """

    def __init__(
        self, retargeter: Retargeter, publish: Callable[[Heard], None], on_note: Callable[[str], None]
    ) -> None:
        self._retargeter, self._rate = retargeter, retargeter.rate
        self._answers = Answers(retargeter.rate, publish, on_note)
        self._revisions = self._answers.revisions
        self.halted = False
        self.all_held: Callable[[], Iterable[str]] = tuple  # what holds of all records, in the names of `Relax`
        self._waiting: list[tuple[Target, float]] = []
        self._held: _Held | None = None
        self._left = Left(publish, _HALTED)
        self._all_go = False

    def take(self, target: Target, born_s: float) -> None:
        """Take a target that has arrived, and when it was sent on the planner's clock [s]."""
        self._waiting.append((target, born_s))

    def let_go(self) -> None:
        """Let the head go on a request that is answered elsewhere."""
        for target, _ in self._waiting:
            self._answers.unfollowed(target, "superseded", "it was let go right after it")
        self._waiting, self._all_go = [], True

    def update(
        self,
        row: TickRow,
        tick: float,
        now_s: float,
        playing: Plan | None,
        needed: str | None,
        caps: Mapping[int, float],
        *,
        urgent: bool = False,
    ) -> None:
        """Take what has arrived, and answer what is known.

        Args:
            row: newest one of the loop.
            tick: of the loop, at the time `now_s` of the planner's clock.
            playing: the newest plan that plays or will; None: none.
            needed: for what the robot needs its feet; None: for nothing.
            caps: torque caps that hold, by column of the joint [N·m].
            urgent: somebody waits for a plan: what takes long and can wait does.
        """
        waiting, self._waiting = self._waiting, []
        all_go, self._all_go = self._all_go, False
        ended = ended_by(row)
        if ended is not None:
            for target, _ in waiting:
                self._answers.unfollowed(target, "refused", ended)
            # Asked anew while the stop lasts: a plan that was to begin to bend the legs may never be played.
            bent = self.halted if playing is None else self._is_bent(playing, tick)
            self._halt(bent and State(int(row.state)) in _STANDS)
            self._end(ended, over="stopped")
            self._answers.nothing_holds()
            return
        self._answer(row)
        self._arrive(row, tick)
        held = self._held
        if held is not None and held.until <= tick:
            self._end(f"its time is over ({held.target.holds_s:g} s)", over="expired")
        elif needed is not None:
            self.give_way(needed)
        if all_go:
            self._rise()
        if not (urgent or waiting):
            self._correct(tick, playing)
        for target, born_s in waiting:
            if self._answers.expired(target, now_s - born_s):
                continue
            born = tick + (born_s - now_s) * self._rate
            try:
                if isinstance(target.intent, Relax):
                    self._relax(target, target.intent)
                else:
                    self._require_stand(playing, born, needed, caps)
                    self._begin(target, born, tick, playing)
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
        """The one that holds is over: the robot needs its feet.

        Args:
            state: of the answer, where it has none yet; over: how it ended, where it has one.
        """
        if self._held is not None or self.halted:
            self._revisions.change()
        self._unhalt(over)
        self._end(reason, state, over)

    def begin_with(self, plan: Plan, inherited: Sequence[Heard] = ()) -> None:
        """Go on from a plan of another process: hips and trunk stay as they are.

        Args:
            inherited: the answer of that process to the target that held, where one did.
        """
        self.halted = self._is_bent(plan, plan.end_tick)
        for heard in inherited:
            self._leave(heard)

    def rise_if_halted(self) -> None:
        """A robot that a stop has left with bent legs may stand upright: something new is asked of the whole body."""
        if self.halted:
            self._unhalt("superseded")
            self._revisions.change()

    def with_goal(self, goals: PartGoals) -> PartGoals:
        """What arms and head are to do, and where the head is to be, for the retargeter."""
        own = [] if self._held is None else [self._held.goal]
        return replace(goals, goals=[*goals.goals, *own], halts=self.halted)

    @property
    def newest(self) -> int:
        """Id of the target that holds; 0: none."""
        return 0 if self._held is None else self._held.target.id

    @property
    def stays(self) -> str | None:
        """Why the feet stay where they are, and the legs are bent; None: they are not."""
        if self._held is None and not self.halted:
            return None
        return f"the head is at a place of its own: {_LET_GO}"

    def bent(self, playing: Plan | None, tick: float) -> str | None:
        """Why the legs may need more than in a stand; None: they do not. Also while the robot rises.

        Args:
            playing: the newest plan that plays or will, at a tick; None: none.
        """
        if self.stays is not None or playing is None or not self._is_bent(playing, tick):
            return self.stays
        return "the robot still rises from where its head was: ask again when it stands"

    def wants(self, plan: int, tick: int) -> bool:
        """Whether a plan is due because the one with this id does not know what holds; 0: none plays."""
        if not plan and not (self._held or self._answers.waits):
            return False
        return self._revisions.wants(plan, tick)

    def made(self, plan: int, rows: Plan, playing: int, tick: int) -> None:
        """A plan was made with what holds; arguments as of `PartTargets.made`."""
        self._revisions.made(plan, playing, tick)
        held = self._held
        if held is None or held.answered:
            return
        state = self._retargeter.layout.view(rows.states[0].copy())
        if (state.part[_TRUNK] != held.goal.number).any():
            return
        due = float(state.part_due[0])
        late_s = (due - held.due) / self._rate
        slowed = f"{held.intent.in_s + late_s:.2f} s until it is there" if late_s > _LATE_S else None
        answer = "moved" if held.heard.moved else "slowed" if slowed else "accepted"
        heard = held.heard.model_copy(update={"slowed": slowed, "state": answer, "tick": rows.start_tick})
        self._held = replace(held, heard=heard, until=max(held.until, due), there=due)

    # ------------------------------------------------------------------ targets

    def _require_stand(self, playing: Plan | None, born: float, needed: str | None, caps: Mapping[int, float]) -> None:
        """Raises `ConfigError` where no head can be brought to a place now, wherever that is."""
        robot, legs = self._retargeter.robot, self._retargeter.legs
        steps = playing is not None and any(step.land > born for step in self._retargeter.steps_of(playing))
        if needed is not None or steps:
            raise ConfigError(f"{HEAD_PLACE}: the robot walks, or makes a step: expected one that stands (hold)")
        capped = [robot.joint_names[int(joint)] for joint in legs if int(joint) in caps]
        if capped:
            raise ConfigError(f"{HEAD_PLACE}: the torque of {', '.join(capped)} is capped: let it go first")

    def _begin(self, target: Target, born: float, tick: float, playing: Plan | None) -> None:
        """Let a target hold. Raises `ConfigError` where it cannot be followed; names what is valid."""
        intent, retargeter = target.intent, self._retargeter
        assert isinstance(intent, HeadPlace)
        if target.holds_s <= intent.in_s:
            raise ConfigError(
                f"{HEAD_PLACE}: it holds {target.holds_s:g} s only, expected more than the {intent.in_s:g} s"
            )
        state, places, upper = self._state(playing, tick), retargeter.head_places, self._arms(playing, tick)
        found = places.nearest(intent.place, intent.tolerance, state.feet, upper)
        least_s, back_s = self._seconds(state, found.channels, upper)
        due, until = born + intent.in_s * self._rate, born + target.holds_s * self._rate
        goal = PartGoal(target.id, _TRUNK, found.channels, due, until, least_s=least_s, back_s=back_s)
        words = words_of(intent)
        heard = Heard(id=target.id, asked=words, state="accepted", heard_as=HEAD_PLACE, moved=found.moved, holds="part")
        self._supersede("superseded")
        self._unhalt("superseded")
        place = places.place(found.channels, state.feet, upper)
        corrects = goal.due + _CORRECT_S * self._rate
        self._held = _Held(target, intent, goal, place, goal.due, goal.until, corrects, heard, self._revisions.change())

    def _correct(self, tick: float, playing: Plan | None) -> None:
        """Bring the head back to its place where the weight of arms that have moved since has taken it from there."""
        held = self._held
        if held is None or not held.answered or playing is None or tick < held.corrects:
            return
        places, state, upper = self._retargeter.head_places, self._state(playing, tick), self._arms(playing, tick)
        feet, soon = state.feet, tick + _CORRECT_S * self._rate
        held = replace(held, corrects=soon)
        if np.linalg.norm(places.place(held.goal.angles, feet, upper) - held.place) > _OFF_M:
            try:
                found = places.nearest(held.intent.place, np.inf, feet, upper, held.goal.angles)
                least_s, back_s = self._seconds(state, found.channels, upper)
            except ConfigError as error:
                if not held.kept:
                    self._answers.on_note(f"{HEAD_PLACE}: the weight of the arms is not made up for: {error}")
                self._held = replace(held, kept=True)
                return
            due = min(soon, held.goal.until)
            goal = replace(held.goal, angles=found.channels, due=due, least_s=least_s, back_s=back_s)
            held = replace(held, goal=goal, place=places.place(found.channels, feet, upper), kept=False)
            self._revisions.change()
        self._held = held

    def _seconds(self, state: RetargetState, goal: Float, upper: Float) -> tuple[float, float]:
        """Least times for the way from a state to a posture, and from there to the stand [s]; `HeadPlaces.seconds`."""
        places, upright = (
            self._retargeter.head_places,
            np.array([self._retargeter.gait.stand_hip_height, 0, 0, goal[3]]),
        )
        there = places.seconds(state.position[_TRUNK], goal, state.feet, upper)
        return there, places.seconds(goal, upright, state.feet, upper)

    def _state(self, playing: Plan | None, tick: float) -> RetargetState:
        """The state of a plan at a tick; None: of the stand."""
        retargeter = self._retargeter
        if playing is None:
            return retargeter.layout.view(retargeter.standing())
        row = int(np.clip(np.ceil(tick) - playing.start_tick, 0, len(playing) - 1))
        return retargeter.layout.view(playing.states[row].copy())

    def _arms(self, playing: Plan | None, tick: float) -> Float:
        """Mean of the angles of arms and head over the next second of a plan, by `UpperBody.joints`, (C,) [rad]."""
        robot, upper = self._retargeter.robot, self._retargeter.body.upper.joints
        if playing is None:
            return np.asarray(robot.stand_pose[upper])
        row = int(np.clip(np.ceil(tick) - playing.start_tick, 0, len(playing) - 1))
        return np.asarray(playing.q[row : row + round(self._rate), upper].mean(axis=0))

    def _relax(self, target: Target, intent: Relax) -> None:
        if self._held is None and not self.halted:
            raise not_held(intent.part, self.all_held())
        self._rise()
        self._answers.relaxed(target)

    def _rise(self) -> None:
        if self._held is not None or self.halted:
            self._revisions.change()
        self._supersede("let go")
        self._unhalt("let go")

    def _is_bent(self, plan: Plan, tick: float) -> bool:
        """Whether a plan leads hips and trunk at a tick, to a place or back."""
        return bool(self._retargeter.parts.led(self._state(plan, tick), tick)[0])

    # ------------------------------------------------------------------ answers

    def _arrive(self, row: TickRow, tick: float) -> None:
        """Tell whether the head is there by the measured joints, once that is known; see `arrived`."""
        held = self._held
        if held is None or not held.answered or tick < held.there:
            return
        found = self._retargeter.head_places.measured(np.array(row.q))
        off = None if found is None else float(np.linalg.norm(found - held.place))
        told = "not measured" if off is None else f"{100 * off:.1f} cm from there"
        last = tick >= min(held.there + ARRIVES_S * self._rate, held.until)
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

    def _end(self, reason: str, state: Fate = "refused", over: Over = "superseded") -> None:
        held, self._held = self._held, None
        if held is None:
            return
        if held.answered and self.halted:
            self._leave(held.heard)
            return
        self._answers.ended(held.heard, answered=held.answered, over=over, state=state, reason=reason)
        self._answers.on_note(f"over: {held.intent}: {reason}")

    def _halt(self, halts: bool) -> None:
        """A stop is in force, and hips and trunk stay where it has met them, or the robot stands upright."""
        if halts and not self.halted:
            self._answers.on_note(_HALTED)
        self.halted = halts
        if not halts:
            self._unhalt("stopped")

    def _leave(self, heard: Heard) -> None:
        """A stop has ended the target that was answered so; hips and trunk are still where it has brought them."""
        if not self.halted:
            self._answers.later(heard, over="stopped")
            return
        self._left.take(heard)

    def _unhalt(self, over: Over) -> None:
        """Hips and trunk stay as a stop has left them no longer; how that ended."""
        self.halted = False
        self._left.end(over)

    def _supersede(self, over: Over) -> None:
        """The one that holds is let go, or a newer one takes its place."""
        held, self._held = self._held, None
        if held is not None:
            reason = "a newer target for the head came before a plan followed it"
            self._answers.ended(held.heard, answered=held.answered, over=over, state="superseded", reason=reason)
