"""How a `Listener` learns: by what people are known to say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from shutil import copytree

import numpy as np
from sklearn.linear_model import LogisticRegression

from configs.errors import ConfigError
from flexmotion.bundles.bundle import Bundle, write_bundle
from flexmotion.text.listener import EMPHASIS
from flexmotion.text.sayings import NOTHING, sayings
from flexmotion.text.sentence_encoder import SentenceEncoder

SEEN = 3
"""A word piece counts where it is in so many sentences."""

DOUBT = 0.5
"""How much a sentence that means nothing weighs beside others: there is no end of them, and they drown the rest."""

FREEDOM = 3.0
"""Inverse of the weights' ridge penalty; of .3 to 10, with emphases of 4 and 8, the best on held-out fifths."""


def learn_to_listen(encode: SentenceEncoder, said: Sequence[tuple[str, str]]) -> dict[str, np.ndarray]:
    """Arrays of a `Listener`, as a bundle keeps them.

    Args:
        encode: sentences.
        said: kind and sentence, of what is said to mean what.
    """
    sentences = [sentence for _, sentence in said]
    found = [set(encode.pieces(sentence)) for sentence in sentences]
    pieces = sorted(piece for piece, seen in Counter(p for each in found for p in each).items() if seen >= SEEN)
    named = np.array([[piece in each for piece in pieces] for each in found], np.float32)
    inputs = np.hstack([EMPHASIS * np.stack([encode(sentence) for sentence in sentences]), named])
    kinds, meant, counts = np.unique([kind for kind, _ in said], return_inverse=True, return_counts=True)
    # A kind of which much is said weighs more than others, but not as much more.
    weight = np.where(kinds == NOTHING, DOUBT, 1.0)[meant] / np.sqrt(counts[meant])
    model = LogisticRegression(C=FREEDOM, max_iter=500).fit(inputs, meant, sample_weight=weight / weight.mean())
    return {
        "listener_kinds": kinds,
        "listener_pieces": np.array(pieces, np.int32),
        "listener_weights": np.vstack([model.coef_.T, model.intercept_]).astype(np.float16),
    }


def taught_anew(bundle: Bundle, out: Path, more: Sequence[tuple[str, str]] = ()) -> Bundle:
    """A copy of a bundle that listens by what is known to be said today; all else stays as it is.

    Args:
        bundle: whose copy is written.
        out: folder of the copy; made anew.
        more: kind and sentence, of what else is said.

    Raises:
        ConfigError: the folder holds something already, or more is said of a kind that the bundle has not learnt.
    """
    if out.exists() and any(out.iterdir()):
        raise ConfigError(f"{out}: is not empty")
    learnt = {*bundle.prompts.kinds, NOTHING}
    for kind, sentence in more:
        if kind not in learnt:
            raise ConfigError(f"{sentence!r} is said of {kind!r}, which the model has not learnt: {sorted(learnt)}")
    said = [(kind, sentence) for kind, sentence in sayings() if kind in learnt]
    listener = learn_to_listen(SentenceEncoder(bundle.folder), [*said, *more])
    copytree(bundle.folder, out, dirs_exist_ok=True)
    return write_bundle(out, bundle.manifest, bundle.arrays | listener)
