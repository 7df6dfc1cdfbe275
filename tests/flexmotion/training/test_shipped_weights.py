"""The repository's weights: the shipped bundle is made of them by one command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra 'train'")

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.human.kinematics import forward
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.streamer.cli import execute

WEIGHTS = Path(__file__).parents[3] / "weights" / "stream.safetensors"


@pytest.mark.skipif(not WEIGHTS.is_file(), reason="packages come without the weights")
def test_the_shipped_bundle_is_made_of_the_weights_with_the_control_branch_beside(tmp_path: Path) -> None:
    """They had no student: no command could make a bundle of them, nor train the control branch further."""
    shipped = shipped_bundle()
    assert shipped is not None
    command = ["export", str(WEIGHTS), "--corrections", str(shipped), "--eight-bits", "-o", str(tmp_path / "made")]
    assert execute(command) == 0
    made = Bundle(tmp_path / "made")
    assert made.has_control and made.manifest.guided
    assert made.manifest.corrections == Bundle(shipped).manifest.corrections
    old, new = (Sampler(Bundle(folder), unjudged=True, balanced=True) for folder in (shipped, tmp_path / "made"))
    for prompt in ("walk forward", "wave with the right hand", "bow"):
        before, after = (one.sample(one.standing(), Condition(prompt), 0) for one in (old, new))
        # Equal on the processor that made the bundle; another one folds constants otherwise, which eight bits amplify.
        assert np.linalg.norm(forward(before).hand - forward(after).hand, axis=-1).mean() < 0.003
        assert before.torques is not None and after.torques is not None
        assert np.abs(before.torques - after.torques).mean() < 0.1
