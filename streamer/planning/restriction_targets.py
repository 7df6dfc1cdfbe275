"""`RestrictionTargets`: the targets that restrict what the robot does: feet that stay down, torque caps, tension.

They replace no target and move nothing. Each is checked when it arrives; every plan is given all that hold
(`restrictions`). They hold until they are let go, or their time is over, through a STOP too; without torque they end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.tension import LIMBS
from flexmotion.configs.errors import ConfigError
from flexmotion.retarget.joint_names import joints_named
from flexmotion.retarget.plan import Plan
from flexmotion.retarget.restrictions import Restrictions
from flexmotion.retarget.retargeter import Retargeter
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, Over
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.part_intents import Relax
from flexmotion.streamer.motion.part_values import require_choice
from flexmotion.streamer.motion.part_words import part_of_words
from flexmotion.streamer.motion.restriction_intents import (
    FEET,
    FOOT_PARTS,
    TENSION,
    TENSION_LIMBS,
    TORQUE,
    Contact,
    Restriction,
    Tension,
    TorqueCap,
)
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.answers import Answers
from flexmotion.streamer.planning.target_ledger import ended_by, not_held

Float = NDArray[np.float64]

_LATE_S = 0.05
"""A foot that is down later than asked by more than this is called slowed [s]."""
_WITHOUT_TORQUE = (State.OFF, State.PARK, State.DAMPED, State.FAULT, State.GET_UP)
"""States in which restrictions end: the robot does not stand, or will stand elsewhere."""


@dataclass(frozen=True)
class _Inherited:
    """What the plan of a planner that died was restricted by, until the loop plays one of this planner.

    Attributes:
        plan: its id.
        binds: feet, columns of joints and limbs that are restricted, by the kind of restriction.
        words: names of all; heard: the answers to their targets.
    """

    plan: int
    binds: Mapping[type[Restriction], frozenset[int]]
    words: str
    heard: Sequence[Heard]


@dataclass(frozen=True)
class _Held:
    """A restriction that holds.

    Attributes:
        binds: the feet (0 left, 1 right), columns of joints or limbs (of `LIMBS`) that it holds for; newer ones take
            them over.
        until: tick at which it is over.
        born: tick at which it was sent.
        displaced: what held before, and what of it this one has taken over. It holds again where a stop comes before
            this one is answered: the plan that stops knows no more.
    """

    target: Target
    intent: Restriction
    binds: frozenset[int]
    born: float
    until: float
    heard: Heard
    revision: int
    displaced: tuple[tuple[_Held, frozenset[int]], ...] = ()
    answered: bool = False


class RestrictionTargets:
    """The planner's record of restrictions.

    Args:
        retargeter: knows what standing needs.
        turns: of the driver, ticks within which every joint is read once.
        publish: is given the answer to every target, once; on_note: a message for the operator.
        on_planted: called when a foot begins to stay where it is, with the reason for whoever walks.
    """

    def __init__(
        self,
        retargeter: Retargeter,
        publish: Callable[[Heard], None],
        on_note: Callable[[str], None],
        on_planted: Callable[[str], None],
        turns: int = 1,
    ) -> None:
        self._retargeter, self._on_planted = retargeter, on_planted
        self._rate, self._turns = retargeter.rate, turns
        self._answers = Answers(retargeter.rate, publish, on_note)
        self._revisions = self._answers.revisions
        self.all_held: Callable[[], Iterable[str]] = tuple  # what holds of all records, in the names of `Relax`
        self._waiting: list[tuple[Target, float]] = []
        self._held: list[_Held] = []
        self._inherited: _Inherited | None = None
        self._all_go = False

    def take(self, target: Target, born_s: float) -> None:
        """Take a target that has arrived, and when it was sent on the planner's clock [s]."""
        self._waiting.append((target, born_s))

    def let_all_go(self) -> None:
        """All that restricts the robot is to end, on a request that is answered elsewhere."""
        self._all_go = True
        for target, _ in self._waiting:  # they came before
            self._answers.unfollowed(target, "superseded", "it was let go right after it")
        self._waiting = []

    def update(
        self, row: TickRow, tick: float, now_s: float, upper: Float, bent: Callable[[], str | None] = lambda: None
    ) -> None:
        """Take what has arrived, and answer what is known.

        Args:
            row: newest one of the loop.
            tick: of the loop, at the time `now_s` of the planner's clock.
            upper: angles at which arms and head are held, by `UpperBody.joints`, (C,) [rad].
            bent: gives why legs need more torque than a stand does, so that none can be capped; None: they do not.
        """
        ended = ended_by(row)
        self._outlive(row)
        waiting, self._waiting = self._waiting, []
        all_go, self._all_go = self._all_go, False
        if ended is not None:
            for target, _ in waiting:
                self._answers.unfollowed(target, "refused", ended)
            without_torque = State(int(row.state)) in _WITHOUT_TORQUE
            # A stop is made by a plan that knows no more than what was answered.
            self._end(ended, [] if without_torque else self._certain(tick))
            return
        self._answer(row)
        if all_go:
            self._keep([], "let go")
            if self._inherited is not None:
                self._revisions.change()
        if any(one.until <= tick for one in self._held):
            self._answers.on_note(f"over: {', '.join(str(one.intent) for one in self._held if one.until <= tick)}")
            self._keep([one for one in self._held if one.until > tick], "expired")
        for target, born_s in waiting:
            if self._answers.expired(target, now_s - born_s):
                continue
            try:
                self._begin(target, tick + (born_s - now_s) * self._rate, upper, bent)
            except ConfigError as error:
                self._answers.unfollowed(target, "refused", str(error))

    def refuse_all(self, reason: str) -> None:
        """No target can be followed."""
        for target, _ in self._waiting:
            self._answers.unfollowed(target, "refused", reason)
        self._waiting, self._all_go = [], False

    def begin_with(self, number: int, plan: Plan, heard: Sequence[Heard] = ()) -> None:
        """Go on from a plan of another process, whose restrictions last as long as the loop plays it.

        Its caps of arms and head stay in the loop meanwhile: after a failure none of them gets stronger before somebody
        asks for something.

        Args:
            number: of the plan; heard: the answers to the targets that it was restricted by.
        """
        names = self._retargeter.robot.joint_names
        joints = np.flatnonzero(np.isfinite(plan.asked_cap)).tolist()
        last = self._retargeter.layout.view(plan.states[-1].copy())
        feet = np.flatnonzero(last.planted).tolist()
        limbs = np.flatnonzero(np.isfinite(last.asked_tension)).tolist()
        words = [
            *(FOOT_PARTS[FEET[foot]] for foot in feet),
            *(f"{TORQUE}{names[joint]}" for joint in joints),
            *(f"{TENSION}{LIMBS[limb].replace('_', ' ')}" for limb in limbs),
        ]
        if not words:
            self._are_over(heard, "stopped")
            return
        binds: dict[type[Restriction], frozenset[int]] = {
            Contact: frozenset(feet),
            TorqueCap: frozenset(joints),
            Tension: frozenset(limbs),
        }
        self._inherited = _Inherited(number, binds, ", ".join(words), heard)
        self._answers.on_note(f"until the next target: {self._inherited.words}: the planner was started again")

    def _outlive(self, row: TickRow) -> None:
        """Tell when what was inherited acts no longer: the loop plays another plan, or none."""
        if self._inherited is not None and int(row.plan) != self._inherited.plan:
            self._answers.on_note(f"over: {self._inherited.words}")
            self._are_over(self._inherited.heard, "stopped")
            self._inherited = None

    @property
    def inherits(self) -> bool:
        """Whether the loop still plays a plan of another process that was restricted."""
        return self._inherited is not None

    @property
    def restrictions(self) -> Restrictions:
        """What holds, for the retargeter."""
        caps, tension = dict[int, float](), dict[int, float]()
        for one in self._held:
            match one.intent:
                case TorqueCap(limit=limit):
                    caps |= dict.fromkeys(one.binds, limit)
                case Tension(tension=asked):
                    tension |= dict.fromkeys(one.binds, asked)
        return Restrictions(frozenset(self._planted), caps, tension)

    def keeps(self, part: str) -> bool:
        """Whether a foot of a name of `Relax` is kept where it is, or will be."""
        if part not in FOOT_PARTS.values():
            return False
        waiting = [part_of_words(target.intent) or target.intent for target, _ in self._waiting]
        asked = [*waiting, *(one.intent for one in self._held)]
        kept = frozenset[int]().union(*(intent.sides for intent in asked if isinstance(intent, Contact)))
        inherited = frozenset[int]() if self._inherited is None else self._inherited.binds[Contact]
        return not (kept | inherited).isdisjoint(self._freed(part)[1])

    @property
    def stays(self) -> str | None:
        """Why the robot makes no step; None: it may."""
        feet = self._planted
        if not feet:
            return None
        part = FOOT_PARTS["both"] if len(feet) == 2 else FOOT_PARTS[FEET[min(feet)]]
        return f"{part} kept down: let {'them' if len(feet) == 2 else 'it'} go first (relax {part!r})"

    def wants(self, plan: int, tick: int) -> bool:
        """Whether a plan is due because the one with this id does not know all restrictions; 0: none plays."""
        if not plan and not (self._held or self._answers.waits):
            return False
        return self._revisions.wants(plan, tick)

    def made(self, plan: int, rows: Plan, playing: int, tick: int) -> None:
        """A plan was made with all that hold; arguments as of `PartTargets.made`."""
        self._revisions.made(plan, playing, tick)
        settled = self._retargeter.layout.view(rows.states[0].copy()).steps.steps()
        for place, one in enumerate(self._held):
            if one.heard.tick is not None:
                continue
            lands = [step.land for step in settled if isinstance(one.intent, Contact) and step.side in one.binds]
            down = max([rows.start_tick, *lands])
            late_s = (down - one.born) / self._rate
            known: dict[str, object] = {"tick": down}
            if lands and late_s > _LATE_S:
                known |= {"state": "slowed", "slowed": f"{late_s:.2f} s until it is down"}
            self._held[place] = replace(one, heard=one.heard.model_copy(update=known))

    # ------------------------------------------------------------------ targets

    @property
    def _planted(self) -> set[int]:
        return {foot for one in self._held if isinstance(one.intent, Contact) for foot in one.binds}

    def _begin(self, target: Target, born: float, upper: Float, bent: Callable[[], str | None]) -> None:
        """Let a target hold. Raises `ConfigError` where it cannot; names what is valid."""
        intent = part_of_words(target.intent) or target.intent
        if isinstance(intent, Relax):
            self._relax(target, intent)
            return
        assert isinstance(intent, Restriction)
        before, binds = self._planted, self._bound(intent, upper, bent)
        kept, displaced = [], list[tuple[_Held, frozenset[int]]]()
        for one in self._held:
            same = isinstance(one.intent, type(intent))
            kept.append(self._less(one, binds) if same else one)
            if same:
                before_it = ((one, one.binds),) if one.answered else one.displaced
                displaced += [(older, part & binds) for older, part in before_it]
        self._keep([one for one in kept if one.binds], "superseded")
        words = words_of(target.intent)
        heard = Heard(id=target.id, asked=words, state="accepted", heard_as=intent.part, holds="restriction")
        until = born + target.holds_s * self._rate
        revision = self._revisions.change()
        self._held.append(_Held(target, intent, frozenset(binds), born, until, heard, revision, tuple(displaced)))
        if self._planted - before and self.stays is not None:
            self._on_planted(self.stays)

    def _bound(self, intent: Restriction, upper: Float, bent: Callable[[], str | None]) -> frozenset[int]:
        """What a restriction binds, see `_Held`. Raises `ConfigError` where it cannot hold; names what is valid."""
        match intent:
            case Contact():
                return intent.sides
            case TorqueCap():
                return self._capped(intent, upper, bent)
            case Tension():
                return self._tense(intent)

    def _tense(self, intent: Tension) -> frozenset[int]:
        """Places of the limbs in `LIMBS`. Raises `ConfigError` where the robot's stiffness of them cannot change."""
        robot = self._retargeter.robot
        if robot.config.least_stiffness >= 1.0:
            raise ConfigError(f"tension: {robot.name} has one stiffness (least_stiffness 1 in its robot file)")
        if self._turns > 1:
            raise ConfigError(
                f"tension: the servos of {robot.name} are read in turns, each every {self._turns} ticks: "
                f"not often enough to soften them"
            )
        chains = robot.mapping.chains()
        if missing := [limb for limb in intent.limbs if limb not in chains]:
            known = ", ".join(limb.replace("_", " ") for limb in LIMBS if limb in chains)
            raise ConfigError(f"tension: {robot.name} has no {missing[0].replace('_', ' ')}; expected one of: {known}")
        return frozenset(LIMBS.index(limb) for limb in intent.limbs)

    def _capped(self, intent: TorqueCap, upper: Float, bent: Callable[[], str | None]) -> frozenset[int]:
        """The columns of the joints that are capped. Raises `ConfigError` where standing needs more."""
        joints = joints_named(self._retargeter.robot, intent.joint)
        of_legs = not set(joints.values()).isdisjoint(map(int, self._retargeter.legs))
        if of_legs and (reason := bent()) is not None:
            raise ConfigError(f"torque: {reason}")
        rest = self._retargeter.robot.stand_pose[self._retargeter.body.upper.joints]
        needs = np.maximum(*(np.abs(self._retargeter.holding_torque(angles)) for angles in (rest, upper)))
        name, joint = max(joints.items(), key=lambda named: float(needs[named[1]]))
        if needs[joint] > intent.limit:
            raise ConfigError(
                f"torque: {name} needs {needs[joint]:.2f} N·m where the robot stands; expected a limit above that, "
                f"found {intent.limit:g}"
            )
        return frozenset(joints.values())

    def _relax(self, target: Target, intent: Relax) -> None:
        """Let a restriction go: a foot, the torque of the joints of a name, or the tension of a limb."""
        kind, free = self._freed(intent.part)
        kept = [self._without(one, free) if isinstance(one.intent, kind) else one for one in self._held]
        last = self._inherited
        ends = last is not None and not free.isdisjoint(last.binds[kind])
        if not ends and all(one.binds == other.binds for one, other in zip(kept, self._held, strict=True)):
            parts = [*(one.intent.part for one in self._held), *([] if last is None else [last.words])]
            raise not_held(intent.part, [*parts, *self.all_held()])
        self._keep([one for one in kept if one.binds], "let go")
        if ends:  # the next plan knows of nothing that was inherited
            self._revisions.change()
        self._answers.relaxed(target)

    def _freed(self, part: str) -> tuple[type[Restriction], frozenset[int]]:
        """The kind of restriction that a name of `Relax` lets go, and what it binds."""
        feet = {name: foot for foot, name in FOOT_PARTS.items()}
        if part in feet:
            return Contact, Contact(feet[part]).sides
        named = part.partition(" ")[2]
        if part.startswith(TENSION):
            limbs = {str(limb): Tension(limb, 1.0).limbs for limb in TENSION_LIMBS}
            require_choice(f"relax: {TENSION.strip()}", named, tuple(limbs))
            return Tension, frozenset(LIMBS.index(limb) for limb in limbs[named])
        return TorqueCap, frozenset(joints_named(self._retargeter.robot, named).values())

    def _certain(self, tick: float) -> list[_Held]:
        """What holds by plans that were answered: without what is not answered yet, with what that has displaced."""
        found = {one.target.id: one for one in self._held if one.answered}
        for one in self._held:
            for older, part in () if one.answered else one.displaced:
                if part and older.until > tick:
                    known = found.get(older.target.id, replace(older, binds=frozenset()))
                    binds = known.binds | part
                    heard = older.heard.model_copy(update={"heard_as": self._named(older.intent, binds)})
                    found[older.target.id] = replace(known, binds=binds, heard=heard)
        return list(found.values())

    def _keep(self, kept: list[_Held], over: Over) -> None:
        """Go on with these; the others are over, and how."""
        ids = {one.target.id for one in kept}
        for one in self._held:
            if one.target.id in ids:
                continue
            reason = "a newer target came before a plan followed it"
            self._answers.ended(one.heard, answered=one.answered, over=over, state="superseded", reason=reason)
        if kept != self._held:
            self._held = kept
            self._revisions.change()

    def _less(self, one: _Held, free: frozenset[int]) -> _Held:
        """A restriction that no longer holds for some of what it binds; its answer names what is left."""
        binds = one.binds - free
        if binds in (one.binds, frozenset()):
            return replace(one, binds=binds)
        heard = one.heard.model_copy(update={"heard_as": self._named(one.intent, binds)})
        if one.answered:
            self._answers.later(heard)
        return replace(one, binds=binds, heard=heard)

    def _without(self, one: _Held, free: frozenset[int]) -> _Held:
        """The same, where what it has displaced does not hold there either."""
        displaced = tuple((older, part - free) for older, part in one.displaced)
        return replace(self._less(one, free), displaced=displaced)

    def _named(self, intent: Restriction, binds: frozenset[int]) -> str:
        """What a restriction binds, in the names that `Relax` takes."""
        names = self._retargeter.robot.joint_names
        match intent:
            case Contact():
                return FOOT_PARTS["both"] if len(binds) == 2 else FOOT_PARTS[FEET[min(binds)]]
            case TorqueCap():
                return ", ".join(f"{TORQUE}{names[joint]}" for joint in sorted(binds))
        return ", ".join(f"{TENSION}{LIMBS[limb].replace('_', ' ')}" for limb in sorted(binds))

    # ------------------------------------------------------------------ answers

    def _are_over(self, answers: Sequence[Heard], how: Over) -> None:
        """What held for these answers holds no longer."""
        for heard in answers:
            self._answers.later(heard, over=how)

    def _answer(self, row: TickRow) -> None:
        """Answer what the loop has taken a plan for."""
        known = self._answers.taken(row)
        for place, one in enumerate(self._held):
            if not one.answered and one.heard.tick is not None and known >= one.revision:
                heard = self._answers.followed(one.heard)
                self._held[place] = replace(one, heard=heard, answered=True, displaced=())
                self._answers.tell(heard)

    def _end(self, reason: str, kept: Sequence[_Held] = ()) -> None:
        """What holds is over, but for some, and what waits for an answer gets it."""
        ids = {one.target.id for one in kept}
        over = [one for one in self._held if one.target.id not in ids]
        for one in over:
            self._answers.ended(one.heard, answered=one.answered, over="stopped", state="refused", reason=reason)
        known = {one.target.id: one.heard for one in self._held}
        for one in kept:
            if one.heard != known.get(one.target.id):
                self._answers.later(one.heard)  # what had taken its place was never followed: it holds again
        self._answers.nothing_holds()
        if over:
            self._answers.on_note(f"over: {', '.join(str(one.intent) for one in over)}")
        if list(kept) != self._held:
            self._revisions.change()
        self._held = list(kept)
