"""What a model samples to be kept as it is, where its training set is not at hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra 'train' is not installed")

from flexmotion.text.phrases import wordings
from flexmotion.text.sentence_encoder import SentenceEncoder
from flexmotion.training.checkpoints import load_weights
from flexmotion.training.manner_conditions import mean_embedding
from flexmotion.training.own_samples import OwnSamples
from flexmotion.training.run import Run


def test_a_model_is_kept_at_what_it_is_asked(trained: Run, stages: Any) -> None:
    """Regression: it was kept at single wordings, while requests are heard as the mean of a kind's wordings."""
    model, encode, summary = stages.diffusion(trained), SentenceEncoder(trained.stage("text")), trained.summary()
    load_weights(model.network, trained.stage("diffusion"))
    own = OwnSamples(model, encode, summary, 0, trained.config.diffusion)
    sentences = own.draw((0,), 64).conditions.sentence.numpy()
    heard = np.stack([mean_embedding(wordings(kind), encode) for kind in summary.kinds])
    assert (sentences @ heard.T).max(axis=1) == pytest.approx(1.0, abs=1e-5)
