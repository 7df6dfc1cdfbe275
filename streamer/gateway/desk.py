"""`Desk`: the gateway's one place where messages become targets and requests, and every message gets its answer.

Transports (WebSocket, HTTP, lines) call `receive` with a message's bytes and a function that takes the answer, and
`pump` every few milliseconds. Nothing here waits.
"""

from __future__ import annotations

import math
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Hashable
from dataclasses import replace

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import Gateway
from flexmotion.drivers.realtime.ring import Ring
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.telemetry import Event, Telemetry, events
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.gateway.asked import WHOLE_BODY, Asked, Following, OnEnd, Reply, Sequences, Waiter, asked_of
from flexmotion.streamer.gateway.cause import Cause
from flexmotion.streamer.gateway.joint_messages import JointsMessage, RebootMessage
from flexmotion.streamer.gateway.lease import Lease
from flexmotion.streamer.gateway.loop_requests import REQUESTS, gets_up, in_effect, leads, name_of, request_of
from flexmotion.streamer.gateway.messages import (
    FOLLOWED,
    GET_UP_S,
    Answer,
    AnswerState,
    ArmMessage,
    ClearMessage,
    DisarmMessage,
    EmergencyStopMessage,
    KillMessage,
    Message,
    MessageError,
    ReleaseMessage,
    StopMessage,
    TakeMessage,
    TargetEnd,
    VelocityMessage,
    decode,
    intent_of,
)
from flexmotion.streamer.gateway.mirror_state import MirrorState
from flexmotion.streamer.gateway.part_messages import PartMessage
from flexmotion.streamer.gateway.send_rates import MOST_WAITING, SendRates
from flexmotion.streamer.motion.heard import Heard, HeardChannel, Over, heard_since
from flexmotion.streamer.motion.intents import Intent, to_content
from flexmotion.streamer.motion.mirror_source import GOES_ON
from flexmotion.streamer.motion.part_intents import PLACE_OF, RELAXES, PartIntent, Relax
from flexmotion.streamer.motion.part_words import part_of_words
from flexmotion.streamer.motion.targets import TargetSender
from flexmotion.streamer.run.requests import Request, RequestChannel
from flexmotion.text.phrases import STAND

_REQUEST_S = 1.0
"""A loop that has not taken a request after this time does not run [s]."""
_RESTART_S = 8.0
"""Time that servos have to restart and be set up again [s]."""
_GRACE_S = 1.0
"""Time that the planner has to answer a target after its time is over, before the gateway does [s]."""
_AHEAD_S = 1.0
"""A sender's clock may be ahead of this machine's by so much [s]."""
_ENDS: dict[Over | None, TargetEnd] = {"expired": "expired", "stopped": "stopped"}
"""The end that a waiting program is told; of all others: superseded."""
_SOURCES = 256
"""Targets whose senders are remembered."""

_EMERGENCIES = (StopMessage, EmergencyStopMessage, KillMessage)
"""They need no lease, depend on no order of arrival, and not on two clocks that agree."""
_FOLLOWS = (State.READY, State.STREAMING, State.HOLD)
"""States in which a target is followed, or waits to be."""
_STANDS_AFTER = {"clip", "stop"}
"""Words of targets that end in a stand, where none of their steps is measured; so do sentences heard as standing."""


class Desk:
    """Messages in, answers out.

    Args:
        settings: of the gateway.
        telemetry: of the loop.
        targets: the gateway's end of the mailbox.
        heard: the planner's answers.
        requests: the gateway's channel to the loop.
        on_lease: called with the operator before and the one now, when the lease goes over.
        takes_targets: else the run only shows itself, and can be stopped.
        mirror: what a run that mirrors a person does; None: it mirrors nobody.

    Attributes:
        counts: messages received, answers by state, and what was refused, by its reason.
        following: the newest target that was accepted; None before the first, after a stop, without torque, and where
            the robot stands still for words that it does not understand.
        holding: newest answers to targets for parts of the body and to restrictions that hold.
        sources: who sent the newest targets, by number.
        cause: why the robot does not do as it is told.
    """

    def __init__(
        self,
        settings: Gateway,
        telemetry: Telemetry,
        targets: TargetSender,
        heard: HeardChannel,
        requests: RequestChannel,
        on_lease: Callable[[str | None, str | None], None] = lambda _before, _now: None,
        *,
        takes_targets: bool = True,
        mirror: MirrorState | None = None,
    ) -> None:
        self.takes_targets, self.mirror = takes_targets, mirror
        self.settings, self.targets, self.requests, self.on_lease = settings, targets, requests, on_lease
        self.lease = Lease(settings)
        self.counts: Counter[str] = Counter()
        self.following: Following | None = None
        self.holding: list[Heard] = []
        self.cause = Cause()
        self.sources: OrderedDict[int, str] = OrderedDict()
        self._ticks: Ring = telemetry.ticks
        self._events = telemetry.events.reader(new_only=True)
        self._heard, self._channel, self._held_changes = heard.reader(), heard, 0
        self._waiters: dict[int, Waiter] = {}  # of what holds, by number
        self._waiting: dict[str, Asked] = {}  # by part: targets that are sent when the interval of coalescing is over
        self._open: dict[int, Asked] = {}  # targets that the planner has not answered, by id, ascending
        self._asked: deque[Asked] = deque()  # requests that the loop has not taken
        self._behind: deque[Asked] = deque()  # targets that wait for a request of their connection
        self._sequences = Sequences(settings.lease_s)
        self._rates = SendRates(settings.coalesce_s)
        self._holder: str | None = None

    @property
    def busy(self) -> bool:
        """Whether a message waits for its answer."""
        return bool(self._waiting or self._open or self._asked or self._behind)

    def receive(self, data: bytes, reply: Reply, sender: Hashable = None, on_end: OnEnd | None = None) -> None:
        """Take a message; `reply` is called once with its answer, now or from `pump`.

        Args:
            data: JSON, one message.
            reply: takes the answer; must not raise.
            sender: connection that it came by, until `forget`; sequence numbers ascend within one.
            on_end: is called once with the end of a target that was followed; must not raise.
        """
        self.counts["received"] += 1
        if len(data) > self.settings.most_bytes:
            self.reject("too large")
            reason = f"{len(data)} bytes, expected at most {self.settings.most_bytes}"
            reply(self._counted(Answer(state="refused", reason=reason)))
            return
        try:
            message = decode(data)
        except MessageError as error:
            self.reject("not valid")
            reply(self._counted(error.answer))
            return
        self._take(asked_of(message, reply, time.perf_counter(), on_end), sender)

    def forget(self, sender: Hashable) -> None:
        """A connection is closed: the next one of this name counts its messages anew."""
        self._sequences.forget(sender)

    def reject(self, why: str) -> None:
        """Count a message or a connection that is refused as such."""
        self.counts[f"rejected: {why}"] += 1

    def pump(self) -> None:
        """Send what waits, and answer what is decided."""
        now = time.perf_counter()
        for part in list(self._waiting):
            if self._rates.may_send(part, now):
                self._send(self._waiting.pop(part), now)
        for heard in heard_since(self._heard):
            self._answered(heard)
        row = self._ticks.latest()  # before the events: those of its tick are among them
        if self.mirror is not None:
            self.mirror.update(None if row is None else TickRow(row))
        new = events(self._events)
        for event in new:
            self.cause.take(event)
        self._match(new, None if row is None else TickRow(row))
        self._look_what_holds(None if row is None else TickRow(row))
        if self.following is not None and now - self.following.stamp_s > self.following.holds_s:
            if self.mirror is not None and self.following.end is None:
                self.mirror.ends()
            self.following = self.following.ended("expired")
        self._time_out(now)
        self._send_behind(now)
        self.lease.lapse(now)
        self._tell_lease()

    # ---------------------------------------------------------------- messages

    def _take(self, asked: Asked, sender: Hashable) -> None:
        message, now, asked.sender = asked.message, asked.since_s, sender
        late = self._late(message)
        if late is not None:
            self.reject("stale")
            self._reply(asked, *late)
        elif type(message) in _EMERGENCIES:
            self._drop_behind(message)
            self._request(asked)
        elif not self._sequences.ascends(message, sender, now):
            self._reply(asked, "refused", f"sequence {message.sequence} does not come after the last of this source")
        elif not self.takes_targets and (gets_up(message) or not isinstance(message, ClearMessage)):
            self._reply(asked, "refused", "this run only shows itself (--view); start it with --web to steer it")
        elif isinstance(message, ReleaseMessage):
            held = self.lease.release(message.source)
            self._reply(asked, "accepted" if held else "refused", None if held else "the lease was not held")
        else:
            if isinstance(message, DisarmMessage):
                self._drop_behind(message)
                self._request(asked)
                return
            before = self.lease.holder
            refusal = self.lease.refusal(message.source, now, take=isinstance(message, TakeMessage))
            if refusal is not None:
                self._reply(asked, "refused", refusal)
                return
            asked.took_from = before if before != self.lease.holder else None
            if isinstance(message, TakeMessage):
                self._reply(asked, "accepted")
            elif type(message) in REQUESTS:
                self._request(asked)
            elif self._is_behind(asked) and len(self._behind) >= MOST_WAITING:
                self._reply(asked, "refused", f"{MOST_WAITING} targets wait for the request before them already")
            elif self._is_behind(asked):
                self._behind.append(asked)
            else:
                self._target(asked, now)
        self._tell_lease()

    def _late(self, message: Message) -> tuple[AnswerState, str] | None:
        """Why a message's stamp makes it invalid."""
        if message.stamp_s is None or type(message) in _EMERGENCIES:
            return None
        age_s = time.time() - message.stamp_s
        if age_s < -_AHEAD_S:
            return "refused", f"stamp_s: {-age_s:.1f} s in the future by this machine's clock"
        holds_s = self._holds_s(message)
        if age_s > holds_s:
            return "expired", f"sent {age_s:.1f} s ago, it holds {holds_s:g} s"
        # What holds without end is for the moment all the same: it is followed soon after it was sent, or not at all.
        # What brings the robot to rest is done late rather than not.
        rests = isinstance(message, DisarmMessage | ReleaseMessage)
        take_up_s = self.settings.take_up_s
        if message.ttl_s is None and age_s > take_up_s and not rests:
            return "expired", f"sent {age_s:.1f} s ago, without ttl_s it is taken up within {take_up_s:g} s"
        return None

    def _holds_s(self, message: Message) -> float:
        if message.ttl_s is not None:
            return message.ttl_s
        if isinstance(message, PartMessage):
            return message.in_s + self.settings.part_holds_s
        return self.settings.velocity_holds_s if isinstance(message, VelocityMessage) else math.inf

    def _is_behind(self, asked: Asked) -> bool:
        """Whether a target waits for a request that its connection has sent before; it does so for a second at most."""
        return asked.sender is not None and any(leads(one) and one.sender == asked.sender for one in self._asked)

    def _send_behind(self, now: float) -> None:
        """Send the targets whose request is answered."""
        for asked in [one for one in self._behind if not self._is_behind(one)]:
            self._behind.remove(asked)
            if now - asked.since_s < self._holds_s(asked.message):
                self._target(asked, now)
            else:
                self._reply(asked, "expired", "the request before it was answered too late for it")

    def _drop_behind(self, stop: Message) -> None:
        """Refuse the targets that wait: what comes before a stop is not done after it."""
        while self._behind:
            self._reply(self._behind.popleft(), "refused", f"{stop.type} from {stop.source} came before it was sent")

    def _target(self, asked: Asked, now: float) -> None:
        intent, asked.holds_s = intent_of(asked.message), self._holds_s(asked.message) - (now - asked.since_s)
        asked.intent, part = intent, _part_of(intent)
        asked.part = part
        if isinstance(intent, Relax):
            for let_go in [one for one in self._waiting if one != WHOLE_BODY and intent.ends(one)]:
                self._reply(self._waiting.pop(let_go), "superseded", "the part was let go after it")
        if part in self._waiting:
            self._reply(self._waiting.pop(part), "superseded", "a newer target came within the interval of coalescing")
        if self._rates.may_send(part, now):
            self._send(asked, now)
        elif part != WHOLE_BODY and len(self._waiting) >= MOST_WAITING:
            self._reply(asked, "refused", f"targets wait for {MOST_WAITING} parts already")
        else:
            self._waiting[part] = asked

    def _send(self, asked: Asked, now: float) -> None:
        assert asked.intent is not None
        take_up_s = self.settings.take_up_s
        try:
            target = self.targets.send(asked.intent, holds_s=asked.holds_s, take_up_s=take_up_s)
        except ConfigError as error:
            self._reply(asked, "refused", str(error))
            return
        self._rates.sent(asked.part, now)
        asked.due_s = now + min(asked.holds_s, take_up_s) + _GRACE_S
        self._open[target.id] = asked
        self.sources[target.id] = asked.message.source
        while len(self.sources) > _SOURCES:
            self.sources.popitem(last=False)

    def _request(self, asked: Asked) -> None:
        message = asked.message
        takes_s = _RESTART_S if isinstance(message, RebootMessage) else GET_UP_S if gets_up(message) else _REQUEST_S
        asked.due_s = asked.since_s + takes_s
        same = any(name_of(one) == name_of(asked) and one.tick < 0 for one in self._asked)
        self._asked.append(asked)
        if not same:  # one that the loop has not taken yet stands for both: a burst does not overrun the channel
            reason = f"{message.source}: {message.type}"
            if isinstance(message, JointsMessage):
                reason = ",".join(message.joints)
            self.requests.send(request_of(message), reason)

    # ---------------------------------------------------------------- answers

    def _answered(self, heard: Heard) -> None:
        """Reply to a target; older ones that the planner has never seen are superseded."""
        part = self._open[heard.id].part if heard.id in self._open else None
        if part == WHOLE_BODY and heard.state != "superseded":
            # The planner looks at the newest target for the whole body; one that it answers now is newer. It answers
            # every target for a part.
            for number in [one for one, asked in self._open.items() if one < heard.id and asked.part == WHOLE_BODY]:
                self._reply(self._open.pop(number), "superseded", "a newer target came first", target=number)
        asked = self._open.pop(heard.id, None)
        if asked is None and heard.holds is not None:
            self._hold(heard, None)
            return
        if asked is None:  # of another sender, of a script, or a later version: a step has ended
            if self.following is not None and self.following.answer.target == heard.id:
                self.following = replace(self.following, steps=heard.steps, dropped=heard.dropped, stood_s=None)
                # Its plan would pass the servos' envelope, or a foot is kept down.
                given_up = heard.state == "refused" or heard.over == "stopped"
                end = self.following.measured_end or ("stopped" if given_up else None)
                if end is not None:
                    self.following = self.following.ended(end, heard.reason if given_up else None)
            return
        told = self._reply(
            asked,
            heard.state,
            heard.reason,
            target=heard.id,
            part=None if part == WHOLE_BODY or part is None else part.removeprefix(PLACE_OF),
            tick=heard.tick,
            heard_as=heard.heard_as,
            manner=heard.manner,
            certainty=None if heard.certainty is None else round(heard.certainty, 3),
            slowed=heard.slowed,
            moved=heard.moved,
            dropped=heard.dropped or None,
            notes=heard.notes or None,
        )
        if heard.holds is not None:
            self._hold(heard, asked)
        if part != WHOLE_BODY:
            return
        if told.state in FOLLOWED and asked.intent is not None:
            if self.mirror is not None:
                self.mirror.follows(rests=heard.heard_as == STAND)
            content = to_content(asked.intent)
            source, now = asked.message.source, time.perf_counter()
            holds_s = asked.holds_s if heard.left_s is None else min(asked.holds_s, heard.left_s)
            self._follow(Following(source, content, told, now, holds_s, asked.on_end, heard.steps), "superseded")
        elif told.state == "refused" and told.tick is not None:
            self._follow(None, "superseded")  # it stands still

    def _follow(self, following: Following | None, end: TargetEnd) -> None:
        """Another target is followed, or none, which ends the last one."""
        if self.following is not None:
            self.following.ended(end)
        self.following = following

    def _hold(self, heard: Heard, asked: Asked | None) -> None:
        """Tell a waiting program the end of a target for a part, or of a restriction, once an answer shows it.

        Args:
            asked: the message of this gateway that it answers; None: of another sender, or a later version.
        """
        if asked is not None and asked.on_end is not None and heard.tick is not None:
            message = asked.message
            self._waiters[heard.id] = Waiter(message.source, message.id, asked.on_end, heard.holds == "part")
        if heard.id not in self._waiters:
            return
        if heard.there is not None:
            self._waiters.pop(heard.id).tell(heard.id, "done", heard.there)
        elif heard.missed is not None:
            self._waiters.pop(heard.id).tell(heard.id, "time limit", heard.missed)
        elif not heard.held:
            late = heard.over == "expired" and heard.holds == "part"  # it never got there
            end: TargetEnd = "time limit" if late else _ENDS.get(heard.over, "superseded")
            self._waiters.pop(heard.id).tell(heard.id, end)

    def _look_what_holds(self, row: TickRow | None) -> None:
        """Read what holds, if it has changed; nothing does without torque, whatever a planner has told that died."""
        if row is not None and State(int(row.state)) not in _FOLLOWS:
            self.holding, self._held_changes = [], 0
            self._stop_waiting(list(self._waiters))
            return
        if row is not None and row.must_stop:
            self._stop_waiting([number for number, one in self._waiters.items() if one.part])
        if (changes := self._channel.held_changes) != self._held_changes:
            self.holding, self._held_changes = self._channel.held, changes

    def _stop_waiting(self, numbers: list[int]) -> None:
        for number in numbers:
            self._waiters.pop(number).tell(number, "stopped")

    def _match(self, new: list[Event], row: TickRow | None) -> None:
        """Reply to the requests that the loop has taken; to most of them once their effect is known.

        Args:
            row: of the loop, from before the new events were read.
        """
        for event in new:
            if event.kind == "request":
                for asked in self._asked:
                    if asked.tick < 0 and name_of(asked) == event.message:
                        asked.tick = event.tick
            elif event.kind in ("refused", "done"):
                name, _, reason = event.message.partition(": ")
                taken = [one for one in self._asked if one.tick >= 0 and name_of(one) == name]
                if event.kind == "refused":  # at once: of those of this tick; an earlier one may be under way still
                    taken = [one for one in taken if one.tick == event.tick] or taken
                for asked in taken:
                    self._asked.remove(asked)
                    if event.kind == "refused":
                        self._reply(asked, "refused", reason)
                    else:
                        self._reply(asked, "accepted", tick=event.tick)
        if row is not None and (row.must_stop or State(int(row.state)) not in _FOLLOWS):
            self._follow(None, "stopped")
        elif row is not None and self.following is not None and State(int(row.state)) is State.HOLD:
            # It stands, though a target was followed: one that leads to a stand is done, others were given up, such as
            # those of a planner that was started again.
            tick = self.following.answer.tick
            measured = self.following.last is not None and self.following.last.is_measured
            stands = self.following.asked.keys() & _STANDS_AFTER and not measured
            stands = stands or self.following.answer.heard_as == STAND
            if tick is not None and int(row.tick) > tick:
                now = time.perf_counter()
                since_s = now if self.following.stood_s is None else self.following.stood_s
                self.following = replace(self.following, stood_s=since_s)
                # What was measured is told a moment after the robot has come to a stand.
                if stands or now - since_s >= self.following.stands_s:
                    self.following = self.following.ended("done" if stands else "stopped")
        elif self.following is not None:
            self.following = replace(self.following, stood_s=None)
        for asked in [one for one in self._asked if one.tick >= 0 and in_effect(one, row)]:
            self._asked.remove(asked)
            self._reply(asked, "accepted", tick=asked.tick)

    def _time_out(self, now: float) -> None:
        for late in [asked for asked in self._asked if asked.due_s < now]:
            self._asked.remove(late)
            why = "did not take it" if late.tick < 0 else "took it, and it had no effect"
            self._reply(late, "refused", f"the loop {why} within {late.due_s - late.since_s:g} s")
        for number in [number for number, asked in self._open.items() if asked.due_s < now]:
            asked = self._open.pop(number)
            self._reply(asked, "expired", "the planner has not answered", target=number)

    def _reply(self, asked: Asked, state: AnswerState, reason: str | None = None, **known: object) -> Answer:
        message = asked.message
        goes_on = state == "accepted" and isinstance(message, ArmMessage | ClearMessage)
        if goes_on and self.mirror is not None and self.mirror.waits:
            known["notes"] = (GOES_ON,)
            self.requests.send(Request.NOTE, GOES_ON)  # for the run's output and its page
        answer = Answer.model_validate(
            {
                "id": message.id,
                "source": message.source,
                "sequence": message.sequence,
                "asked": message.type,
                "state": state,
                "reason": reason,
                "took_lease_from": asked.took_from,
                **(asked.known | known),
            }
        )
        asked.reply(self._counted(answer))
        return answer

    def _counted(self, answer: Answer) -> Answer:
        self.counts[answer.state] += 1
        return answer

    def _tell_lease(self) -> None:
        if self.lease.holder != self._holder:
            before, self._holder = self._holder, self.lease.holder
            self.on_lease(before, self._holder)

    def row(self) -> TickRow | None:
        """The newest row of the loop; None before the first."""
        row = self._ticks.latest()
        return None if row is None else TickRow(row)


def _part_of(asked: Intent | None) -> str:
    """The part of the body that a target is for: newer ones replace older ones of the same part."""
    intent = None if asked is None else part_of_words(asked) or asked
    if not isinstance(intent, PartIntent):
        return WHOLE_BODY
    return f"{RELAXES}{intent.part}" if isinstance(intent, Relax) else intent.part
