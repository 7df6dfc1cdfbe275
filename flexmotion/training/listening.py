"""How a `Listener` learns: by what people are known to say."""

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
from flexmotion.text.phrases import STAND
from flexmotion.text.prompt_reader import forbids
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
    """A copy of a bundle that listens by what is known to be said today, and no more by what it was taught before.

    Args:
        bundle: whose copy is written.
        out: folder of the copy; made anew, whole or not at all.
        more: kind and sentence, of what else is said.

    Raises:
        ConfigError: the folder holds something already; more is said of a kind that the bundle has not learnt, or would
            never be obeyed; the bundle listens to a personal manner, which only an export from its training teaches.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out}: is there already, and not empty")
    if out.resolve().is_relative_to(bundle.folder.resolve()):
        raise ConfigError(f"{out}: lies in the bundle itself")
    learnt = {*bundle.prompts.kinds, NOTHING}
    known = [(kind, sentence) for kind, sentence in sayings() if kind in learnt]
    if lost := set(bundle.listener.kinds) - {kind for kind, _ in (*known, *more)}:
        raise ConfigError(
            f"{bundle.folder}: listens to {sorted(lost)} by sentences that it does not keep; export it anew"
        )
    for kind, sentence in more:
        if kind not in learnt:
            raise ConfigError(f"{sentence!r} is said of {kind!r}; the model has learnt {', '.join(sorted(learnt))}")
        if kind not in (STAND, NOTHING) and forbids(sentence, kind):
            raise ConfigError(f"{sentence!r} says what not to do: the robot would stand still; say what to do")
    listener = learn_to_listen(SentenceEncoder(bundle.folder), [*known, *more])
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}-") as folder:
        made = Path(folder) / "bundle"
        made.mkdir()
        for name in (*bundle.manifest.files, CARD):
            copyfile(bundle.folder / name, made / name)
        versions = bundle.manifest.versions | {"scikit-learn": version("scikit-learn")}
        write_bundle(made, bundle.manifest.model_copy(update={"versions": versions}), bundle.arrays | listener)
        add_note(
            made, f"Taught again to listen, by {len(more)} more sentences: what is said here of hearing is of before."
        )
        made.replace(out)
    return Bundle(out)
