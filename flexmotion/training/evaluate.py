"""Metrics of models on held-out clips, beside real motion, the nearest training window and a motionless pose.

All motions are processed alike: features to a motion of the bundle's human and back to features, so that evaluator and
metrics depend on the motion alone. Embeddings are compared with those of other held-out windows, so that real motion
has a distance too. Every figure has an interval: metrics of many windows over random halves of them, metrics of single
windows over the windows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
import torch
from numpy.typing import NDArray

from flexmotion.dataset.compact_set import MotionSet
from flexmotion.evaluation.embeddings import (
    diversity,
    frechet_distance,
    matching_distance,
    multimodality,
    r_precision,
)
from flexmotion.evaluation.ground import judge_ground
from flexmotion.evaluation.interval import Interval, repeated
from flexmotion.evaluation.motions import foot_metrics, jerk
from flexmotion.evaluation.physics import beyond_muscles, joint_contact_error, physics_metrics
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import LEAD, body_points, encode
from flexmotion.features.layout import ACTIVATIONS, Layout
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.signals import same_rate
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training.checkpoints import load_weights
from flexmotion.training.conditions import Dropped, Sentences, describe
from flexmotion.training.evaluator import Evaluator
from flexmotion.training.losses import Reconstruction
from flexmotion.training.manner_conditions import NONE
from flexmotion.training.run import Run
from flexmotion.training.window_set import WindowSet

Features = NDArray[np.float32]

TEXTS, SAMPLES = 16, 10
"""Sentences, and samples of each, for multimodality."""

PHYSICAL = 64
"""Windows for the metrics of physics; feet, jerk and what windows are moved by are measured on all."""

NEIGHBOURS = 8192
"""Training windows that are searched for the nearest."""

Generator = Callable[[int, int], Features]
"""Case and seed to the features of the case's future, not normalised, (W, F)."""

Delivery = Callable[[int, int], tuple[Motion, Motion]]
"""Case and seed to the motion of the case's future as planted, and as delivered."""

MOTION_FIGURES = ("skate_ratio", "float_mm", "penetrate_mm")
"""Figures of the feet that are reported of delivered motion too."""


@dataclass(frozen=True)
class Cases:
    """N held-out windows.

    Attributes:
        history, future: features, not normalised, (N, H, F) and (N, W, F).
        texts: sentence of each.
        sentence: embeddings of those, (N, D).
        clip, first: clip of the store and frame of the clip at which each future begins, (N,).
    """

    history: Features
    future: Features
    texts: tuple[str, ...]
    sentence: torch.Tensor
    clip: NDArray[np.intp]
    first: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.future)


class Judge:
    """Metrics of generators over the same cases.

    Args:
        run: with a trained evaluator.
        body: human of the bundles.
        count: number of cases.
        seed: of the cases and of all draws.
        source: the set of the run's features, which are in half precision: with it the physics of real motion are
            measured in single precision. None: in half precision, whose rounding alone is a residual of 5 %.

    Raises:
        ConfigError: the evaluator has not been trained.
    """

    def __init__(self, run: Run, body: Body, count: int, seed: int = 0, source: MotionSet | None = None) -> None:
        self.run, self.body, self.seed, self.layout = run, body, seed, run.layout
        self.store = run.store()
        self._recorded = {} if source is None else {(clip.name, clip.variant): clip for clip in source.clips}
        self._source = source
        self.network = Evaluator(run.config.evaluator, run.config.window, self.layout, run.config.diffusion.text)
        load_weights(self.network, run.stage("evaluator"))
        self.network.eval()
        sentences = Sentences(self.store.clips, SentenceEncoder(run.stage("text")), named=True)
        self.cases, others = (self._cases(sentences, count, number) for number in range(2))
        with torch.no_grad():
            self._texts = self.network.sentence(self.cases.sentence).numpy()
        self._reference = self._embedded(self._from_motions(others, list(others.future)))

    def _cases(self, sentences: Sentences, count: int, number: int) -> Cases:
        restore = Reconstruction(self.store.layout, self.store.statistics, self.run.config.losses).restore
        windows = WindowSet(self.store, self.run.config.window, "validation").draw((self.seed, 61, number), 2 * count)
        future = restore(windows.future)
        seed = (self.seed, 62, number)
        found = describe(self.store, sentences, future, windows.clip, seed, Dropped(velocity=1.0), first=windows.first)
        described = np.flatnonzero(found.row != NONE)[:count]
        return Cases(
            history=restore(windows.history).numpy()[described],
            future=future.numpy()[described],
            texts=tuple(sentences.texts[row] for row in found.row[described]),
            sentence=found.sentence[described],
            clip=np.asarray(windows.clip)[described],
            first=np.asarray(windows.first)[described],
        )

    def past(self, case: int) -> Motion:
        """History of a case as a motion; the first frame of its future where the model has no history."""
        return self._past(self.cases, case)

    def _past(self, cases: Cases, case: int) -> Motion:
        before = cases.history[case] if cases.history.shape[1] else cases.future[case][:1]
        return decode(before, self.layout, self.body, Anchor.origin())

    def real(self, case: int, seed: int) -> Features:
        """Generator: the clip itself."""
        return self.cases.future[case] if case >= PHYSICAL else self._exact(case)

    def _exact(self, case: int) -> Features:
        """Features of a real future in single precision where there is a set, and it has the clip at their rate."""
        stored, first = self.store.clips[self.cases.clip[case]], int(self.cases.first[case])
        clip = self._recorded.get((stored.name, stored.variant))
        frames, before = self.cases.future.shape[1], self.cases.history.shape[1]
        if self._source is None or clip is None or not same_rate(clip.fps, self.layout.fps):
            return self.cases.future[case]
        begin, end = max(first - max(before, LEAD), 0), first + frames
        if end > clip.frames or clip.info.get("slope"):
            return self.cases.future[case]
        motion = self._source.motion(clip)
        if not self.layout.muscles:
            motion = replace(motion, activations=None)
        found: Features = encode(motion[begin:end], self.layout, self._source.centres(clip)[begin:end])[-frames:]
        return found

    def motionless(self, case: int, seed: int) -> Features:
        """Generator: the mean pose of all training frames, without speed."""
        mean = self.store.statistics.mean.copy()
        for name in ("velocities", "accelerations"):
            mean[self.layout.blocks[name]] = 0.0
        mean[self.layout.blocks["root"]][:3] = 0.0
        return np.repeat(mean[None], self.cases.future.shape[1], axis=0)

    def nearest(self) -> Generator:
        """Generator: training windows nearest to the case's sentence in the evaluator's space."""
        restore = Reconstruction(self.store.layout, self.store.statistics, self.run.config.losses).restore
        windows = WindowSet(self.store, self.run.config.window, "train").draw((self.seed, 63), NEIGHBOURS)
        with torch.no_grad():
            embedded = torch.cat([self.network.motion(part) for part in windows.future.split(256)]).numpy()
        future = restore(windows.future).numpy()

        def generate(case: int, seed: int) -> Features:
            likeness = embedded @ self._texts[case]
            best = np.argsort(-likeness)[:SAMPLES]
            found: Features = future[best[seed % SAMPLES]]
            return found

        return generate

    def sampled(self, sampler: Sampler) -> Generator:
        """Generator: samples of a model after the case's history, with its sentence."""

        def generate(case: int, seed: int) -> Features:
            return sampler.features(self.past(case), Condition(self.cases.texts[case]), seed)

        return generate

    def delivered(self, sampler: Sampler) -> Delivery:
        """What becomes of the samples of `sampled`: feet planted, then forces that belong to the motion."""

        def deliver(case: int, seed: int) -> tuple[Motion, Motion]:
            past, condition = self.past(case), Condition(self.cases.texts[case])
            planted = sampler.planted(sampler.features(past, condition, seed), past, condition)
            return planted, sampler.sample(past, condition, seed)

        return deliver

    def measure(self, generate: Generator, deliver: Delivery | None = None) -> dict[str, Interval]:
        """Every metric of a generator.

        Args:
            generate: gives the features as decoded.
            deliver: gives the same windows as delivered, for metrics whose names begin with `delivered_`, and for
                `moved_by_planting`, `moved_by_projection`, the mean distances of the body's points from those before
                either [mm]; None: not delivered.
        """
        count = len(self.cases)
        futures = [generate(case, case) for case in range(count)]
        embedded = self._embedded(self._from_motions(self.cases, futures))

        def half(rng: np.random.Generator) -> NDArray[np.intp]:
            return rng.permutation(count)[: count // 2]

        def distance(rng: np.random.Generator) -> float:
            return frechet_distance(embedded[half(rng)], self._reference[half(rng)])

        def precision(place: int) -> Callable[[np.random.Generator], float]:
            return lambda rng: r_precision(embedded, self._texts, rng)[place]

        def matching(rng: np.random.Generator) -> float:
            rows = half(rng)
            return matching_distance(embedded[rows], self._texts[rows])

        metrics = {
            "fid": distance,
            **{f"r_precision_top{place + 1}": precision(place) for place in range(3)},
            "mm_distance": matching,
            "diversity": lambda rng: diversity(embedded, rng),
        }
        figures = {name: repeated(metric, self.seed) for name, metric in metrics.items()}
        return figures | {"multimodality": self._multimodality(generate)} | self._of_motions(futures, deliver)

    def _multimodality(self, generate: Generator) -> Interval:
        values = []
        for case in np.linspace(0, len(self.cases) - 1, TEXTS).astype(int):
            samples = [generate(int(case), seed) for seed in range(SAMPLES)]
            features = self._from_motions(self.cases, samples, [int(case)] * SAMPLES)
            values.append(multimodality(self._embedded(features)[None]))
        return Interval.of(values)

    def _of_motions(self, futures: Sequence[Features], deliver: Delivery | None) -> dict[str, Interval]:
        rows: list[dict[str, float]] = []
        for case, future in enumerate(futures):
            past = self.past(case)
            motion = decode(future, self.layout, self.body, Anchor.after(past))
            whole = _joined(past, motion)
            row = foot_metrics(motion)
            change = jerk(whole)
            join = len(past)
            row["jerk"], row["jerk_peak"] = float(change.mean()), float(change.max())
            if join >= 3:
                # The third differences across the join.
                row["jerk_join"] = float(change[join - 3 : join].max())
            if case < PHYSICAL:
                row |= self._of_physics(_unclipped(future, motion, self.layout))
            if deliver is not None:
                row |= self._of_delivered(motion, *deliver(case, case), physical=case < PHYSICAL)
            rows.append(row)
        names = dict.fromkeys(name for row in rows for name in row)
        return {name: Interval.of([row[name] for row in rows if name in row]) for name in names}

    def _of_delivered(self, decoded: Motion, planted: Motion, delivered: Motion, *, physical: bool) -> dict[str, float]:
        # Feet and jerk of the same windows as those of real motion: of the first 64 skated .32, of 192 .25.
        feet = foot_metrics(delivered)
        figures = {name: feet[name] for name in MOTION_FIGURES}
        if physical:
            figures = self._of_physics(delivered) | figures
        figures["jerk"] = float(jerk(delivered).mean())
        return {f"delivered_{name}": value for name, value in figures.items()} | {
            "moved_by_planting": _distance(decoded, planted),
            "moved_by_projection": _distance(planted, delivered),
        }

    def _of_physics(self, motion: Motion) -> dict[str, float]:
        assert motion.pressure_centres is not None
        figures = physics_metrics(motion, motion.pressure_centres) | judge_ground(motion).figures
        if find_spec("myo_sim") is not None:
            if self.layout.muscles:
                figures["muscle_torque"] = beyond_muscles(motion)
            if self.layout.joint_contact:
                figures["joint_contact"] = joint_contact_error(motion)
        return figures

    def _from_motions(
        self, cases: Cases, futures: Sequence[Features], numbers: Sequence[int] | None = None
    ) -> torch.Tensor:
        """Normalised features that depend on the motions alone, (N, W, F); of cases `numbers`, or of all in turn."""
        rows = []
        for at, future in zip(range(len(futures)) if numbers is None else numbers, futures, strict=True):
            past = self._past(cases, at)
            motion = decode(future, self.layout, self.body, Anchor.after(past))
            whole = encode(_joined(past, motion), self.layout)
            rows.append(self.store.statistics.normalise(whole[-len(motion) :]))
        return torch.from_numpy(np.stack(rows))

    def _embedded(self, features: torch.Tensor) -> NDArray[np.float64]:
        with torch.no_grad():
            parts = [self.network.motion(part) for part in features.split(256)]
        return torch.cat(parts).double().numpy()


def _unclipped(future: Features, motion: Motion, layout: Layout) -> Motion:
    """The decoded motion with the activations of the features: a motion's are clipped to [0, 1]."""
    if not layout.muscles:
        return motion
    return replace(motion, activations=np.asarray(future[:, layout.blocks[ACTIVATIONS]], np.float64))


def _distance(one: Motion, other: Motion) -> float:
    """Mean distance of the body's points in two motions [mm]."""
    apart = body_points(forward(one)) - body_points(forward(other))
    return 1e3 * float(np.linalg.norm(apart, axis=-1).mean())


def _joined(past: Motion, motion: Motion) -> Motion:
    """The kinematics of two motions, one after the other."""
    return Motion(
        fps=motion.fps,
        body=motion.body,
        root_position=np.concatenate([past.root_position, motion.root_position]),
        root_quaternion=np.concatenate([past.root_quaternion, motion.root_quaternion]),
        joints=np.concatenate([past.joints, motion.joints]),
    )
