"""The diffusion's stage: denoises latents, first after histories of clips, then more and more after the model's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from flexmotion.configs.model import ModelConfig
from flexmotion.training.ahead import Ahead
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.checkpoints import load_weights
from flexmotion.training.conditions import Conditions, Sentences
from flexmotion.training.denoiser import Denoiser
from flexmotion.training.draws import normal, uniform
from flexmotion.training.feature_store import FeatureStore
from flexmotion.training.latent_set import LatentSet
from flexmotion.training.manner_conditions import Manners
from flexmotion.training.noise_schedule import NoiseSchedule
from flexmotion.training.processes import Processes
from flexmotion.training.windows import Windows

VALIDATION = 512
"""Windows of the validation, always the same."""

MEASURED = 4096
"""Windows over which mean and standard deviation of the latent are taken."""

DECODED = ("root", "rotations", "positions")
"""Blocks by which decoded motion is compared."""

SENTENCE_SPREAD = 3.0
"""Standard deviation of sentence embeddings as the network gets them; left and right differ by a quarter of it."""

TIME_POWER = 2 / 3
"""Diffusion times are uniform numbers to this power: late times more often than early ones."""

SWITCHED_BEGUN = 0.5
"""Share of windows that change over to the beginning of another motion; the others change over to any of its frames."""

MAX_DECODED_ERROR = 20.0
"""A window's decoded error counts up to this; beyond it the window has no gradient."""


@dataclass(frozen=True)
class Latents:
    """Windows as the diffusion gets them: normalised latents (N, latent), histories, conditions."""

    latent: Tensor
    windows: Windows
    conditions: Conditions


@dataclass(frozen=True)
class Before:
    """Windows from which the model samples the histories of the windows that follow, on the CPU.

    Attributes:
        windows: with the windows that follow.
        conditions: of these windows.
        noise: that sampling begins with, (N, latent).
    """

    windows: Windows
    conditions: Conditions
    noise: Tensor


@dataclass(frozen=True)
class Drawn:
    """A batch on the CPU; its last windows follow those of `before`, whose samples are their histories."""

    windows: Windows
    conditions: Conditions
    before: Before | None


class DiffusionTask:
    """Training of the denoiser; see `stage.Task`.

    Args:
        config: of the model.
        store: features of the set.
        autoencoder: trained; kept as it is.
        encode: sentence to embedding.
        seed: of the weights and of all draws.
        processes: that train.
        personal: wordings of a personal manner, which all clips have; none: the manner of each clip's source.
        held_out: split of the validation.
        trained: folder of trained weights to begin with; means and spreads of latents and sentences are theirs. None
            for a new network.
        architecture: of the network.

    Raises:
        ConfigError: `trained` holds no weights, or those of another network.
    """

    def __init__(
        self,
        config: ModelConfig,
        store: FeatureStore,
        autoencoder: Autoencoder,
        encode: Callable[[str], np.ndarray],
        seed: int,
        processes: Processes,
        personal: tuple[str, ...] = (),
        held_out: str = "validation",
        trained: Path | None = None,
        architecture: type[Denoiser] = Denoiser,
    ) -> None:
        torch.manual_seed(seed)
        self.config, self.seed, self.processes = config, seed, processes
        self.autoencoder = autoencoder.to(processes.device).eval().requires_grad_(False)
        self.noise = NoiseSchedule(config.diffusion.steps, processes.device)
        network = architecture(config.diffusion, config.window, store.layout, autoencoder.latent)
        self.network = network.to(processes.device)
        sentences, manners = (
            Sentences(store.clips, encode, personal=bool(personal)),
            Manners(store.clips, encode, personal),
        )
        self.training, self.held_out = (
            LatentSet(config, store, split, self.autoencoder, sentences, manners, processes)
            for split in ("train", held_out)
        )
        if trained is None:
            self._measure_words(sentences, manners)
            self._measure_latents()
        else:
            load_weights(self.network, trained)
        drawn = self.held_out.draw((seed, 21), VALIDATION)
        windows, conditions = drawn.to(processes.device), self.held_out.describe(drawn, (seed, 22))
        latent = self.normalised(self.training.encode(windows.history, windows.future))
        self._held_out = Latents(latent, windows, conditions.to(processes.device))
        self._ahead: Ahead[Drawn] = Ahead(processes.device)

    def _measure_words(self, sentences: Sentences, manners: Manners) -> None:
        network = self.network
        for found, mean, spread in (
            (sentences.embeddings, network.sentence_mean, network.sentence_spread),
            (manners.means, network.manner_mean, network.manner_spread),
        ):
            if len(found) > 1:
                mean.copy_(found.mean(dim=0))
                spread.copy_(found.std(dim=0, unbiased=False).clamp(min=1e-3) / SENTENCE_SPREAD)

    def _measure_latents(self) -> None:
        found = []
        for start in range(0, MEASURED, 512):
            windows = self.training.draw((self.seed, 20, start), 512).to(self.processes.device)
            found.append(self.training.encode(windows.history, windows.future))
        latents = torch.cat(found)
        self.network.latent_mean.copy_(latents.mean(dim=0))
        self.network.latent_spread.copy_(latents.std(dim=0).clamp(min=1e-3))

    def normalised(self, latent: Tensor) -> Tensor:
        """Latents as the denoiser gets them: zero mean, unit standard deviation."""
        return (latent - self.network.latent_mean) / self.network.latent_spread

    def decode(self, history: Tensor, normalised: Tensor) -> Tensor:
        """Futures (N, W, F), normalised features, of normalised latents (N, latent)."""
        latent = normalised * self.network.latent_spread + self.network.latent_mean
        return self.autoencoder.decode(history, latent)

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        diffusion, key = self.config.diffusion, self._key(step)
        batch, device = self.config.stages.diffusion.batch, self.processes.device
        windows, conditions = self.followed(self._ahead(step, self._batch))
        latent = self.normalised(self.training.encode(windows.history, windows.future))
        time = self.times((*key, 4), batch).to(device)
        noise = normal((*key, 5), tuple(latent.shape)).to(device)
        noisy = self.noise.add_noise(latent, noise, time)
        with self.processes.mixed_precision():
            clean = self.denoise(noisy, time, windows.history, conditions)
        clean = clean.float()
        terms = {"latent": (clean - latent).square().mean()}
        total = terms["latent"]
        if diffusion.decoded:
            every = diffusion.decoded_every
            terms["decoded"] = self._decoded(windows.every(every), clean[::every], time[::every])
            total = total + diffusion.decoded * terms["decoded"]
        return total, terms

    def times(self, key: tuple[int, ...], size: int) -> Tensor:
        """Random times of a training batch, (size,): those at which samples are drawn, and any others."""
        diffusion = self.config.diffusion
        # More often late than early: the condition decides most where little of the latent is left.
        anywhere = (uniform((*key, 0), (size,)) ** TIME_POWER * diffusion.steps).long()
        steps = self.noise.times(diffusion.sampling_steps)
        sampled = steps[(uniform((*key, 1), (size,)) * len(steps)).long()]
        return torch.where(uniform((*key, 2), (size,)) < diffusion.sampled, sampled, anywhere)

    def close(self) -> None:
        """See `stage.Closing`."""
        self._ahead.close()

    @property
    def roll_out(self) -> float:
        """Final share of roll-outs; 0 without a history, or where no clip has two consecutive windows."""
        possible = bool(self.config.window.history) and self.training.windows.has_following
        return self.config.diffusion.roll_out if possible else 0.0

    def _key(self, step: int) -> tuple[int, ...]:
        return (self.seed, 23, step, self.processes.rank)

    def _batch(self, step: int) -> Drawn:
        key = self._key(step)
        return self.drawn(key, (*key, 3), self.config.stages.diffusion.batch, self._roll_out_share(step))

    def drawn(self, key: tuple[int, ...], described: tuple[int, ...], size: int, roll_out: float) -> Drawn:
        """Training batch, on the CPU: windows of clips, that change over to another, and after roll-outs.

        Args:
            key: seed of the windows.
            described: seed of their conditions.
            size: number of windows.
            roll_out: share of windows after roll-outs.
        """
        diffusion = self.config.diffusion
        rolled = int(round(roll_out * size))
        switched = int(round(diffusion.switched * size)) if self.config.window.history else 0
        parts = [self._drawn((*key, 0), size - rolled - switched, begun=diffusion.begun)]
        if switched:
            # A motion that is asked for in the middle of another one begins at its beginning.
            others = self.training.draw((*key, 2, 0), switched, begun=SWITCHED_BEGUN, known=False)
            parts.append(self._drawn((*key, 1), switched).blended_into(others, diffusion.switch_frames))
        before = self._before((*key, 6), rolled) if rolled else None
        if before is not None:
            parts.append(before.windows.next(before.windows.history))
        windows = reduce(Windows.joined, parts)
        return Drawn(windows, self.training.describe(windows, described), before)

    def followed(self, drawn: Drawn) -> tuple[Windows, Conditions]:
        """A batch on the device of the training, with histories that the model has sampled where it rolls out."""
        device = self.processes.device
        windows, conditions = drawn.windows.to(device), drawn.conditions.to(device)
        if drawn.before is None:
            return windows, conditions
        kept = len(windows.history) - len(drawn.before.noise)
        sampled = self._sampled(drawn.before.windows.to(device), drawn.before.conditions.to(device), drawn.before.noise)
        history = torch.cat([windows.history[:kept], sampled[:, -self.config.window.history :]])
        return windows.with_history(history), conditions

    def denoise(self, noisy: Tensor, time: Tensor, history: Tensor, conditions: Conditions) -> Tensor:
        """Estimate of the clean latents, normalised, (N, latent)."""
        clean: Tensor = self.network(
            noisy,
            time,
            history,
            conditions.sentence,
            conditions.velocity,
            conditions.manner,
            conditions.present,
        )
        return clean

    def _decoded(self, windows: Windows, clean: Tensor, time: Tensor) -> Tensor:
        """Error of the decoded motion, of its change (the join with the history included) and of the root's path.

        Each window counts by the share of the latent that is left at its time, and up to `MAX_DECODED_ERROR`: paths
        that cannot be predicted would outweigh all others.
        """
        blocks = self.training.store.layout.blocks
        errors = (self.decode(windows.history, clean) - windows.future) * windows.mask[..., None]
        if self.config.window.history:  # the last frame of the history has no error
            errors = nn.functional.pad(errors, (0, 0, 1, 0))
        found = clean.new_zeros(len(clean))
        for name in DECODED:
            error = errors[..., blocks[name]]
            found = found + _mean_square(error) + 10 * _mean_square(torch.diff(error, dim=1))
        # Small errors of the root's velocity that keep their sign add up to a large error of its place.
        path = errors[..., blocks["root"]][..., :3].cumsum(dim=1)
        found = found + _mean_square(path) / path.shape[1]
        return (self.noise.kept[time] * found.clamp(max=MAX_DECODED_ERROR)).mean()

    def _roll_out_share(self, step: int) -> float:
        diffusion = self.config.diffusion
        grown = max(diffusion.roll_out_grown - diffusion.roll_out_from, 1)
        share = (step - diffusion.roll_out_from) / grown
        return self.roll_out * min(max(share, 0.0), 1.0)

    def _drawn(self, key: tuple[int, ...], size: int, *, following: bool = False, begun: float = 0.0) -> Windows:
        """Windows of clips, with noise on their histories."""
        windows = self.training.draw((*key, 0), size, following=following, begun=begun)
        return self._with_history_noise(windows, (*key, 1))

    def _with_history_noise(self, windows: Windows, seed: tuple[int, ...]) -> Windows:
        """Histories with one error for all their frames, and a smaller one for each frame."""
        spread = self.config.diffusion.history_noise
        if not spread or not self.config.window.history:
            return windows
        samples, frames, features = windows.history.shape
        constant = normal((*seed, 0), (samples, 1, features))
        varying = normal((*seed, 1), (samples, frames, features))
        return windows.with_history(windows.history + spread * (constant + 0.3 * varying))

    def _before(self, seed: tuple[int, ...], count: int) -> Before:
        """Windows before roll-outs, from which the model samples."""
        windows = self._drawn((*seed, 0), count, following=True)
        noise = normal((*seed, 3), (count, self.autoencoder.latent))
        return Before(windows, self.training.describe(windows, (*seed, 2)), noise)

    def _sampled(self, windows: Windows, conditions: Conditions, noise: Tensor) -> Tensor:
        """The model's own windows after some histories, (N, W, F)."""
        with torch.no_grad(), self.processes.mixed_precision():
            latent = self.noise.denoised(
                noise.to(self.processes.device),
                self.config.diffusion.roll_out_steps,
                lambda noisy, time: self.denoise(noisy, time, windows.history, conditions),
            )
            return self.decode(windows.history, latent).float()

    def validate(self) -> dict[str, float]:
        """Losses over all times of the schedule."""
        found = self._held_out
        samples = len(found.latent)
        time = torch.linspace(0, self.config.diffusion.steps - 1, samples).long().to(found.latent.device)
        noise = normal((self.seed, 24), tuple(found.latent.shape)).to(found.latent.device)
        clean = self.denoise(
            self.noise.add_noise(found.latent, noise, time), time, found.windows.history, found.conditions
        )
        latent = float((clean - found.latent).square().mean())
        decoded = float(self._decoded(found.windows, clean, time))
        return {"loss": latent + self.config.diffusion.decoded * decoded, "latent": latent, "decoded": decoded}


def _mean_square(error: Tensor) -> Tensor:
    """Mean square over frames and features, (N, T, F) -> (N,)."""
    return error.square().mean(dim=(1, 2))
