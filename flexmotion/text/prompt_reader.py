"""`PromptReader`: what is asked for in words, as the model has learnt to hear it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmotion.text.listener import Listener
from flexmotion.text.phrases import STAND
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.text.sides import is_other_side

SAME = 0.99
"""Cosine from which on two wordings are one."""

BREADTH = 10.0
"""Known wordings of what is meant are mixed by the exponential of so many times their cosine: what many of them have in
common is what it means."""

FORBIDS = re.compile(
    r"""\b(?:not|never|no|without|neither|nor|none|nobody|nowhere|cannot|stop|quit|cease|avoid|halt|enough|abort|cancel)\b
    | \b(?:forbid|forbidden|prohibit|prohibited|refrain|refuse)\b
    | \b(?:do|does|did|ca|wo|must|need|should|would|could|is|are|was)n[^\w\s]?t\b
    | \b(?:except|excepting|excluding|omit|skip|forget|hate|dislike)\b
    | \b(?:any|every|all|no)\w*\b.*\bbut\b | \b(?:instead\ of|rather\ than|other\ than|apart\ from|give\ up)\b""",
    re.IGNORECASE | re.VERBOSE,
)
"""To a sentence encoder "do not walk" is nearly "do walk": who is told what not to do stands still."""

FORBIDS_NOTHING = re.compile(
    r"\b(?:in )?no (?:hurry|rush)(?=\s*(?:[,.;!?]|$))|\bnon-?stop\b|\bwithout (?:a|any) (?:hurry|rush)\b", re.IGNORECASE
)
"""What only says how; at the end of a clause, for "no rush forward" says what not to do."""


WITHOUT_TURNING = re.compile(r"\bwithout (?:turning|rotating|looking)(?: (?:a?round|back))?\b", re.IGNORECASE)
"""Likewise where what is meant is no turn: a step aside goes without."""


def forbids(sentence: str, kind: str) -> bool:
    """Whether a sentence that is heard as a kind of motion says what not to do."""
    told = FORBIDS_NOTHING.sub(" ", sentence)
    if "turn" not in kind:
        told = WITHOUT_TURNING.sub(" ", told)
    return FORBIDS.search(told) is not None


@dataclass(frozen=True)
class Prompt:
    """A sentence read.

    Attributes:
        embedding: as the denoiser takes it, (D,), of unit length.
        kind: of motion that it means.
        likeness: cosine with the known wording nearest to it.
        known: whether it means something.
        warning: why the robot stands still, where nobody asked for that.
    """

    embedding: NDArray[np.float32]
    kind: str
    likeness: float
    known: bool
    warning: str | None = None


class PromptReader:
    """Reads sentences by the wordings that a model was trained with.

    A listener says which kind of motion is meant; the sentence is heard as a mixture of known wordings of that kind,
    the nearer the more, so that an unseen wording lands where the model has been. Never as one of several kinds: "to
    your left" is nearly as near to "turn right" as to "turn left", and half of each is neither. A known wording needs
    no listener. What means no kind means standing still, and so does what says what not to do.

    Args:
        folder: of the sentence encoder.
        kinds: of motion that the wordings mean, (K,).
        embeddings: of the wordings, (K, D).
        listener: that was taught by sentences encoded likewise.
    """

    def __init__(
        self, folder: Path, kinds: tuple[str, ...], embeddings: NDArray[np.float32], listener: Listener
    ) -> None:
        self._encode = SentenceEncoder(folder)
        self._kinds, self._embeddings, self._listener = np.array(kinds), embeddings, listener
        self.idle = self.meaning(STAND)

    def meaning(self, kind: str) -> Prompt:
        """What all wordings of a kind of motion have in common; standing still where it has none."""
        kind = kind if kind in self._kinds else STAND
        return Prompt(_unit(self._embeddings[self._kinds == kind].mean(axis=0)), kind, 1.0, True)

    def __call__(self, sentence: str) -> Prompt:
        """What a sentence means."""
        embedding = self._encode(sentence)
        likeness = self._embeddings @ embedding
        nearest = int(np.argmax(likeness))
        best = float(likeness[nearest])
        kind = str(self._kinds[nearest])
        if best <= SAME or is_other_side(kind, sentence):
            kind = self._heard(sentence, embedding, best)
        if kind == NOTHING:
            learnt = ", ".join(dict.fromkeys(self._kinds))
            told = f"{sentence!r} means nothing to this model: it stands still; it has learnt: {learnt}"
            return Prompt(self.idle.embedding, STAND, best, False, told)
        if forbids(sentence, kind) and (kind != STAND or best <= SAME):
            told = f"{sentence!r} says what not to do: it stands still; say what to do"
            return Prompt(self.idle.embedding, STAND, best, True, told)
        alike = self._kinds == kind
        mixture = np.exp(BREADTH * (likeness[alike] - best)) @ self._embeddings[alike]
        return Prompt(_unit(mixture), kind, best, True)

    def _heard(self, sentence: str, embedding: NDArray[np.float32], likeness: float) -> str:
        """The kind that is meant, or `NOTHING`."""
        pieces = self._encode.pieces(sentence)
        if all(piece == self._encode.pieces.unknown for piece in pieces):
            return NOTHING
        return self._listener(sentence, embedding, pieces, likeness)


def _unit(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    return (vector / np.linalg.norm(vector)).astype(np.float32)
