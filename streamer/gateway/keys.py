"""`KeyReader`: a terminal's bytes to keys; `HeldKeys`: the velocity that keys ask for.

A terminal tells when a key is pressed, and repeats it while it is held. It does not tell when a key is let go.
"""

from __future__ import annotations

import codecs

FIRST_S, AGAIN_S = 0.6, 0.3
"""Time for which a key counts as held after it was pressed, and after it was repeated [s]: terminals wait up to half a
second before the first repetition, and repeat 20 to 30 times a second."""

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
DIRECTIONS: dict[str, tuple[int, int, int]] = {
    **dict.fromkeys(("w", "up"), (1, 0, 0)),
    **dict.fromkeys(("s", "down"), (-1, 0, 0)),
    **dict.fromkeys(("a", "left"), (0, 0, 1)),
    **dict.fromkeys(("d", "right"), (0, 0, -1)),
    "q": (0, 1, 0),
    "e": (0, -1, 0),
}
"""Keys that drive: sign of forward, left, turning left."""


class KeyReader:
    """Splits what a terminal sends into keys: characters, "up", "down", "right", "left", and "escape"."""

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def keys(self, data: bytes) -> list[str]:
        """The keys in what has been read; an unknown sequence is none."""
        text = self._decoder.decode(data)
        found: list[str] = []
        place = 0
        while place < len(text):
            if text[place] != "\x1b":
                found.append(text[place])
                place += 1
            elif text[place + 1 : place + 2] not in ("[", "O"):
                found.append("escape")
                place += 1
            else:
                end = place + 2
                while end < len(text) and not "@" <= text[end] <= "~":
                    end += 1
                if end == place + 2 and text[end : end + 1] in _ARROWS:
                    found.append(_ARROWS[text[end]])
                place = end + 1
        return found


class HeldKeys:
    """The keys that count as held.

    Args:
        fastest: forward, left [m/s], turning left [rad/s].
    """

    def __init__(self, fastest: tuple[float, float, float]) -> None:
        self.fastest = fastest
        self._until: dict[str, float] = {}

    def press(self, key: str, now_s: float) -> bool:
        """Take a key; returns whether it drives."""
        if key.lower() not in DIRECTIONS:
            return False
        key = key.lower()
        again = now_s <= self._until.get(key, -1.0)
        self._until[key] = now_s + (AGAIN_S if again else FIRST_S)
        return True

    def release(self) -> None:
        """No key is held any more."""
        self._until.clear()

    def velocity(self, now_s: float) -> tuple[float, float, float]:
        """What the held keys ask for: forward, left [m/s], turning left [rad/s]."""
        held = [DIRECTIONS[key] for key, until in self._until.items() if now_s <= until]
        forward, left, turning = (
            fastest * min(max(sum(direction[place] for direction in held), -1), 1)
            for place, fastest in enumerate(self.fastest)
        )
        return forward, left, turning
