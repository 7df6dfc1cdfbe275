"""Derivatives of torques and ground forces, against those of windows that were changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexmotion.bundles.bundle import Bundle
from flexmotion.features.constraints import Constraints
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.planted import Slip
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.sampling.torque_change import force_change, torque_change
from flexmotion.sampling.window_pose import WindowPose
from flexmotion.spatial.gravity import GRAVITY


@pytest.fixture(scope="module")
def sampler(bundle: Path) -> Sampler:
    return Sampler(Bundle(bundle))


class Window:
    """A sampled window, and what becomes of it when its latent changes."""

    def __init__(self, sampler: Sampler, text: str, seed: int = 4) -> None:
        # Whose torques are asked is balanced with its feet, and does not rest.
        limits = Constraints.none(sampler.layout, sampler.body, sampler.future).torque_limit("knee_flexion_r", 0, 1e6)
        self.sampler, condition = sampler, Condition(text, constraints=limits)
        history = sampler.sample(sampler.standing(), condition, 3)
        remembered = sampler._remember(history)
        meant = sampler.meant(condition)
        latent = sampler._latent(remembered, meant, seed)
        self._draft = replace(sampler._draft(history, remembered, condition, meant), quiet=False, idle=frozenset())
        self._found = sampler._frames(latent)
        self.tangent, self._begun = sampler._solver._tangent, self._draft.joined(self._found)
        self.first, slip = self.changed(np.zeros(self.tangent.size, np.float32))
        assert slip is not None
        self.yaw = self._draft.anchor.yaw
        self.pose = WindowPose.of(self.first, self._draft.anchor)
        self.changes = self.tangent.at(self.pose, slip.holding.turned(-self.yaw))

    def changed(self, change: np.ndarray) -> tuple[Motion, Slip | None]:
        motion, slip = self._draft.planted(self._begun + self.tangent.features(change, self.sampler.layout))
        travelled = self._found + self.tangent.travel(change, self.sampler.layout)
        return self._draft.delivered(motion, travelled).window, slip


INNER = slice(4, -6)
"""The ends of a window depend on what comes before and follows."""


@pytest.mark.parametrize(
    ("text", "joint", "least"),
    [
        ("wave with the right hand", "shoulder_flexion_r", 0.25),
        ("wave with the right hand", "lumbar_extension", 0.25),
        ("walk forward", "knee_flexion_r", 0.25),
        # Of the shipped model .09 to .16 in five windows; the balance, which no derivative knows, may be the cause.
        ("walk forward", "ankle_dorsiflexion_r", 0.1),
    ],
)
def test_a_step_along_the_derivatives_lowers_a_torque_as_they_say(
    sampler: Sampler, text: str, joint: str, least: float
) -> None:
    """Over three windows: a step may lift a foot of one, and torques change where no derivative tells it."""
    found = [followed(Window(sampler, text, seed), joint) for seed in (4, 5, 6)]
    assert least < float(np.median(found)) < 2.5


def followed(window: Window, joint: str) -> float:
    """By how much a torque's square changes with a step down its derivatives, over what these say."""
    number, sampler, first = JOINTS.index(joint), window.sampler, window.first
    assert first.torques is not None
    derivatives = torque_change(window.changes, window.pose, first, window.yaw, number)
    torque = first.torques[:, 6 + number] / (sampler.body.mass * GRAVITY * sampler.body.leg)
    # Less of the torque's square over the window.
    downhill = -derivatives[INNER].T @ torque[INNER]
    step = (0.5 * downhill / np.linalg.norm(downhill)).astype(np.float32)
    moved, _ = window.changed(step)
    assert moved.torques is not None
    change = (moved.torques - first.torques)[INNER, 6 + number] / (sampler.body.mass * GRAVITY * sampler.body.leg)
    gained, expected = float(change @ torque[INNER]), float(derivatives[INNER] @ step @ torque[INNER])
    assert expected < 0
    return gained / expected


@pytest.mark.parametrize("text", ["walk forward", "wave with the right hand"])
def test_a_step_along_the_derivatives_changes_the_ground_force_as_they_say(sampler: Sampler, text: str) -> None:
    window = Window(sampler, text)
    assert window.first.wrenches is not None
    weight = sampler.body.mass * GRAVITY
    derivatives = force_change(window.changes, window.pose, window.first).sum(axis=1)[INNER, 2]  # of both feet, up
    wanted = -(window.first.wrenches[:, :, 2].sum(axis=1) / weight - 1.0)[INNER]  # as when standing still
    uphill = derivatives.T @ wanted
    step = (0.5 * uphill / np.linalg.norm(uphill)).astype(np.float32)
    moved, _ = window.changed(step)
    assert moved.wrenches is not None
    change = (moved.wrenches - window.first.wrenches)[:, :, 2].sum(axis=1)[INNER] / weight
    gained, expected = float(change @ wanted), float(derivatives @ step @ wanted)
    assert expected > 0 and 0.25 < gained / expected < 2.5
