"""`TargetLedger`: which target counts, how long it holds, and the one answer that every target gets."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass, replace

from flexmotion.configs.errors import ConfigError
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Halt, Heard
from flexmotion.streamer.motion.heard import State as Fate
from flexmotion.streamer.motion.intents import Stop, Text, Velocity, words_of
from flexmotion.streamer.motion.part_intents import PartIntent
from flexmotion.streamer.motion.part_words import part_of_words
from flexmotion.streamer.motion.rest import asks_for_rest, heard_as_rest
from flexmotion.streamer.motion.targets import NO_TARGET, Target, TargetReader

_ENDED = {
    State.OFF: "the torque is off: arm the robot first",
    State.PARK: "the robot lowers itself (PARK), then its torque goes off: arm it after that",
    State.DAMPED: "the robot has fallen and gives way (DAMPED)",
    State.FAULT: "the robot is in FAULT: clear the fault, then arm the robot",
    State.GET_UP: "the robot gets up (GET_UP): wait until it stands",
}
"""States in which no target is followed, and why."""
_STOPPED_OFF = (
    "the torque is off, and a stop is in force: release the stop (on the page: Release stop; in a terminal: flexmotion "
    "clear), then arm the robot"
)
_STOPPED = "stopped: release the stop first (on the page: Release stop; in a terminal: flexmotion clear)"
_FAULTED = "a fault is latched: wait until the torque is off, then clear the fault and arm the robot"
_FAULTED_PARK = (
    "a fault is latched: the robot lowers itself (PARK), then its torque goes off; after that clear the fault and arm "
    "the robot"
)
_LIMP = "a joint is without torque on request (flexmotion status names it): make it stiff first"


def tell_unfollowed(
    target: Target, state: str, reason: str, publish: Callable[[Heard], None], on_note: Callable[[str], None]
) -> None:
    """Answer a target that no plan follows.

    Args:
        target: which.
        state: of the answer; reason: for it.
        publish: is given the answer; on_note: a message for the operator.
    """
    heard = Heard.model_validate({"id": target.id, "asked": words_of(target.intent), "state": state, "reason": reason})
    publish(heard)
    on_note(str(heard.told() or f"{heard.asked}: {reason}"))


def not_held(part: str, held: Iterable[str]) -> ConfigError:
    """The error of a `Relax` of what is asked for nothing; `held`: what it could let go."""
    known = ", ".join(dict.fromkeys(held))
    expected = f"expected all, or one of: {known}" if known else "nothing holds"
    return ConfigError(f"relax: {part!r} is asked for nothing; {expected}")


def ended_by(row: TickRow) -> str | None:
    """Why no target is followed in the state of the loop; None: targets are followed."""
    state = State(int(row.state))
    if not (bool(row.must_stop) or state in _ENDED):
        return None
    if bool(row.faulted) and state in (State.PARK, State.READY, State.STREAMING, State.HOLD):
        return _FAULTED_PARK if state is State.PARK else _FAULTED
    if state is State.OFF and bool(row.must_stop):
        return _STOPPED_OFF
    return _ENDED.get(state, _LIMP if row.limp.any() else _STOPPED)


def halts(row: TickRow) -> bool:
    """Whether the state of the loop ends what was asked for.

    Before it stands nothing has ended: the robot will follow what its run was started with, whether it was armed or
    gets up first. A stop ends it then too; a fall and a fault halt in states of their own.
    """
    return ended_by(row) is not None and (bool(row.must_stop) or State(int(row.state)) not in (State.OFF, State.GET_UP))


@dataclass(frozen=True)
class _Entry:
    """A target with the time at which it was sent, on the ledger's clock [s]."""

    target: Target
    born_s: float
    heard: Heard | None = None
    """How the source understands it; None: as it is."""
    rests: tuple[str, ...] | None = None
    """How the run goes on after the stand by which it is followed; None: the source itself follows it."""

    def age_s(self, now_s: float) -> float:
        return now_s - self.born_s


class TargetLedger:
    """The planner's record of targets.

    A target is open until the source follows it, planned until the loop has taken a plan that follows it, and then
    followed. It is answered once: on that, or when it is superseded, expired or refused.

    Args:
        inbox: targets of all senders.
        publish: is given the answer to every target, once.
        on_note: called with a message for the operator.
        rate_hz: ticks a second.
        change_s: shortest time between two changes of what is followed [s]; a stop does not wait for it.
        lockstep: ages are counted in ticks, not by the clock.
        on_part: is given the targets for one part of the body, which replace no others, and when each was sent, on the
            ledger's clock [s].

    Attributes:
        halted: a stop was in force, or the time of the followed target is over: the robot comes to a stand, and stands
            until a new target arrives. What was asked for before does not go on by itself. None: it goes on.
        answer: to the target that the robot follows; None: none yet.
    """

    def __init__(
        self,
        inbox: TargetReader,
        publish: Callable[[Heard], None],
        on_note: Callable[[str], None],
        *,
        rate_hz: float,
        change_s: float,
        lockstep: bool,
        on_part: Callable[[Target, float], None] = lambda _target, _born_s: None,
    ) -> None:
        self.publish, self.on_note, self.on_part = publish, on_note, on_part
        self.halted: Halt | None = None
        self.answer: Heard | None = None
        self._inbox, self._rate_hz, self._lockstep = inbox, rate_hz, lockstep
        self._tick, self._change_s, self._turned_s = 0, change_s, -math.inf
        self._cut: str | None = None  # why the followed target is over before its time, until that is told
        # `_turned_s`, `halted` and `_cut` before the last turn
        self._before: tuple[float, Halt | None, str | None] = (-math.inf, None, None)
        self._gave_way = self._gives_way = False
        self._open: _Entry | None = None
        self._planned: _Entry | None = None
        self._displaced: _Entry | None = None  # planned before the last turn, which may still be taken back
        self._followed: _Entry | None = None
        self._sent_again = 0  # the newest target that only made the followed one hold longer

    @property
    def has_new(self) -> bool:
        """Whether a target has arrived that was not taken yet."""
        return self._inbox.has_new

    @property
    def has_target(self) -> bool:
        """Whether a target has arrived, or is open, which the source may turn to now."""
        return self._inbox.has_new or (self._open is not None and self._may_turn_to(self._open))

    @property
    def wanted(self) -> Target:
        """The target that plans should follow; `NO_TARGET` if there is none."""
        entry = self._planned or (None if self.halted else self._followed)
        if self._open is not None and self._may_turn_to(self._open):
            entry = self._open
        return NO_TARGET if entry is None else entry.target

    def _may_turn_to(self, entry: _Entry) -> bool:
        """Whether the source may turn to an open target now; a stand sent again waits for the plan of the first."""
        return self._may_change(entry.target) and not _rests_again(self._planned, entry.target)

    def _may_change(self, target: Target) -> bool:
        """Whether the source may turn to a target now.

        Each change cuts the motion and gets a short plan first, and steps are settled further ahead than that reaches.
        In floods the robot fell: no step was begun any more, or a step was carried out for a motion that had
        changed (docs/decisions.md).
        """
        if self.halted or isinstance(target.intent, Stop):
            return True
        return self.now_s() - self._turned_s >= self._change_s

    def take(self, tick: int | None = None) -> None:
        """Take the targets that have arrived; of those that are still open the newest counts.

        Args:
            tick: that the loop does next; None: the one of the last call.
        """
        self._tick = self._tick if tick is None else tick
        for target in self._inbox.read():
            born_s = self._tick / self._rate_hz if self._lockstep else target.stamp_ns * 1e-9
            if isinstance(target.intent, PartIntent) or part_of_words(target.intent) is not None:
                self.on_part(target, born_s)
                continue
            if self._open is not None:
                self._publish(self._open, "superseded", "a newer target came before a plan followed it")
            self._open = _Entry(target, born_s)

    def settle(self, row: TickRow, taken: int, start_of: Callable[[int], int]) -> None:
        """Answer the targets whose fate is known, and end the followed one where its time is over.

        Args:
            row: newest one of the loop.
            taken: newest target that a plan of the loop follows, or an accepted plan will.
            start_of: gives the first tick of the plan by which the loop follows a target.
        """
        now_s, ended = self.now_s(), ended_by(row)
        if ended is not None:
            if halts(row):
                self.halted = self.halted or "stopped"
            self._take_back(int(row.target), ended)
            self.refuse_all(ended)
            return
        self._answer_displaced(taken, start_of)
        planned, opened, followed = self._planned, self._open, self._followed
        if planned is not None and planned.target.id <= taken:
            self.answer = self._publish(planned, None, tick=start_of(planned.target.id))
            self._followed, self._planned, planned = planned, None, None
            followed = self._followed
        if planned is not None and self._too_old(planned, now_s):
            # The loop has refused every plan that follows it; the source has turned to it all the same.
            self._publish(planned, "expired", _late(planned.target))
            self._planned, self.halted = None, "expired"
        if opened is not None and self._too_old(opened, now_s):
            self._publish(opened, "expired", _late(opened.target))
            self._open = opened = None
        self._tell_cut()
        if followed is None or self._planned is not None:
            return
        if self.halted and opened is not None and bool(row.plan) and _rests_again(followed, opened.target):
            # A plan for each would put the stand off, for as long as a stick at rest is sent.
            heard = heard_as_rest(opened.target.intent, *(followed.rests or ()))
            self._publish(replace(opened, heard=heard), None, "goes on as before", self._tick)
            self._sent_again, self._open = opened.target.id, None
        if self.halted:
            return
        again = opened is not None and isinstance(opened.target.intent, Velocity)
        if opened is not None and again and opened.target.intent == followed.target.intent:
            # Sent again, as by a stick that is held: it holds longer, and no plan is cut short for it.
            self._publish(replace(opened, heard=followed.heard), None, "goes on as before", self._tick)
            self._sent_again = opened.target.id
            self._followed = replace(
                followed,
                target=replace(followed.target, holds_s=opened.target.holds_s),
                born_s=opened.born_s,
            )
            self._open = None
        elif followed.age_s(now_s) > followed.target.holds_s:
            self.halted = "expired"
            self.on_note(f"target {followed.target.id} is over after {followed.target.holds_s:g} s: coming to a stand")

    def cut(self, reason: str) -> None:
        """What is followed, or planned, is over before its time; told once the runner has told what it measured of it.

        Args:
            reason: why.
        """
        self.halted, self._cut = "stopped", reason

    def _tell_cut(self) -> None:
        """Tell that the followed target is over, to whom it was answered last."""
        if self._cut is None or self._planned is not None or self.answer is None:
            return
        reason, self._cut = self._cut, None
        if self.answer.state not in ("refused", "superseded", "expired"):
            self.answer = self.answer.model_copy(update={"over": "stopped", "reason": reason})
            self.publish(self.answer.model_copy(update={"id": max(self.answer.id, self._sent_again)}))

    def _take_back(self, begun: int, reason: str) -> None:
        """Refuse, by a later version, a target whose plan only waited when the stop came: the loop has dropped it.

        Args:
            begun: newest target of which a plan was played.
        """
        if self.answer is not None and begun < self.answer.id and self.answer.state != "refused":
            self.answer = self.answer.model_copy(update={"state": "refused", "reason": reason})
            self.publish(self.answer)

    def turned(
        self, target: Target, heard: Heard | None, *, goes_on: bool = False, rests: tuple[str, ...] | None = None
    ) -> None:
        """The source follows a target from now on.

        Args:
            target: which.
            heard: how the source understands it; None: as it is.
            goes_on: whether it changes the speed of what is under way, which ends no later than it would have.
            rests: how the run goes on after a stand that the source does not know; None: the source follows it.
        """
        under_way = self._planned or self._followed
        if goes_on and under_way is not None:
            left_s = under_way.target.holds_s - under_way.age_s(self.now_s())
            if math.isfinite(left_s) and self._open is not None and self._open.target.id == target.id:
                holds_s = min(target.holds_s, self._open.age_s(self.now_s()) + left_s)
                self._open = replace(self._open, target=replace(self._open.target, holds_s=holds_s))
                heard = heard if heard is None else heard.model_copy(update={"left_s": left_s})
        self._before = (self._turned_s, self.halted, self._cut)
        self.halted = self._cut = None
        self._gives_way, self._gave_way = not self._gave_way, False
        if self._open is not None and self._open.target.id == target.id:
            self._turned_s = self.now_s()
        if self._planned is not None and self._planned.target.id != target.id:
            # Answered once it is certain that this turn stays.
            self._displaced, self._planned = self._planned, None
        if self._open is not None and self._open.target.id == target.id:
            self._planned, self._open = replace(self._open, heard=heard, rests=rests), None

    def amend(self, target: int, change: Callable[[Heard], Heard]) -> bool:
        """Change the answer to a target, for what its plan has shown: before it is given, or by a later version.

        Returns:
            Whether it is planned or followed.
        """
        planned, answer = self._planned, self.answer
        if planned is not None and planned.target.id == target:
            words = words_of(planned.target.intent)
            heard = Heard(asked=words, state="accepted", heard_as=words) if planned.heard is None else planned.heard
            self._planned = replace(planned, heard=change(heard))
            return True
        if answer is None or answer.id != target:
            return False
        self.answer = change(answer)
        self.publish(self.answer)
        return True

    def replaces(self, target: Target) -> bool:
        """Whether a newer target than the one that the source has just turned to is open, and its plan may be given up.

        The first plan for a target is given up for the next one, so that two in quick succession are one change and the
        newer does not wait. The plan for that one is finished: frequent targets would leave no plan at all.
        """
        planned, opened = self._planned, self._open
        if not self._gives_way or planned is None or planned.target.id != target.id or opened is None:
            return False
        if _rests_again(planned, opened.target):
            return False
        # A velocity that is sent again only holds longer, and a stand that is asked for again is under way. Words ask
        # for the motion anew: the second of two at once waited for `change_s`, and then cut short what had just begun.
        return isinstance(target.intent, Text) or opened.target.intent != target.intent

    def give_way(self) -> None:
        """The source has taken back its turn to the last target, which no plan follows; the newer one is due.

        The target before it is planned again: its plan may be played, and it is what the source follows.
        """
        if self._planned is not None:
            self._publish(self._planned, "superseded", "a newer target came before its plan was made")
        self._planned, self._displaced, self._gave_way = self._displaced, None, True
        self._turned_s, self.halted, self._cut = self._before

    def refuse(self, target: Target, reason: str) -> None:
        """The source cannot follow a target."""
        if self._open is not None and self._open.target.id == target.id:
            self._publish(self._open, "refused", reason)
            self._open = None

    def refuse_all(self, reason: str) -> None:
        """No target can be followed."""
        for entry in (self._displaced, self._planned, self._open):
            if entry is not None:
                self._publish(entry, "refused", reason)
        self._displaced = self._planned = self._open = None

    def drop_old(self, answered: Container[int], reason: str) -> None:
        """Refuse the targets that an earlier planner had and did not answer."""
        for target in self._inbox.read():
            if target.id not in answered:
                self._publish(_Entry(target, 0.0), "refused", reason)

    def _answer_displaced(self, taken: int, start_of: Callable[[int], int]) -> None:
        """Answer the target that was planned when the source turned to another, which it stays with."""
        entry, newer, self._displaced = self._displaced, self._planned, None
        if entry is None:
            return
        if entry.target.id <= taken and (newer is None or taken < newer.target.id):
            # Its plan was taken before the next one was made.
            self._followed, self.answer = entry, self._publish(entry, None, tick=start_of(entry.target.id))
        else:
            self._publish(entry, "superseded", "a newer target came before its plan was played")

    def _too_old(self, entry: _Entry, now_s: float) -> bool:
        return entry.age_s(now_s) > min(entry.target.take_up_s, entry.target.holds_s)

    def now_s(self) -> float:
        """The time on the ledger's clock [s]."""
        return self._tick / self._rate_hz if self._lockstep else time.perf_counter_ns() * 1e-9

    def _publish(self, entry: _Entry, fate: Fate | None, reason: str | None = None, tick: int | None = None) -> Heard:
        """Answer a target.

        Args:
            fate: what became of it; None: it is followed, as it was heard.
            tick: from which on it is followed.
        """
        target, asked = entry.target, words_of(entry.target.intent)
        heard = Heard(asked=asked, state="accepted", heard_as=asked) if entry.heard is None else entry.heard
        if fate is not None:
            heard = Heard(asked=asked, state=fate)
        at_s = None if tick is None else tick / self._rate_hz
        known = {"id": target.id, "tick": tick, "at_s": at_s, "reason": reason or heard.reason}
        heard = heard.model_copy(update=known)
        self.publish(heard)
        return heard


def _rests_again(entry: _Entry | None, target: Target) -> bool:
    """Whether a target asks for the stand by which an earlier one is followed already."""
    return entry is not None and entry.rests is not None and asks_for_rest(target.intent)


def _late(target: Target) -> str:
    return f"no plan followed it within {min(target.take_up_s, target.holds_s):g} s"
