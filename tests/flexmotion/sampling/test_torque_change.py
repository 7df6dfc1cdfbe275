"""Derivatives of torques, against the torques of windows that were changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.planted import Slip
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.sampling.torque_change import torque_change
from flexmotion.sampling.window_pose import WindowPose
from flexmotion.spatial.gravity import GRAVITY


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


@pytest.mark.parametrize(
    ("text", "joint"),
    [
        ("wave with the right hand", "shoulder_flexion_r"),
        ("wave with the right hand", "lumbar_extension"),
        ("walk forward", "knee_flexion_r"),
        ("walk forward", "ankle_dorsiflexion_r"),
    ],
)
def test_a_step_along_the_derivatives_lowers_a_torque_as_they_say(sampler: Sampler, text: str, joint: str) -> None:
    condition, number = Condition(text), JOINTS.index(joint)
    history = sampler.sample(sampler.standing(), condition, 3)
    remembered = sampler._remember(history)
    latent = sampler._latent(remembered, condition, 4)
    draft, found = sampler._draft(history, remembered, condition), sampler._frames(latent)
    tangent, begun = sampler._solver._tangent, draft.joined(found)

    def window(change: np.ndarray) -> tuple[Motion, Slip | None]:
        motion, slip = draft.planted(begun + tangent.features(change, sampler.layout))
        return draft.delivered(motion, found + tangent.travel(change, sampler.layout)).window, slip

    first, slip = window(np.zeros(tangent.size, np.float32))
    assert first.torques is not None and slip is not None
    pose = WindowPose.of(first, draft.anchor)
    changes = tangent.at(pose, slip.holding.turned(-draft.anchor.yaw))
    derivatives = torque_change(changes, pose, first, draft.anchor.yaw, number)
    torque = first.torques[:, 6 + number] / (sampler.body.mass * GRAVITY * sampler.body.leg)
    # Less of the torque's square over the window, the ends of which depend on what follows.
    inner = slice(4, -6)
    downhill = -derivatives[inner].T @ torque[inner]
    step = (0.5 * downhill / np.linalg.norm(downhill)).astype(np.float32)
    moved, _ = window(step)
    assert moved.torques is not None
    change = (moved.torques - first.torques)[inner, 6 + number] / (sampler.body.mass * GRAVITY * sampler.body.leg)
    gained, expected = float(change @ torque[inner]), float(derivatives[inner] @ step @ torque[inner])
    assert expected < 0 and 0.25 < gained / expected < 2.5
