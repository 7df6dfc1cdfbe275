"""The evaluator's stage: contrastive training of windows and their sentences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from flexmotion.configs.model import ModelConfig
from flexmotion.evaluation.embeddings import r_precision
from flexmotion.training.conditions import Dropped, Sentences, describe
from flexmotion.training.evaluator import Evaluator
from flexmotion.training.feature_store import FeatureStore
from flexmotion.training.losses import Reconstruction
from flexmotion.training.processes import Processes
from flexmotion.training.window_set import WindowSet

ALIKE = 0.9
"""Sentences with a greater cosine are no negatives of each other (Petrovich et al., TMR, ICCV 2023)."""

VALIDATION = 512
"""Windows of the validation, always the same."""


class EvaluatorTask:
    """Training of the evaluator; see `stage.Task`.

    Args:
        config: of the model.
        store: features of the set.
        encode: sentence to embedding.
        seed: of the weights and of all draws.
        processes: that train.
    """

    def __init__(
        self,
        config: ModelConfig,
        store: FeatureStore,
        encode: Callable[[str], np.ndarray],
        seed: int,
        processes: Processes,
    ) -> None:
        torch.manual_seed(seed)
        self.config, self.store, self.seed, self.processes = config, store, seed, processes
        self.network = Evaluator(config.evaluator, config.window, store.layout, config.diffusion.text)
        self.network.to(processes.device)
        self._sentences = Sentences(store.clips, encode, named=True)
        self._restore = Reconstruction(store.layout, store.statistics, config.losses).restore
        self._training, self._held_out = (WindowSet(store, config.window, split) for split in ("train", "validation"))

    def losses(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        """See `stage.Task`."""
        key = (self.seed, 51, step, self.processes.rank)
        motion, text, alike = self._embedded(self._training, key, self.config.stages.evaluator.batch)
        logits = motion @ text.T / self.config.evaluator.temperature
        # The diagonal is each window's own sentence.
        logits = logits.masked_fill(alike & ~torch.eye(len(logits), dtype=torch.bool, device=logits.device), -1e4)
        wanted = torch.arange(len(logits), device=logits.device)
        loss = 0.5 * (cross_entropy(logits, wanted) + cross_entropy(logits.T, wanted))
        return loss, {"contrast": loss}

    def _embedded(self, windows: WindowSet, key: tuple[int, ...], batch: int) -> tuple[Tensor, Tensor, Tensor]:
        """Embeddings of motions and of their sentences, and which sentences count as the same."""
        found = windows.draw((*key, 0), batch)
        future, drop = self._restore(found.future), Dropped(velocity=1.0)
        conditions = describe(self.store, self._sentences, future, found.clip, (*key, 1), drop, first=found.first)
        described = conditions.present[:, 0] > 0
        device = self.processes.device
        motion, sentence = found.future[described].to(device), conditions.sentence[described].to(device)
        with self.processes.mixed_precision():
            motion, text = self.network.motion(motion), self.network.sentence(sentence)
        return motion.float(), text.float(), sentence @ sentence.T > ALIKE

    def validate(self) -> dict[str, float]:
        """Loss and R-precision in batches of 32."""
        motion, text, _ = self._embedded(self._held_out, (self.seed, 52), VALIDATION)
        precision = r_precision(motion.cpu().numpy(), text.cpu().numpy(), np.random.default_rng(self.seed))
        return {"loss": -precision[2], **{f"top{k + 1}": value for k, value in enumerate(precision)}}
