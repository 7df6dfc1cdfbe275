"""DDIM: from noise to a clean latent in a few steps (Song, Meng and Ermon 2021), without noise in between."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


def denoised(noisy: Float32, kept: Float32, steps: int, estimate: Callable[[Float32, int], Float32]) -> Float32:
    """The latent that noise leads to, (1, L).

    Args:
        noisy: the noise, (1, L).
        kept: share of the signal's variance that is left at each time of the diffusion, (times,).
        steps: evaluations of the network, spread evenly over the times; at most as many as these.
        estimate: the network: the clean latent (1, L), of a noisy one (1, L) at a time.
    """
    times = _times(len(kept), steps)
    for now, earlier in zip(times, [*times[1:], -1], strict=True):
        clean = estimate(noisy, now)
        share = kept[now]
        left = kept[earlier] if earlier >= 0 else np.float32(1.0)
        noise = (noisy - np.sqrt(share) * clean) / np.sqrt(1 - share)
        noisy = (np.sqrt(left) * clean + np.sqrt(1 - left) * noise).astype(np.float32)
    return noisy


@lru_cache
def _times(count: int, steps: int) -> tuple[int, ...]:
    """Times of the diffusion at which the network is evaluated, of so many, the noisiest first."""
    return tuple(np.round(np.linspace(count - 1, 0, steps + 1)[:-1]).astype(int).tolist())
