"""Conditions of a window: a sentence and a manner from its clip's labels, a velocity from its motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from flexmotion.configs.errors import ConfigError
from flexmotion.dataset import meaning
from flexmotion.dataset.meaning import Shown, shown
from flexmotion.features.layout import Layout
from flexmotion.text.manners import NORMAL, styled
from flexmotion.text.phrases import STAND, wordings
from flexmotion.text.sides import mirrored
from flexmotion.training.feature_store import FeatureStore, StoredClip
from flexmotion.training.kinematics import path
from flexmotion.training.lowered import lowers_hands
from flexmotion.training.manner_conditions import NONE, Manners
from flexmotion.training.onsets import LATE_S
from flexmotion.training.strokes import without_stroke

STILL = 0.12
"""A window whose points move less on average counts as standing, whatever its clip's label [leg/s]."""

STRAIGHT = 0.15
"""A window of a turning clip that turns less counts as walking straight [rad/s]"""

WALKING = 0.3
"""Least speed of walking [leg/s]."""

UNSTYLED = 0.6
"""Share of sentences without the manner, where sentences name it."""

MIXED = 0.8
"""Share of wordings that a denoiser is given as a mixture with others of their kind, as a request is heard. Wordings of
a kind differ by more than kinds do: a model that was taught single ones raised its arm by half after them (elbow 43
instead of 62 degrees), and after their mean as people do (60)."""


@dataclass(frozen=True)
class Dropped:
    """Shares of windows without a condition, as guidance needs.

    Attributes:
        sentence: without sentence; these have no manner either.
        velocity: without velocity.
        manner: of the others, without manner.
    """

    sentence: float = 0.0
    velocity: float = 0.0
    manner: float = 0.0


@dataclass(frozen=True)
class Conditions:
    """Conditions of N windows.

    Attributes:
        row: index of the sentence in `Sentences.texts`, (N,); `NONE` for none.
        sentence: embeddings, (N, D).
        velocity: forward, left, turning, (N, 3) [leg/s, leg/s, rad/s].
        manner: embeddings, (N, D).
        present: whether sentence, velocity and manner are given, (N, 3), 1 or 0.
    """

    row: np.ndarray
    sentence: Tensor
    velocity: Tensor
    manner: Tensor
    present: Tensor

    def to(self, device: torch.device) -> Conditions:
        """On another device."""
        tensors = (self.sentence, self.velocity, self.manner, self.present)
        return Conditions(self.row, *(tensor.to(device) for tensor in tensors))

    def joined(self, other: Conditions) -> Conditions:
        """Those of these windows, then those of others."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("sentence", "velocity", "manner", "present"))
        return Conditions(np.concatenate([self.row, other.row]), *(torch.cat(pair) for pair in pairs))

    def unconditional(self) -> Conditions:
        """The same without any condition, for classifier-free guidance."""
        return replace(self, present=torch.zeros_like(self.present))

    def without_manner(self) -> Conditions:
        """The same in any manner, for the guidance of the manner."""
        return replace(self, present=self.present * self.present.new_tensor([1.0, 1.0, 0.0]))


class Sentences:
    """Every sentence that may describe a clip, embedded once.

    Args:
        clips: of the store.
        encode: sentence to embedding.
        named: whether sentences also name the manner; a denoiser gets it apart from them, an evaluator does not.
        personal: whether the clips are of one person: those without a label are then walking where they walk straight.

    Raises:
        ConfigError: no clip has a caption or a known label, so there is no sentence to learn.
    """

    def __init__(
        self,
        clips: Iterable[StoredClip],
        encode: Callable[[str], np.ndarray],
        *,
        named: bool = False,
        personal: bool = False,
    ) -> None:
        self._personal = personal
        self._share = UNSTYLED if named else 1.0
        self._number: dict[str, int] = {}
        cache: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}
        self._plain: list[np.ndarray] = []
        self._styled: list[np.ndarray] = []
        self._parts: list[tuple[tuple[int, float, float], ...]] = []
        self._shown: list[Shown | None] = []
        self.kinds: list[str] = []
        for clip in clips:
            kind, captions = clip_kind(clip), clip_captions(clip)
            manner = meaning.clip_manner(clip.labels, clip.whole_captions) or NORMAL
            key = (kind, manner, captions)
            if key not in cache:
                plain = [*wordings(kind), *captions]
                ways = (way for text in plain for way in styled(text, manner))
                cache[key] = self._rows(plain), self._rows(ways) if named else np.zeros(0, np.intp)
            self._plain.append(cache[key][0])
            self._styled.append(cache[key][1])
            self.kinds.append(kind)
            self._shown.append(shown(clip.labels))
            self._parts.append(tuple((int(self._rows([text])[0]), start, end) for text, start, end in clip_parts(clip)))
        if not (any(map(len, self._plain)) or any(self._parts)) and not personal:
            raise ConfigError(
                "the set: no clip has a caption or a known label; put the collection's *_index.csv or *_captions.csv"
                " beside its files and build the set again (docs/biomechanics.md)"
            )
        around = {span.around for span in self._shown if span is not None}
        self._of_kind = {kind: self._rows(wordings(kind)) for kind in (STAND, "walk", *sorted(around))}
        self._mixed = 0.0 if named else MIXED
        alike = {tuple(map(int, self._rows(wordings(kind)))) for kind in {*self._of_kind, *self.kinds}}
        self.embeddings = torch.from_numpy(np.stack([encode(text) for text in self._number])).float()
        # "sprint" is a wording of running and of dashing: it is mixed with neither.
        times = Counter(row for rows in alike for row in rows)
        mixed = [(rows, self.embeddings[list(rows)].numpy()) for rows in alike]
        self._alike = {row: own for rows, own in mixed for row in rows if times[row] == 1}

    def _rows(self, texts: Iterable[str]) -> np.ndarray:
        return np.array([self._number.setdefault(text, len(self._number)) for text in texts], np.intp)

    @property
    def texts(self) -> tuple[str, ...]:
        """Every sentence, in the order of `embeddings`."""
        return tuple(self._number)

    def embedded(self, rows: np.ndarray, rng: np.random.Generator) -> Tensor:
        """Embeddings of rows of `draw`, (N, D), of unit length; most of a denoiser's are mixtures."""
        found = self.embeddings[torch.from_numpy(np.maximum(rows, 0))]
        values = found.numpy()
        for at, row in enumerate(rows):
            alike = self._alike.get(int(row))
            if alike is not None and rng.random() < self._mixed:
                mixture = rng.dirichlet(np.ones(len(alike))).astype(np.float32) @ alike
                values[at] = mixture / np.linalg.norm(mixture)
        return found

    def draw(
        self,
        rng: np.random.Generator,
        clips: np.ndarray,
        still: np.ndarray,
        straight: np.ndarray,
        times: np.ndarray | None = None,
        waits: np.ndarray | None = None,
    ) -> np.ndarray:
        """Row of a sentence for each window, (N,); `NONE` where its clip has no sentence.

        Args:
            rng: random generator.
            clips: clips of the windows, (N,).
            still: windows that stand, (N,); not asked of clips that tell when they show their kind.
            straight: windows that walk without turning, (N,).
            times: start and end of the windows in their clips, (N, 2) [s]; None: sentences are of whole clips.
            waits: windows that wait for the motion of their clip, (N,); it is not what they show. None: none.
        """
        rows = np.full(len(clips), NONE, np.intp)
        for at, clip in enumerate(clips):
            kind = self.kinds[clip]
            window = None if times is None else (float(times[at, 0]), float(times[at, 1]))
            parts = [] if window is None else _within(self._parts[clip], *window)
            part = None if window is None else self._shown[clip]
            waiting = waits is not None and bool(waits[at])
            covered = part is not None and window is not None and part.covers(*window)
            if covered and waiting:
                continue
            elif covered:
                # A nod moves little and a held pose nothing, but neither is standing.
                choice = np.array([*self._plain[clip], *(row for row, _, _ in self._parts[clip])], np.intp)
            elif part is not None and window is not None and part.leaves(*window):
                continue
            elif part is not None:
                choice = self._of_kind[part.around]
            elif still[at]:
                choice = self._of_kind[STAND]
            elif parts:
                choice = np.array(parts, np.intp)
            elif waiting:
                continue
            elif straight[at] and (kind.startswith("walk-turn") or (self._personal and not len(self._plain[clip]))):
                choice = self._of_kind["walk"]
            else:
                choice = (self._plain if rng.random() < self._share else self._styled)[clip]
            if len(choice):
                rows[at] = rng.choice(choice)
        return rows


def clip_kind(clip: StoredClip) -> str:
    """Kind of motion of a clip; of a mirror image, with the sides exchanged."""
    label = meaning.clip_kind(clip.labels, clip.whole_captions)
    return mirrored(label) if clip.variant == "mirror" else label


def clip_captions(clip: StoredClip) -> tuple[str, ...]:
    """Captions of a whole clip from its source; of a mirror image, with the sides exchanged."""
    return tuple(_as_seen(clip, text) for text in clip.whole_captions)


def clip_parts(clip: StoredClip) -> tuple[tuple[str, float, float], ...]:
    """Captions of parts of a clip with their start and end [s]; of a mirror image, with the sides exchanged."""
    return tuple((_as_seen(clip, text), start, end) for text, start, end in clip.partial_captions)


def _as_seen(clip: StoredClip, text: str) -> str:
    return mirrored(text) if clip.variant == "mirror" else text


def _within(parts: tuple[tuple[int, float, float], ...], start: float, end: float) -> list[int]:
    """Rows of the captions that cover at least half of a window."""
    return [row for row, first, last in parts if min(end, last) - max(start, first) >= (end - start) / 2]


def mean_velocity(features: Tensor, layout: Layout) -> Tensor:
    """Mean velocity of the root over windows (N, W, F), not normalised, (N, 3) [leg/s, leg/s, rad/s].

    Its axes are those of the body in the frame before the window.
    """
    place, yaw = path(features[..., layout.blocks["root"]], layout.fps)
    seconds = features.shape[1] / layout.fps
    return torch.cat([place[:, -1], yaw[:, -1:]], dim=-1) / seconds


def describe(
    store: FeatureStore,
    sentences: Sentences,
    future: Tensor,
    clips: np.ndarray,
    seed: tuple[int, ...],
    drop: Dropped,
    manners: Manners | None = None,
    first: np.ndarray | None = None,
) -> Conditions:
    """Conditions of windows.

    Args:
        store: of the windows.
        sentences: of the store's clips.
        future: features, not normalised, (N, W, F).
        clips: clips of the windows, (N,).
        seed: of all draws.
        drop: shares of windows without a condition.
        manners: of the store's clips; None: no window has a manner.
        first: frames of the clips at which the windows begin, (N,); None: sentences are of whole clips.
    """
    rng = np.random.default_rng(seed)
    velocity = mean_velocity(future, store.layout)
    moving = future[..., store.layout.blocks["velocities"]].unflatten(-1, (-1, 3)).norm(dim=-1).mean(dim=(1, 2))
    walking = velocity[:, :2].norm(dim=-1) > WALKING
    straight = (walking & (velocity[:, 2].abs() < STRAIGHT)).numpy()
    times = None if first is None else np.stack([first, first + future.shape[1]], axis=1) / store.layout.fps
    waits = None if first is None else first < store.onsets[clips] - LATE_S * store.layout.fps
    rows = sentences.draw(rng, clips, (moving < STILL).numpy(), straight, times, waits)
    kinds = [sentences.kinds[clip] for clip in clips]
    rows[without_stroke(kinds, future, store.layout) | lowers_hands(kinds, future, store.layout)] = NONE
    has_sentence = (rows != NONE) & (rng.random(len(rows)) >= drop.sentence)
    has_velocity = rng.random(len(rows)) >= drop.velocity
    width = sentences.embeddings.shape[1]
    if manners is None:
        has_manner, manner = np.zeros(len(rows), np.bool_), torch.zeros(len(rows), width)
    else:
        ways, manner = manners.draw(rng, clips, width)
        # What is left of a request without its sentence is nothing; a person's clips may have no label at all.
        has_manner = (ways != NONE) & (has_sentence | manners.personal) & (rng.random(len(rows)) >= drop.manner)
    present = np.stack([has_sentence, has_velocity, has_manner], axis=1)
    return Conditions(
        row=rows,
        sentence=sentences.embedded(rows, rng),
        velocity=velocity,
        manner=manner,
        present=torch.from_numpy(present.astype(np.float32)),
    )
