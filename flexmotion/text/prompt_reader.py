"""`PromptReader`: sentences to inputs of the model."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.repertoire import RobotRepertoire
from flexmotion.text.limbs import limb_refusal
from flexmotion.text.listener import Listener
from flexmotion.text.manner_phrases import without_phrases
from flexmotion.text.manner_reader import HeardManner, MannerReader
from flexmotion.text.manners import NORMAL
from flexmotion.text.phrases import STAND, first_wording, is_sudden
from flexmotion.text.robot_refusal import robot_refusal
from flexmotion.text.sayings import NOTHING
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.text.sides import is_other_side
from flexmotion.text.spelling import is_foreign, respelled

SAME = 0.99
"""Least cosine of two equal wordings."""

TRIES = 3
"""Motions that are named to try where a sentence is not understood: those with the nearest wordings."""

NAMED = 6
"""Kinds of motion that a refusal names, of the dozens that a model may offer."""

LISTS = "flexmotion bundles"
"""The command that lists all."""

FORBIDS = re.compile(
    r"""\b(?:not|never|no|without|neither|nor|none|nobody|nowhere|cannot|stop|quit|cease|avoid|halt|enough|abort|cancel)\b
    | \b(?:forbid|forbidden|prohibit|prohibited|refrain|refuse)\b
    | \b(?:do|does|did|ca|wo|must|need|should|would|could|is|are|was)n[^\w\s]?t\b
    | \b(?:except|excepting|excluding|omit|skip|forget|hate|dislike)\b
    | \b(?:any|every|all|no)\w*\b.*\bbut\b | \b(?:instead\ of|rather\ than|other\ than|apart\ from|give\ up)\b""",
    re.IGNORECASE | re.VERBOSE,
)
"""Prohibitions: the human stands still. Their embeddings are near those of the opposite ("do not walk", "do walk")."""

FORBIDS_NOTHING = re.compile(
    r"""\b(?:in\ )?no\ (?:hurry|rush)(?=\s*(?:[,.;!?]|$)) | \bnon-?stop\b | \bwithout\ (?:a|any)\ (?:hurry|rush)\b
    | \b(?:say|says|saying|signal|signals|answer|mean|means)\ no\b | \btells?\ (?:\w+\ )?no(?=\s*(?:[,.;!?]|$))
    | \bheads?\ no\b | \bno\ with\ (?:your|the|his|her|a)\ head\b | \bfor\ no(?=\s*(?:[,.;!?]|$))
    | \b(?:signal|show|give|make|gesture|say)s?\ (?:a\ )?(?:stop|halt)\b | \b(?:stop|halt)\ (?:sign|signal)\b
    | \b(?:signal|tell|gesture|motion)s?\ (?:for\ )?(?:\w+\ ){1,3}to\ (?:stop|halt)\b
    | \bthat\ you\ (?:do\ not|don't)\ (?:know|care)\b | \bthat\ you\ have\ no\ idea\b""",
    re.IGNORECASE | re.VERBOSE,
)
"""Negations that only qualify a motion, or are what it says. Qualifying ones stand at the end of a clause, since "no
rush forward" is a prohibition."""

WITHOUT_TURNING = re.compile(
    r"\bwithout (?:turning|rotating|looking)(?: (?:a?round|back))?\b(?! (?:up|down|left|right|to|at)\b)", re.IGNORECASE
)
"""Likewise, for motions other than turns; "without looking down" forbids a look."""


def forbids(sentence: str, kind: str) -> bool:
    """Whether a sentence classified as a kind of motion is a prohibition."""
    rest = FORBIDS_NOTHING.sub(" ", sentence)
    if "turn" not in kind:
        rest = WITHOUT_TURNING.sub(" ", rest)
    return FORBIDS.search(rest) is not None


@dataclass(frozen=True)
class Prompt:
    """Meaning of a sentence.

    Attributes:
        embedding: input of the denoiser, (D,), of unit length.
        kind: of motion.
        likeness: cosine with the nearest known wording.
        known: whether the sentence is understood.
        warning: reason for standing still, where the sentence does not ask for it.
        share: of the most probable kind in what the listener heard; 1 for a known wording.
        manner: in which the motion is asked for.
        dropped: words that say a manner which is not done.
        refused: kind of motion that was asked for and that the model, or the robot, does not offer; None: it was not
            refused so.
        unoffered: who does not offer that kind, in words.
    """

    embedding: NDArray[np.float32]
    kind: str
    likeness: float
    known: bool
    warning: str | None = None
    share: float = 1.0
    manner: str = NORMAL
    dropped: tuple[str, ...] = ()
    refused: str | None = None
    unoffered: str | None = None


class PromptReader:
    """Maps sentences to the wordings that a model was trained with.

    A listener classifies the sentence by kind of motion, and its embedding is replaced by the mean of all wordings of
    that kind: they mean the same, and the denoiser hears single ones less well. Kinds are not mixed: "to your left" is
    nearly as near to "turn right" as to "turn left". Known wordings are not classified. The manner is heard apart from
    the kind. Sentences that are not understood, that name a limb which the motion does not use, prohibitions, and kinds
    that the model or the robot does not offer mean standing still; manners that the model does not offer are dropped.

    Args:
        folder: of the sentence encoder.
        kinds: of motion of each wording, (K,).
        embeddings: of the wordings, (K, D).
        listener: trained on sentences of the same encoder.
        offered: kinds that the model offers; None: all that have wordings.
        manners: that the model offers.
        manner_listener: trained on phrases; None: manners are known by their listed words alone.
        robot: what the robot that follows was judged to do; None: all.

    Attributes:
        offered: kinds that model and robot offer.
    """

    def __init__(
        self,
        folder: Path,
        kinds: tuple[str, ...],
        embeddings: NDArray[np.float32],
        listener: Listener,
        offered: Collection[str] | None = None,
        manners: Collection[str] = (),
        manner_listener: Listener | None = None,
        robot: RobotRepertoire | None = None,
    ) -> None:
        self._encode = SentenceEncoder(folder)
        self._kinds, self._embeddings, self._listener = np.array(kinds), embeddings, listener
        own = tuple(dict.fromkeys(kinds))
        self._robot, self._modelled = robot, {STAND, *(own if offered is None else offered)}
        self.offered = tuple(kind for kind in own if kind in self._modelled and self._robot_offers(kind))
        self._manner = MannerReader(self._encode, manners, manner_listener)
        self.idle = self.meaning(STAND)

    def meaning(self, kind: str) -> Prompt:
        """Mean of all wordings of a kind of motion; of standing still where the kind has none."""
        kind = kind if kind in self._kinds else STAND
        return Prompt(_unit(self._embeddings[self._kinds == kind].mean(axis=0)), kind, 1.0, True)

    def __call__(self, sentence: str) -> Prompt:
        """Meaning of a sentence."""
        how = self._manner(sentence)
        plain = without_phrases(sentence, how.phrases) or sentence
        embedding = self._encode(plain)
        likeness = self._embeddings @ embedding
        nearest = int(np.argmax(likeness))
        best = float(likeness[nearest])
        kind, share = str(self._kinds[nearest]), 1.0
        if best <= SAME or is_other_side(kind, plain):
            kind, share = self._classified(sentence, self._encode(sentence), best)
        if kind == NOTHING:
            meant = self._respelled(plain)
            language = " (it hears English)" if meant is None and is_foreign(plain) else ""
            offer = self._offer(likeness, meant)
            warning = f"{sentence!r} is not understood by this model{language}, it stands still; {offer}"
            return Prompt(self.idle.embedding, STAND, best, False, warning, share)
        if forbids(plain, kind) and (kind != STAND or best <= SAME):
            warning = f"{sentence!r} is a prohibition, the model stands still; say what to do"
            return Prompt(self.idle.embedding, STAND, best, True, warning, share)
        if (reason := limb_refusal(plain, kind)) is not None:
            warning = f"{sentence!r}: {reason}; the model stands still; {self._offer(likeness)}"
            return Prompt(self.idle.embedding, STAND, best, False, warning, share)
        if kind not in self.offered:
            unoffered = self._unoffered(kind)
            warning = f"{sentence!r}: {unoffered}, it stands still; {self._offer(likeness)}"
            return Prompt(self.idle.embedding, STAND, best, False, warning, share, refused=kind, unoffered=unoffered)
        # Standing has one manner.
        manner, dropped = (NORMAL, how.all_dropped) if kind == STAND else (how.manner, how.dropped)
        return replace(self.meaning(kind), likeness=best, share=share, manner=manner, dropped=dropped)

    def manner(self, sentence: str) -> HeardManner:
        """How a sentence asks for its motion, whether the model offers that or not."""
        return self._manner(sentence)

    def is_word(self, word: str) -> bool:
        """Whether a word in lower case is one of the encoder's vocabulary as a whole."""
        return self._encode.pieces.is_word(word)

    def _robot_offers(self, kind: str) -> bool:
        return kind == STAND or self._robot is None or self._robot.offers(kind)

    def _unoffered(self, kind: str) -> str:
        """Who does not do a kind of motion that is not offered, in words."""
        if self._robot is None or kind not in self._modelled:
            return f"this model cannot {first_wording(kind)} yet"
        return robot_refusal(self._robot, kind)

    def _respelled(self, sentence: str) -> str | None:
        """What a sentence with misspelt words may mean, to be suggested; never done by itself."""
        meant = respelled(sentence)
        if meant is None:
            return None
        heard = self(meant)  # all of its words are known: it is not respelled again
        return meant if heard.known and heard.warning is None and not is_sudden(heard.kind) else None

    def _offer(self, likeness: NDArray[np.float32], meant: str | None = None) -> str:
        """What to say instead, and a few of the motions that the model can do.

        Args:
            likeness: of each wording with what was asked, (K,).
            meant: what a sentence with misspelt words may mean; None: it has none.
        """
        nearest = dict.fromkeys(self._kinds[np.argsort(-likeness)].tolist())
        tries = [kind for kind in nearest if kind in self.offered and kind != STAND and not is_sudden(kind)]
        said = [meant] if meant is not None else [first_wording(kind) for kind in tries[:TRIES]]
        told = f"it can: {_names(self.offered[:NAMED])}"
        if len(self.offered) > NAMED:
            lists = LISTS if self._robot is None else f"{LISTS} --robot {quote(self._robot.place)}"
            told += f", … ({lists} lists all {len(self.offered)})"
        return f"try: {', '.join(said)}; {told}" if said else told

    def _classified(self, sentence: str, embedding: NDArray[np.float32], likeness: float) -> tuple[str, float]:
        """Kind of motion, or `NOTHING`, and its share."""
        pieces = self._encode.pieces(sentence)
        if all(piece == self._encode.pieces.unknown for piece in pieces):
            return NOTHING, 0.0
        return self._listener.heard(sentence, embedding, pieces, likeness)


def _names(kinds: Iterable[str]) -> str:
    return ", ".join(kind.replace("-", " ") for kind in kinds)


def _unit(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    return (vector / np.linalg.norm(vector)).astype(np.float32)
