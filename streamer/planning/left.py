"""`Left`: the answer to a target that a stop has ended while the body stays where that target has brought it."""

from __future__ import annotations

from collections.abc import Callable

from flexmotion.streamer.motion.heard import Heard, Over


class Left:
    """Keeps the answer to one target.

    Args:
        publish: is given later versions of the answer.
        note: added to it: what stays as it is, and until when.
    """

    def __init__(self, publish: Callable[[Heard], None], note: str) -> None:
        self._publish, self._note = publish, note
        self._heard: Heard | None = None

    def take(self, heard: Heard) -> None:
        """A stop has ended the target that was answered so. One that it met on its way has missed its place."""
        if self._note not in heard.notes:
            missed = heard.missed if heard.there is not None else heard.missed or "stopped on its way"
            heard = heard.model_copy(update={"missed": missed, "notes": (*heard.notes, self._note)})
            self._publish(heard)
        self._heard = heard

    def end(self, over: Over) -> None:
        """The body stays so no longer; how that ended."""
        heard, self._heard = self._heard, None
        if heard is not None:
            self._publish(heard.model_copy(update={"over": over}))
