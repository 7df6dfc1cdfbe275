"""`evaluate`: models against held-out clips, beside real motion, the nearest training window and a motionless pose.

All motions go the same way: features to a motion of the bundle's human and back to features, so that what the
evaluator and the metrics see follows from the motion alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from flexmotion.body import Body
from flexmotion.evaluation.embeddings import (
    Interval,
    diversity,
    frechet_distance,
    matching_distance,
    multimodality,
    r_precision,
    repeated,
)
from flexmotion.evaluation.motions import foot_metrics, jerk
from flexmotion.evaluation.physics import physics_metrics
from flexmotion.features.decode import Anchor, decode, pressure_centres
from flexmotion.features.encode import encode
from flexmotion.motion import Motion
from flexmotion.sampler import Condition, Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training.conditions import NONE, Sentences, describe
from flexmotion.training.evaluator import Evaluator
from flexmotion.training.losses import Reconstruction
from flexmotion.training.run import Run
from flexmotion.training.stage import load_weights
from flexmotion.training.windows import WindowSet

Features = NDArray[np.float32]

TEXTS, SAMPLES = 16, 10
"""Sentences and samples of each, over which multimodality is taken."""

PHYSICAL = 64
"""Windows over which the metrics of physics are taken."""

NEIGHBOURS = 8192
"""Training windows among which the nearest is looked for."""

Generator = Callable[[int, int], Features]
"""Number of a case and a seed to the features of its future, not normalised, (W, F)."""


@dataclass(frozen=True)
class Cases:
    """Held-out windows: histories and futures, not normalised, (N, H, F) and (N, W, F), sentences and their rows."""

    history: Features
    future: Features
    texts: tuple[str, ...]
    sentence: torch.Tensor

    def __len__(self) -> int:
        return len(self.future)


class Judge:
    """Metrics of generators over the same cases.

    Args:
        run: with a trained evaluator.
        body: whose motion is judged.
        count: of cases.
        seed: of the cases and of what is drawn.

    Raises:
        ConfigError: the evaluator has not been trained.
    """

    def __init__(self, run: Run, body: Body, count: int, seed: int = 0) -> None:
        self.run, self.body, self.seed, self.layout = run, body, seed, run.layout
        self.store = run.store()
        self.network = Evaluator(run.config.evaluator, run.config.window, self.layout, run.config.diffusion.text)
        load_weights(self.network, run.stage("evaluator"))
        self.network.eval()
        sentences = Sentences(self.store.clips, SentenceEncoder(run.stage("text")))
        self.cases = self._cases(sentences, count)
        with torch.no_grad():
            self._said = self.network.sentence(self.cases.sentence).numpy()
        self._real = self._seen([self.cases.future[at] for at in range(len(self.cases))])

    def _cases(self, sentences: Sentences, count: int) -> Cases:
        restore = Reconstruction(self.store.layout, self.store.statistics, self.run.config.losses).restore
        windows = WindowSet(self.store, self.run.config.window, "validation").draw((self.seed, 61), 2 * count)
        future = restore(windows.future)
        found = describe(self.store, sentences, future, windows.clip, (self.seed, 62), (0.0, 1.0))
        told = np.flatnonzero(found.row != NONE)[:count]
        return Cases(
            history=restore(windows.history).numpy()[told],
            future=future.numpy()[told],
            texts=tuple(sentences.texts[row] for row in found.row[told]),
            sentence=found.sentence[told],
        )

    def past(self, case: int) -> Motion:
        """History of a case, as a motion that ends somewhere; a standing one where the model has no history."""
        if not self.cases.history.shape[1]:
            return decode(self.cases.future[case][:1], self.layout, self.body, Anchor.origin())
        return decode(self.cases.history[case], self.layout, self.body, Anchor.origin())

    def real(self, case: int, seed: int) -> Features:
        """The clip itself."""
        return self.cases.future[case]

    def motionless(self, case: int, seed: int) -> Features:
        """The mean pose of all training frames, without speed."""
        mean = self.store.statistics.mean.copy()
        for name in ("velocities", "accelerations"):
            mean[self.layout.blocks[name]] = 0.0
        mean[self.layout.blocks["root"]][:3] = 0.0
        return np.repeat(mean[None], self.cases.future.shape[1], axis=0)

    def nearest(self) -> Generator:
        """The training windows that the evaluator finds nearest to the case's sentence."""
        restore = Reconstruction(self.store.layout, self.store.statistics, self.run.config.losses).restore
        windows = WindowSet(self.store, self.run.config.window, "train").draw((self.seed, 63), NEIGHBOURS)
        with torch.no_grad():
            embedded = torch.cat([self.network.motion(part) for part in windows.future.split(256)]).numpy()
        future = restore(windows.future).numpy()

        def generate(case: int, seed: int) -> Features:
            likeness = embedded @ self._said[case]
            best = np.argsort(-likeness)[:SAMPLES]
            found: Features = future[best[seed % SAMPLES]]
            return found

        return generate

    def sampled(self, sampler: Sampler) -> Generator:
        """What a model makes of history and sentence."""

        def generate(case: int, seed: int) -> Features:
            return sampler.features(self.past(case), Condition(self.cases.texts[case]), seed)

        return generate

    def measure(self, generate: Generator) -> dict[str, Any]:
        """Every metric of a generator; those that draw have mean and interval."""
        futures = [generate(case, case) for case in range(len(self.cases))]
        seen = self._seen(futures)
        embedded = self._embedded(seen)
        real = self._embedded(self._real)
        precision = [repeated(partial(self._precision, embedded, k), self.seed) for k in range(3)]
        figures: dict[str, Any] = {
            "fid": frechet_distance(embedded, real),
            **{f"r_precision_top{k + 1}": _pair(value) for k, value in enumerate(precision)},
            "mm_distance": matching_distance(embedded, self._said),
            "diversity": _pair(repeated(lambda rng: diversity(embedded, rng), self.seed)),
            "multimodality": self._multimodality(generate),
        }
        return figures | self._of_motions(futures)

    def _precision(self, embedded: NDArray[np.float64], place: int, rng: np.random.Generator) -> float:
        return r_precision(embedded, self._said, rng)[place]

    def _multimodality(self, generate: Generator) -> float:
        cases = np.linspace(0, len(self.cases) - 1, TEXTS).astype(int)
        samples = [self._seen([generate(int(case), seed) for seed in range(SAMPLES)], int(case)) for case in cases]
        return multimodality(np.stack([self._embedded(seen) for seen in samples]))

    def _of_motions(self, futures: Sequence[Features]) -> dict[str, float]:
        rows: list[dict[str, float]] = []
        for case, future in enumerate(futures):
            motion, whole = self._motion(case, future)
            row = foot_metrics(motion)
            change = jerk(whole)
            join = len(whole) - len(motion)
            row["jerk"], row["jerk_peak"] = float(change.mean()), float(change.max())
            if join >= 3:
                # Third differences that span the join.
                row["jerk_join"] = float(change[join - 3 : join].max())
            if case < PHYSICAL:
                row |= physics_metrics(motion, pressure_centres(future, self.layout, motion))
            rows.append(row)
        names = {name for row in rows for name in row}
        return {name: float(np.mean([row[name] for row in rows if name in row])) for name in sorted(names)}

    def _motion(self, case: int, future: Features) -> tuple[Motion, Motion]:
        """A future as a motion, and with its history before it."""
        past = self.past(case)
        motion = decode(future, self.layout, self.body, Anchor.after(past))
        return motion, _joined(past, motion)

    def _seen(self, futures: Sequence[Features], case: int | None = None) -> torch.Tensor:
        """Normalised features that follow from the motions alone, (N, W, F)."""
        rows = []
        for at, future in enumerate(futures):
            motion, whole = self._motion(at if case is None else case, future)
            rows.append(self.store.statistics.normalise(encode(whole, self.layout)[-len(motion) :]))
        return torch.from_numpy(np.stack(rows))

    def _embedded(self, seen: torch.Tensor) -> NDArray[np.float64]:
        with torch.no_grad():
            parts = [self.network.motion(part) for part in seen.split(256)]
        return torch.cat(parts).double().numpy()


def _joined(past: Motion, motion: Motion) -> Motion:
    """The kinematics of two motions, one after the other."""
    return Motion(
        fps=motion.fps,
        body=motion.body,
        root_position=np.concatenate([past.root_position, motion.root_position]),
        root_quaternion=np.concatenate([past.root_quaternion, motion.root_quaternion]),
        joints=np.concatenate([past.joints, motion.joints]),
    )


def _pair(value: Interval) -> dict[str, float]:
    return {"mean": value.mean, "interval": value.half_width}
