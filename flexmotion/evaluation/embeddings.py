"""Metrics on embeddings of motions and sentences (Guo et al., HumanML3D, CVPR 2022)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import sqrtm

Float = NDArray[np.floating]

BATCH = 32
"""Number of motions from which that of a sentence is retrieved."""

NEAREST = 3
PAIRS = 300


def frechet_distance(first: Float, second: Float) -> float:
    """Fréchet distance of the normal distributions fitted to two sets of embeddings, (N, D) and (M, D)."""
    mean = first.mean(axis=0) - second.mean(axis=0)
    covariances = np.cov(first, rowvar=False), np.cov(second, rowvar=False)
    little = np.zeros_like(covariances[0])
    if any(np.linalg.matrix_rank(covariance) < len(mean) for covariance in covariances):
        little += 1e-6 * np.eye(len(mean))
    root = sqrtm((covariances[0] + little) @ (covariances[1] + little))
    return float(mean @ mean + np.trace(covariances[0] + covariances[1] - 2 * np.real(root)))


def r_precision(motions: Float, sentences: Float, rng: np.random.Generator) -> tuple[float, ...]:
    """Share of sentences whose motion is among the 1, 2, 3 nearest of a batch of 32, by Euclidean distance.

    Args:
        motions: embeddings, (N, D), N >= 32.
        sentences: embeddings of the same windows, (N, D).
        rng: shuffles the batches.
    """
    order = rng.permutation(len(motions))
    hits = np.zeros(NEAREST)
    count = 0
    for start in range(0, len(order) - BATCH + 1, BATCH):
        rows = order[start : start + BATCH]
        distance = np.linalg.norm(sentences[rows][:, None] - motions[rows][None], axis=-1)
        rank = (distance < np.diag(distance)[:, None]).sum(axis=1)
        hits += [(rank <= k).sum() for k in range(NEAREST)]
        count += BATCH
    return tuple(float(hit) for hit in hits / max(count, 1))


def matching_distance(motions: Float, sentences: Float) -> float:
    """Mean distance between a sentence and its motion."""
    return float(np.linalg.norm(motions - sentences, axis=1).mean())


def diversity(motions: Float, rng: np.random.Generator, pairs: int = PAIRS) -> float:
    """Mean distance of random pairs of motions."""
    first, second = rng.integers(len(motions), size=(2, pairs))
    return float(np.linalg.norm(motions[first] - motions[second], axis=1).mean())


def multimodality(motions: Float) -> float:
    """Mean distance between samples of one sentence, (sentences, samples, D)."""
    samples = motions.shape[1]
    rows, columns = np.triu_indices(samples, 1)
    return float(np.linalg.norm(motions[:, rows] - motions[:, columns], axis=-1).mean())
