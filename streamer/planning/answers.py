"""`Answers`: what is told of targets beside the one for the whole body: one answer each, and its later versions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.heard import Heard, Over
from flexmotion.streamer.motion.heard import State as Fate
from flexmotion.streamer.motion.intents import words_of
from flexmotion.streamer.motion.targets import Target
from flexmotion.streamer.planning.revisions import Revisions
from flexmotion.streamer.planning.target_ledger import tell_unfollowed


class Answers:
    """Answers a target once the loop has taken a plan that follows it.

    Args:
        rate_hz: ticks a second.
        publish: is given every answer and its later versions; on_note: a message for the operator.

    Attributes:
        on_note: likewise.
        revisions: the changes of what holds, which plans know.
    """

    def __init__(self, rate_hz: float, publish: Callable[[Heard], None], on_note: Callable[[str], None]) -> None:
        self._publish, self.on_note = publish, on_note
        self.revisions, self._rate = Revisions(rate_hz), rate_hz
        self._relaxed: list[tuple[int, Heard]] = []  # revisions, and answers that wait for a plan of them

    @property
    def waits(self) -> bool:
        """Whether the answer to a `Relax` waits for a plan."""
        return bool(self._relaxed)

    def unfollowed(self, target: Target, state: Fate, reason: str) -> None:
        """A target that no plan follows is answered at once."""
        tell_unfollowed(target, state, reason, self._publish, self.on_note)

    def expired(self, target: Target, age_s: float) -> bool:
        """Whether a target of this age [s] is too old to be followed; if so, it is answered."""
        late = target.too_late(age_s)
        if late:
            self.unfollowed(target, "expired", f"no plan followed it within {target.take_up_s:g} s")
        return late

    def relaxed(self, target: Target) -> None:
        """A `Relax` is answered with the plan that knows of the newest change."""
        heard = Heard(id=target.id, asked=words_of(target.intent), state="accepted", heard_as="relax")
        self._relaxed.append((self.revisions.newest, heard))

    def taken(self, row: TickRow) -> int:
        """Answer what was let go by the plans that the loop has taken, before what begins with them.

        Returns:
            The newest change that these plans know.
        """
        known = self.revisions.known(int(row.plan), int(row.pending))
        self._answer_up_to(known)
        return known

    def nothing_holds(self) -> None:
        """What was let go holds no more, whatever plan plays."""
        self._answer_up_to(self.revisions.newest)

    def followed(self, heard: Heard) -> Heard:
        """The answer to a target that a plan follows from `heard.tick` on, with its time; `tell` it."""
        assert heard.tick is not None
        return heard.model_copy(update={"at_s": heard.tick / self._rate})

    def tell(self, heard: Heard) -> None:
        """Publish a version of an answer; the operator hears of what is not as asked.

        Whoever holds the answer keeps the new version first: what fails in telling it is not told again.
        """
        self._publish(heard)
        if heard.state != "accepted":
            self.on_note(str(heard.told()))

    def ended(self, heard: Heard, *, answered: bool, over: Over, state: Fate, reason: str) -> None:
        """A target holds no longer.

        Args:
            answered: whether it has been: then it is told how it ended, `over`; else that it was never followed.
            state: of the answer, where it has none yet; reason: for it.
        """
        if answered:
            self.later(heard, over=over)
        else:
            self.later(heard, state=state, reason=reason, tick=None)

    def later(self, heard: Heard, **known: Any) -> Heard:
        """Publish a version of an answer in which more is known, without a note."""
        heard = heard.model_copy(update=known)
        self._publish(heard)
        return heard

    def _answer_up_to(self, known: int) -> None:
        told = [heard for revision, heard in self._relaxed if revision <= known]
        self._relaxed = [one for one in self._relaxed if one[0] > known]
        for heard in told:
            self._publish(heard)
