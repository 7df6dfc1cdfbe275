"""Training of a `Listener`: logistic regression on sentences of known kind of motion, or on phrases of known manner."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import numpy as np
from sklearn.linear_model import LogisticRegression

from flexmotion.bundles.bundle import Bundle, write_bundle
from flexmotion.bundles.card import CARD, add_note
from flexmotion.configs.errors import ConfigError
from flexmotion.text.listener import EMPHASIS
from flexmotion.text.manners import (
    manner_sayings,
    manner_wordings,
    manner_words,
    manners,
    neutral_words,
    unknown_manners,
)
from flexmotion.text.phrases import STAND
from flexmotion.text.prompt_reader import forbids
from flexmotion.text.sayings import NOTHING, sayings
from flexmotion.text.sentence_encoder import SentenceEncoder

SEEN = 3
"""Least number of sentences with a word piece for it to be an input."""

DOUBT = 0.5
"""Weight of sentences without meaning for motion, relative to others: they are many and would dominate."""

FREEDOM = 3.0
"""Inverse of the weights' ridge penalty; of .3 to 10, with emphases of 4 and 8, the best on held-out fifths."""


def fit_listener(encode: SentenceEncoder, examples: Sequence[tuple[str, str]]) -> dict[str, np.ndarray]:
    """Fit a `Listener`; returns its arrays as a bundle keeps them.

    Args:
        encode: sentence encoder.
        examples: kind of motion and sentence.
    """
    sentences = [sentence for _, sentence in examples]
    found = [set(encode.pieces(sentence)) for sentence in sentences]
    pieces = sorted(piece for piece, seen in Counter(p for each in found for p in each).items() if seen >= SEEN)
    named = np.array([[piece in each for piece in pieces] for each in found], np.float32)
    inputs = np.hstack([EMPHASIS * np.stack([encode(sentence) for sentence in sentences]), named])
    kinds, label, counts = np.unique([kind for kind, _ in examples], return_inverse=True, return_counts=True)
    # A kind weighs with the square root of its number of sentences.
    weight = np.where(kinds == NOTHING, DOUBT, 1.0)[label] / np.sqrt(counts[label])
    model = LogisticRegression(C=FREEDOM, max_iter=500).fit(inputs, label, sample_weight=weight / weight.mean())
    return {
        "listener_kinds": kinds,
        "listener_pieces": np.array(pieces, np.int32),
        "listener_weights": np.vstack([model.coef_.T, model.intercept_]).astype(np.float16),
    }


def fit_manner_listener(encode: SentenceEncoder) -> dict[str, np.ndarray]:
    """Fit the `Listener` of manners to the phrases of `manners.yaml`; returns its arrays as a bundle keeps them.

    A person's manner is not among them: it is asked for by its own words alone (`manner_reader.py`), and "like Anna" is
    not "like Ada".
    """
    examples = [
        (manner, phrase)
        for manner in manners()
        for phrase in (*manner_wordings(manner), *manner_sayings(manner), *manner_words(manner))
    ]
    examples += [(NOTHING, phrase) for phrase in (*unknown_manners(), *sorted(neutral_words()))]
    return {f"manner_{name}": values for name, values in fit_listener(encode, examples).items()}


def refit_listener(bundle: Bundle, out: Path, more: Sequence[tuple[str, str]] = ()) -> Bundle:
    """Copy a bundle, with a listener fitted to this version's sayings and to more of them.

    Args:
        bundle: to copy.
        out: folder of the copy; written completely or not at all.
        more: kind of motion and sentence, of further examples.

    Raises:
        ConfigError: the folder is not empty or lies in the bundle; a further sentence is of a kind that the bundle does
            not know, or would be refused as a prohibition; the bundle knows a kind of motion whose sentences only its
            training has.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out}: exists and is not empty")
    if out.resolve().is_relative_to(bundle.folder.resolve()):
        raise ConfigError(f"{out}: lies in the bundle itself")
    learnt = {*bundle.prompts.kinds, NOTHING}
    known = sayings()  # of all kinds: what the model cannot do is refused by its name
    if lost := set(bundle.listener.kinds) - {kind for kind, _ in (*known, *more)}:
        raise ConfigError(
            f"{bundle.folder}: knows {sorted(lost)}, whose sentences only its training has; export it again from there"
        )
    for kind, sentence in more:
        if kind not in learnt:
            raise ConfigError(f"{sentence!r} is of kind {kind!r}; the model knows {', '.join(sorted(learnt))}")
        if kind not in (STAND, NOTHING) and forbids(sentence, kind):
            raise ConfigError(f"{sentence!r} forbids a motion, so the robot would stand still; say what to do")
    encode = SentenceEncoder(bundle.folder)
    listener = fit_listener(encode, [*known, *more]) | fit_manner_listener(encode)
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}-") as folder:
        made = Path(folder) / "bundle"
        made.mkdir()
        for name in (*bundle.manifest.files, CARD):
            copyfile(bundle.folder / name, made / name)
        versions = bundle.manifest.versions | {"scikit-learn": version("scikit-learn")}
        write_bundle(made, bundle.manifest.model_copy(update={"versions": versions}), bundle.arrays | listener)
        add_note(
            made,
            f"Listener fitted again with {len(more)} more sentences; figures about prompts are of the one before.",
        )
        made.replace(out)
    return Bundle(out)
