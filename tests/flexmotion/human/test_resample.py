"""Motions at other frame rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexmotion.human.kinematics import forward
from flexmotion.human.resample import resample


def test_there_and_back(clip):
    back = resample(resample(clip, 120.0), 30.0)
    assert len(back) == len(clip)
    assert np.abs(back.joints - clip.joints).max() < 0.05
    error = np.linalg.norm(forward(back).ankle - forward(clip).ankle, axis=-1)
    assert np.sqrt(np.mean(error**2)) < 2e-3


def test_duration_and_body_stay(clip):
    slow = resample(clip, 20.0)
    assert slow.duration == pytest.approx(clip.duration, abs=1 / 20)
    assert slow.body == clip.body
    np.testing.assert_allclose(np.linalg.norm(slow.root_quaternion, axis=1), 1.0)


def test_all_fields_are_resampled(clip):
    frames = len(clip)
    full = replace(
        clip,
        torques=np.zeros((frames, 32)),
        wrenches=np.ones((frames, 2, 6)),
        activations=np.tile([0.0, 1.0], (frames, 1)),
        contacts=np.arange(frames)[:, None] % 20 < [10, 15],
    )
    half = resample(full, 15.0)
    assert half.torques.shape == (len(half), 32)
    assert half.wrenches == pytest.approx(np.ones((len(half), 2, 6)))
    assert half.activations.min() >= 0
    assert half.activations.max() <= 1
    np.testing.assert_array_equal(half.contacts, full.contacts[::2])


def test_rounded_frame_times_are_the_same_rate(clip):
    rounded = replace(clip, fps=1 / 0.0333333)
    result = resample(rounded, 30.0)
    assert result.fps == 30.0
    np.testing.assert_array_equal(result.joints, clip.joints)


@pytest.mark.parametrize("fps", [0.0, -30.0, float("nan")])
def test_invalid_rates_are_refused(clip, fps):
    with pytest.raises(ValueError, match="fps"):
        resample(clip, fps)
