"""A window of which nothing is said goes on with its history."""

from __future__ import annotations

import numpy as np

from flexmotion.bundles.bundle import Bundle
from flexmotion.bundles.shipped import shipped_bundle
from flexmotion.human.concatenate import concatenate
from flexmotion.human.kinematics import forward
from flexmotion.sampling.sampler import Condition, Sampler


def test_a_raised_hand_stays_up_where_no_word_says_otherwise() -> None:
    """A velocity alone had the words of standing or walking: a mirrored person's raised arm was foreseen to sink."""
    folder = shipped_bundle()
    assert folder is not None
    sampler = Sampler(Bundle(folder), unjudged=True, balanced=False)
    motion = sampler.standing()
    for seed in range(2):
        motion = concatenate([motion, sampler.sample(motion, Condition("raise the right hand"), seed)])
    # Until the hand is up.
    height = forward(motion).hand[:, 1, 2]
    motion = motion[: int(np.argmax(height)) + 1]
    raised = height.max()
    still = (0.0, 0.0, 0.0)
    heights = [
        forward(sampler.sample(motion, Condition(velocity=still, wordless=wordless, guidance=1.0, noise=0.0), 5)).hand[
            25, 1, 2
        ]
        for wordless in (False, True)
    ]
    assert raised > 1.3
    assert abs(heights[1] - raised) < abs(heights[0] - raised)
    assert np.isfinite(heights).all()
