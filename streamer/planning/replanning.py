"""`Replanner`: reads the loop's newest row and makes the plan that is due; in its own process, or in lockstep."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.stream import StreamSettings
from flexmotion.drivers.realtime.ring import Ring
from flexmotion.retarget.part_paths import STOPPED_PARTS
from flexmotion.retarget.plan import Plan
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.plan_buffer import PlanBuffer, Ticket
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, HeardChannel
from flexmotion.streamer.motion.human_channel import HumanChannel
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.mirror_source import MirrorSource
from flexmotion.streamer.motion.model_source import ModelSource
from flexmotion.streamer.motion.part_intents import HEAD_PLACE, FootPlace, HeadPlace, Relax
from flexmotion.streamer.motion.part_words import part_of_words
from flexmotion.streamer.motion.programs import Step
from flexmotion.streamer.motion.replan_noise import NoisySource
from flexmotion.streamer.motion.rest import asks_for_rest
from flexmotion.streamer.motion.restriction_intents import FOOT_PARTS, Restriction
from flexmotion.streamer.motion.sources import LiveSource
from flexmotion.streamer.motion.targets import NO_TARGET, Target, TargetMailbox
from flexmotion.streamer.planning.due_plan import DuePlan
from flexmotion.streamer.planning.ease_notes import EaseNotes
from flexmotion.streamer.planning.foot_targets import FootTargets
from flexmotion.streamer.planning.gesture_way import GestureWay
from flexmotion.streamer.planning.head_targets import HeadTargets
from flexmotion.streamer.planning.heading_drift import HeadingDrift
from flexmotion.streamer.planning.lead import Kind, Lead
from flexmotion.streamer.planning.left_out import left_out
from flexmotion.streamer.planning.made_plans import MadePlans, effect_row
from flexmotion.streamer.planning.mirroring import Mirroring
from flexmotion.streamer.planning.part_targets import PartTargets
from flexmotion.streamer.planning.planner import Planner
from flexmotion.streamer.planning.push_watch import PushWatch
from flexmotion.streamer.planning.restriction_targets import RestrictionTargets
from flexmotion.streamer.planning.robot_size import RobotSize
from flexmotion.streamer.planning.source_turns import SourceTurns
from flexmotion.streamer.planning.step_runner import StepRunner
from flexmotion.streamer.planning.target_ledger import TargetLedger, halts

Float = NDArray[np.float64]


def _partly(heard: Heard, dropped: Sequence[str], note: str) -> dict[str, Any]:
    """What an answer says where something is not made; `dropped`: what, as far as that is certain."""
    state = "partly" if dropped and heard.state != "refused" else heard.state
    known = dict.fromkeys((*heard.dropped, *dropped)), dict.fromkeys((*heard.notes, note))
    return {"state": state, "dropped": tuple(known[0]), "notes": tuple(known[1])}


class Superseded(Exception):  # noqa: N818 - no error: a newer plan is needed
    """The plan that is being made is no longer needed."""


class Replanner:
    """The planner's side of the live system.

    Args:
        ticks: the loop's rows.
        targets: of the operators; refused where the source follows none.
        lead: how far ahead plans join.
        on_note: called with a message about a target that cannot be followed, or not as meant.
        heard: is sent the answer to every target, to every item of a script, and later versions of them as steps end.
        humans: is sent the human of every plan, while someone watches.
        lockstep: ages of targets are counted in ticks, not by the clock.
        turns: of the driver, ticks within which every joint is read once.

    Attributes:
        ledger, parts, feet, head, restrictions: what operators ask for; made: the plans.
        push: whether the robot was pushed.
        follows_targets: whether the source follows targets other than those that ask for a stand.
        gave_up: whether the last call of `step` gave a plan up for a more urgent one, which is due at once.
    """

    def __init__(
        self,
        planner: Planner,
        plans: PlanBuffer,
        ticks: Ring,
        settings: StreamSettings,
        targets: TargetMailbox,
        lead: Lead,
        on_note: Callable[[str], None] = lambda _message: None,
        heard: HeardChannel | None = None,
        humans: HumanChannel | None = None,
        *,
        lockstep: bool = False,
        turns: int = 1,
    ) -> None:
        self.planner, self.plans, self.ticks, self.settings = planner, plans, ticks, settings
        self.lead, self.on_note, self._lockstep = lead, on_note, lockstep
        self.restrictions = RestrictionTargets(
            planner.retargeter, self._publish, lambda message: self.on_note(message), self._stand_still, turns
        )
        self.parts = PartTargets(
            planner.retargeter,
            self._publish,
            lambda message: self.on_note(message),
            lambda: self.restrictions.restrictions.caps,
        )
        self.feet = FootTargets(planner.retargeter, self._publish, lambda message: self.on_note(message))
        self.head = HeadTargets(planner.retargeter, self._publish, lambda message: self.on_note(message))
        self.ledger = TargetLedger(
            targets.reader(),
            self._publish,
            on_note,
            rate_hz=planner.rate,
            change_s=settings.change_s,
            lockstep=lockstep,
            on_part=self._take_part,
        )
        for records in (self.restrictions, self.parts, self.feet, self.head):
            records.all_held = self._all_held
        self._drift = HeadingDrift(planner.rate)
        self.push = PushWatch(planner.rate, turns)
        self.follows_targets = isinstance(planner.source, LiveSource)
        self._succeeds = self.gave_up = False
        self._inherited: list[Heard] = []  # answers to what held when a planner died
        self.made = MadePlans(max(round(settings.commit_s * planner.rate), 1))
        self._withheld = -1  # the last target of which steps were not made
        self._looked: tuple[int, Step | None] = (0, None)  # the last step of a target of which held parts were told
        self._checked = 0  # rows of the loop that were read for a more urgent plan
        self._heard, self._humans = heard, humans
        self._ease_notes = EaseNotes(planner.retargeter.robot)
        source = planner.source.source if isinstance(planner.source, NoisySource) else planner.source
        self._runner: StepRunner | None = None
        if isinstance(source, ModelSource):
            body, home = planner.retargeter.body, np.full(planner.retargeter.robot.n, np.nan)
            home[body.upper.joints] = planner.retargeter.robot.stand_pose[body.upper.joints]
            self._runner = StepRunner(
                source,
                planner.rate,
                self._ended,
                RobotSize.of(planner.retargeter.gait, planner.retargeter.swings),
                GestureWay(planner.retargeter.robot, body.upper),
                home,
                source.body.leg / body.leg_length,
            )
        self._mirroring: Mirroring | None = None
        if isinstance(source, MirrorSource):
            self._mirroring = Mirroring(source, planner.rate, lockstep=lockstep)
        self._turns = SourceTurns(planner, self._runner, self.ledger, lambda message: self.on_note(message))
        self._due = DuePlan(
            self,
            self._runner,
            self._mirroring,
            replan_ticks=round(settings.replan_s * planner.rate),
            least_unplayed=round(settings.min_unplayed_s * planner.rate),
        )

    def step(self, tick: int, early: float = 0.0) -> bool:
        """Make and publish a plan if one is due.

        Args:
            tick: the tick that the loop does next.
            early: how long before it it is now, in [0, 1) [ticks].

        Returns:
            Whether one was made.

        Raises:
            FlexMotionError, ArithmeticError, ValueError, LookupError: source or retargeter failed.
        """
        row, self.gave_up = self._newest_row(), False
        if row is None or (self._succeeds and not self._take_over(row, tick)):
            return False
        self._drift.update(row)
        self.push.update(row, self._due.asked_tick, self.made.lands_in(row))
        if self._runner is not None:
            halted = self.ledger.halted or ("stopped" if halts(row) else None)
            self._runner.update(row, halted=halted, stands_at=partial(self._stands_at, row, tick - early))
        target = self._newest_target(row, tick)
        pose = self.made.pose(row, tick)
        stand = self.planner.retargeter.robot.stand_pose
        now_s, newest = self.ledger.now_s(), self.made.plan(int(row.pending) or int(row.plan))
        bent = partial(self.head.bent, newest, tick - early)
        self.restrictions.update(row, tick - early, now_s, self.parts.held, bent)
        self.parts.update(row, tick - early, now_s, stand if pose is None else pose)
        travels, restrictions = self._travels, self.restrictions.restrictions
        self.feet.update(row, tick - early, now_s, newest, travels, restrictions, self.head.stays)
        needed = "the robot is to walk" if travels else self.feet.comes(newest)
        urgent = self._due.urgent(row, target)
        self.head.update(row, tick - early, now_s, newest, needed, restrictions.caps, urgent=urgent)
        if self._mirroring is not None:
            self._mirroring.update(tick)
        if not self._due.now(row, target):
            return False
        begin = time.perf_counter()
        kind, new = self._due.kind(row, target), self._due.is_new(target, row)
        rests = new and self._runner is None and asks_for_rest(target.intent)
        if rests:
            kind = Kind.STOP
        now, sampling_s = tick - early, 0.0
        soon = self._mirroring is not None and not self._mirroring.resting
        join, resumed, current = self._join(kind, row, self.lead.join(kind, now, soon=soon))
        if rests:
            self._turns.to_rest(target)
            self.feet.gather()
            self.head.rise_if_halted()
        elif kind is Kind.STOP:
            target = NO_TARGET
        elif new:
            stands_at, stays = partial(self._stands_at, row, join), self.restrictions.stays
            if not self._turns.to_target(target, current, join, row, stands_at, stays):
                return False
            self.feet.gather()
            self.head.rise_if_halted()
            if self._travels:
                self.feet.give_way(f"{words_of(target.intent)!r} needs the feet", "superseded")
                self.head.give_way(f"{words_of(target.intent)!r} needs the feet", "superseded")
        elif self._runner is not None and self._runner.wanted is not None:
            self._turns.to_step(self._runner, current, join)
        elif self._mirroring is not None and self._mirroring.wanted:
            self._turns.to_person(self._mirroring.source, current, join)
        if self._mirroring is not None:
            self._mirroring.align(row, self.planner.zero_tick(join, current))

        def settle() -> tuple[int, Plan | None]:
            nonlocal join, resumed, current, sampling_s
            sampling_s = time.perf_counter() - begin
            join, resumed, current = self._join(kind, row, max(join, self.lead.join(kind, now, sampling_s, soon=soon)))
            return join, current

        try:
            planned = self.planner.plan(
                join,
                current,
                stop=kind is Kind.STOP or self._due.rests,
                partial=kind is Kind.PARTIAL,
                exact=self._runner is not None and self._runner.faces,
                parts=STOPPED_PARTS if row.must_stop else self.head.with_goal(self.parts.goals),
                restrictions=replace(restrictions, placed=self.feet.goal, astride=self.feet.astride),
                drift=self._drift.value + (0.0 if self._runner is None else self._runner.aside),
                sway=self.push.sway if kind is Kind.WHOLE else None,
                checkpoint=partial(self._check_urgency, kind, target, new, bool(row.must_stop)),
                settle=None if self._lockstep else settle,
            )
        except Superseded:
            self.gave_up = True
            if new and self.ledger.replaces(target):
                self._turns.give_up()
            return False
        self._due.asked_tick = tick
        ticket = Ticket(
            id=self.plans.newest_id + 1,
            resumed=resumed,
            asked_tick=tick,
            target=target.id,
            target_ns=target.stamp_ns,
            effect_row=-1 if current is None else effect_row(current, planned.plan),
            partial=kind is Kind.PARTIAL,
            stops=planned.stops,
            leads=self.feet.leads or (not row.must_stop and self.parts.leads(planned.plan)),
            source_over=planned.source_over
            or (self._runner is not None and self._runner.over)
            or (rests and not self.follows_targets),
            sample_s=planned.sample_s,
            retarget_s=planned.retarget_s,
            seen_ns=0 if self._mirroring is None else self._mirroring.seen_ns,
        )
        if self._mirroring is not None:
            self._mirroring.planned()
        self.made.add(ticket, planned.plan, int(row.plan))
        self.parts.made(ticket.id, planned.plan, int(row.plan), tick)
        self.feet.made(ticket.id, planned.plan, int(row.plan), tick)
        self.head.made(ticket.id, planned.plan, int(row.plan), tick)
        self.restrictions.made(ticket.id, planned.plan, int(row.plan), tick)
        self.plans.publish(ticket, planned.plan)
        self._tell_eased(planned.plan, target.id)
        self._tell_withheld(planned.plan, target.id)
        self._tell_held(target.id)
        self.lead.record(kind, sampling_s, time.perf_counter() - begin - sampling_s)
        if self._humans is not None and self._humans.watched and planned.plan.human is not None:
            self._humans.publish(ticket.id, planned.plan.human, planned.plan.human_first_frame)
        return True

    def _tell_eased(self, plan: Plan, target: int) -> None:
        """Tell where a plan had to be eased; a target that is refused for it is followed no longer."""
        note = self._ease_notes.of(plan, target)
        if note is not None:
            self.on_note(note.message)
            if target:
                self.ledger.amend(target, note.answer)
        # Also where that was told already: the loop may have refused the first plan that said so.
        if target and target == self.ledger.wanted.id and plan.eased is not None and plan.eased.refused:
            self.ledger.halted = "stopped"

    def _tell_withheld(self, plan: Plan, target: int) -> None:
        """Tell once for each target that steps of the motion are not made, because a foot is to stay where it is.

        The place of a foot that was asked for before the motion gives way to its steps: plans make them from now on.
        """
        if not plan.withheld or self._withheld == target:
            return
        stays = self.restrictions.stays
        if stays is None and 0 < self.feet.newest < target:
            self.feet.give_way("the newer motion makes steps")
            return
        if stays is None and 0 < self.head.newest < target:
            self.head.give_way("the newer motion makes steps")
            return
        stays = stays or self.feet.stays or self.head.stays
        if stays is None:
            return
        self._withheld = target
        note = f"without steps: {stays}"
        self.on_note(note)
        if target:
            self.ledger.amend(target, lambda heard: heard.model_copy(update=_partly(heard, ["steps"], note)))

    def _tell_held(self, target: int) -> None:
        """Tell once for each step of a target which of the parts that it moves an older target holds."""
        step = None if self._runner is None else self._runner.under_way
        if step is None or not target or (self._looked[0] == target and self._looked[1] is step):
            return
        self._looked = target, step
        self._tell_left_out(step.kind, target)
        if step.told.beside is not None:
            self._tell_left_out(step.told.beside, target)

    def _tell_left_out(self, kind: str, target: int) -> None:
        missing, perhaps = left_out(kind, self.parts.holding(target))
        if not (missing or perhaps):
            return
        held = "; ".join(f"{part} held: let it go first (relax {part!r})" for part in (*missing, *perhaps))
        note = f"{kind} without {', '.join(missing)}: {held}" if missing else held
        self.on_note(note)
        self.ledger.amend(target, lambda heard: heard.model_copy(update=_partly(heard, missing, note)))

    def _take_part(self, target: Target, born_s: float) -> None:
        """Take a target for arms, head or feet, or one that restricts the robot; see `TargetLedger`."""
        intent = part_of_words(target.intent) or target.intent
        late = target.too_late(self.ledger.now_s() - born_s)
        if isinstance(intent, HeadPlace) or intent == Relax(HEAD_PLACE):
            self.head.take(target, born_s)
            return
        if isinstance(intent, FootPlace):
            self.feet.take(target, born_s)
            return
        if isinstance(intent, Relax) and intent.lifts:
            placed = self.feet.holds(intent.part)
            if placed and not self.restrictions.keeps(intent.part):
                self.feet.take(target, born_s)
                return
            if placed and not late:
                self.feet.let_go(intent.part)
            self.restrictions.take(target, born_s)
            return
        if isinstance(intent, Restriction):
            self.restrictions.take(target, born_s)
            return
        if intent == Relax() and not late:
            self.restrictions.let_all_go()
            self.feet.let_go(intent.part)
            self.head.let_go()
        self.parts.take(target, born_s)

    def _all_held(self) -> list[str]:
        """What holds, in the names that `Relax` takes."""
        known = [] if self._heard is None else self._heard.held
        return [name for heard in known for name in str(heard.heard_as).split(", ")]

    def _stand_still(self, reason: str) -> None:
        """A foot begins to stay where it is: a robot that walks comes to a stand, and what it walked for is over."""
        if self._travels:
            self.ledger.cut(reason)
            self.on_note(f"coming to a stand: {reason}")

    @property
    def _travels(self) -> bool:
        """Whether the robot is asked to move from its place, or to turn, and that is not over."""
        return self._runner is not None and self._runner.travels and not self.ledger.halted

    @property
    def has_target(self) -> bool:
        """Whether a target waits for its plan; else nothing is due before the loop's next row."""
        return self.ledger.has_target

    def warm_up(self) -> None:
        """Plan once from the stand pose and drop the plan, so that the first real one takes no longer than others."""
        self.planner.plan(0, None)

    def succeed(self) -> None:
        """Called in a new process where another one died: go on from the plan that plays, or stand until a target."""
        self._succeeds = True
        if self._heard is not None:
            self.ledger.drop_old(self._heard.answered(), "the planner was started again; send it again")
            self._inherited = self._heard.held

    def _take_over(self, row: TickRow, tick: int) -> bool:
        """Take over from a planner that died, once the robot stands; returns whether that is done.

        The pose is that of the plan that plays, at its end. The human of that planner is lost: the next one begins from
        a stand, wherever the robot is. Until a new target arrives the robot stands, also where no plan plays: what the
        run was started with does not begin by itself after a failure, though no plan was made for it yet.
        """
        self.ledger.take(tick)
        plays = bool(row.plan or row.pending)
        heads = [one for one in self._inherited if one.heard_as == HEAD_PLACE and plays]
        feet = [one for one in self._inherited if one.holds == "part" and one.heard_as in FOOT_PARTS.values() and plays]
        stay = [*heads, *feet]
        over = [one for one in self._inherited if not plays or (one.holds == "part" and one not in stay)]
        self._inherited = [one for one in self._inherited if one not in over]
        for heard in over:
            self._publish(heard.model_copy(update={"over": "stopped"}))
        reason = "the planner was started again, and the robot does not stand yet"
        self.ledger.refuse_all(reason)
        self.parts.refuse_all(reason)
        self.feet.refuse_all(reason)
        self.head.refuse_all(reason)
        self.restrictions.refuse_all(reason)
        if not row.plan and not row.pending:
            self._succeeds, self.ledger.halted = not row.ready, "stopped"
            return not self._succeeds
        offer = self.plans.playing()
        if int(row.state) != State.HOLD or row.pending or offer is None or offer.ticket.id != int(row.plan):
            return False
        plan = self.planner.without_human(offer.plan)
        self.made.begin_with(offer.ticket, plan)
        self.parts.begin_with(plan)
        self.feet.begin_with(plan, feet)
        self.head.begin_with(plan, heads)
        self.restrictions.begin_with(offer.ticket.id, plan, [one for one in self._inherited if one not in stay])
        self._succeeds, self.ledger.halted = False, "stopped"
        return True

    def _join(self, kind: Kind, row: TickRow, join: int) -> tuple[int, int, Plan | None]:
        return self.made.join(join, row, redraws=kind is Kind.WHOLE)

    def _check_urgency(self, kind: Kind, target: Target, new: bool, halts: bool) -> None:
        """Raise `Superseded` if a more urgent plan is needed than the one that is being made.

        Args:
            target: that it follows; `new`: it is the first plan that does.
            halts: it obeys a stop already; a plan that stands for another reason may still lead arms.
        """
        if not (self.ledger.has_target or self.ticks.count > self._checked):
            return
        self._checked = self.ticks.count
        row = self._newest_row()
        stop = row is not None and bool(row.must_stop) and not halts
        self.ledger.take()
        redrawn = kind is Kind.WHOLE and self.ledger.wanted.id > target.id
        newer = self.ledger.replaces(target) if new else redrawn
        if stop or newer:
            raise Superseded

    def _newest_row(self) -> TickRow | None:
        latest = self.ticks.latest()
        return None if latest is None else TickRow(latest)

    def _newest_target(self, row: TickRow, tick: int) -> Target:
        """The target that plans should follow, after the answers that are due; `NO_TARGET` if there is none."""
        ledger = self.ledger
        ledger.take(tick)
        if not (self.follows_targets or asks_for_rest(ledger.wanted.intent)):
            ledger.refuse(ledger.wanted, f"{self.planner.source.name}: a source that follows no targets but a stand")
        pending = int(row.pending)
        ledger.settle(row, max(int(row.target), self.made.target_of(pending)), partial(self.made.start_of, row))
        return ledger.wanted

    def _stands_at(self, row: TickRow, tick: float) -> Float:
        """Where the robot comes to stand by a stop that is asked for at a tick, or a part of one before it.

        The stop joins by the same lead: one tick earlier, the step that is settled at the later one is not made.
        """
        join = self.lead.join(Kind.STOP, tick)
        return self.planner.stands_at(join, self.made.plan(self.made.playing_at(join, row)))

    def _ended(self, heard: Heard) -> None:
        """A step of a program has ended."""
        followed = self.ledger.answer
        if followed is not None and followed.id == heard.id:
            # Its program knows nothing of what was told of it since: why it is refused, or what is left out.
            heard = self.ledger.answer = followed.model_copy(update={"steps": heard.steps})
        last = [step for step in heard.steps if step.end is not None][-1:]
        for step in last:
            self.on_note(f"{step.text!r} of {heard.asked!r}: {step.end}, {step.done}")
        self._publish(heard)

    def _publish(self, heard: Heard) -> None:
        if self._heard is not None:
            self._heard.publish(heard)
