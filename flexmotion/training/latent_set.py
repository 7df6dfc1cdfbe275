"""`LatentSet`: windows of a split with their latents and conditions, as the diffusion is trained on them."""

from __future__ import annotations

import torch
from torch import Tensor

from flexmotion.configs.model import ModelConfig
from flexmotion.training.autoencoder import Autoencoder
from flexmotion.training.conditions import Conditions, Dropped, Sentences, describe
from flexmotion.training.feature_store import FeatureStore
from flexmotion.training.losses import Reconstruction
from flexmotion.training.manner_conditions import Manners
from flexmotion.training.processes import Processes
from flexmotion.training.window_set import WindowSet
from flexmotion.training.windows import Windows


class LatentSet:
    """Windows of a split with their latents and conditions.

    Args:
        config: of the model.
        store: features of the set.
        split: `train` or `validation`.
        autoencoder: trained.
        sentences, manners: of the store's clips.
        processes: that train.
    """

    def __init__(
        self,
        config: ModelConfig,
        store: FeatureStore,
        split: str,
        autoencoder: Autoencoder,
        sentences: Sentences,
        manners: Manners,
        processes: Processes,
    ) -> None:
        self.config, self.store, self.autoencoder = config, store, autoencoder
        self.sentences, self.manners = sentences, manners
        self.processes = processes
        self.windows = WindowSet(store, config.window, split, normal=config.diffusion.normal)
        self._restore = Reconstruction(store.layout, store.statistics, config.losses).restore

    def draw(
        self, seed: tuple[int, ...], size: int, *, following: bool = False, begun: float = 0.0, known: bool = True
    ) -> Windows:
        """Draw `size` windows, on the CPU; see `WindowSet.draw`."""
        return self.windows.draw(seed, size, following=following, begun=begun, known=known)

    def encode(self, history: Tensor, future: Tensor) -> Tensor:
        """Mean latents, (N, latent), not normalised."""
        with torch.no_grad(), self.processes.mixed_precision():
            return self.autoencoder.encode(history, future)[0].float()

    def describe(self, windows: Windows, seed: tuple[int, ...]) -> Conditions:
        """Conditions of windows, on the CPU; a share of sentences, velocities and manners is dropped at random."""
        diffusion = self.config.diffusion
        drop = Dropped(
            diffusion.drop_text, diffusion.drop_velocity if diffusion.velocity else 1.0, diffusion.drop_manner
        )
        future = self._restore(windows.future.cpu())
        return describe(self.store, self.sentences, future, windows.clip, seed, drop, self.manners, windows.first)
