"""Derivatives of a planted window, against differences of the window itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.biomechanics.smoothing import CUTOFF
from flexmotion.bundles.bundle import Bundle
from flexmotion.features.constraint_layout import PATH, PLACES, ROTATIONS, ConstraintLayout
from flexmotion.features.encode import encode
from flexmotion.features.layout import POINTS, Layout
from flexmotion.features.unhurried import CALM
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.sampling.draft import Draft
from flexmotion.sampling.tangent import Tangent, decoder_jacobian
from flexmotion.sampling.window_pose import WindowPose

LAYOUT = Layout(30.0)
FRAMES = 16


@pytest.fixture
def draft(clip: Motion) -> tuple[Draft, np.ndarray]:
    """A walking window after its history, and its features."""
    motion = resample(clip, 30.0)[60 : 60 + 12 + FRAMES]
    features = encode(motion, LAYOUT)
    return Draft(
        layout=LAYOUT,
        body=motion.body,
        history=motion[:12],
        remembered=features[4:12],
        balanced=True,
        rest=motion[:1],
        idle=frozenset(),
        stands=False,
        quiet=False,
        on_the_spot=False,
        in_place=False,
        fastest=CALM,
        asked=None,
        pose=None,
        beside=None,
        cutoff=CUTOFF,
        source="",
    ), features[12:]


def smooth_changes() -> Tangent:
    """Two directions in which a latent might change a window."""
    rng = np.random.default_rng(3)
    columns = LAYOUT.blocks["rotations"].stop
    time = np.linspace(0.0, 1.0, FRAMES)[:, None, None]
    jacobian = np.zeros((FRAMES, LAYOUT.size, 2), np.float32)
    jacobian[:, :columns] = np.sin(np.pi * time) * rng.normal(size=(columns, 2)) * 0.2
    return Tangent.of(jacobian, 8, LAYOUT)


def wrong(draft: Draft, found: np.ndarray, block: str, held: bool) -> float:
    """Relative error of the derivatives of a block."""
    tangent, layout = smooth_changes(), ConstraintLayout(LAYOUT)
    first, size = layout.blocks[block].start, layout.blocks[block].stop - layout.blocks[block].start

    def values(change: np.ndarray) -> np.ndarray:
        motion, _ = draft.planted(draft.joined(found) + tangent.features(change.astype(np.float32), LAYOUT))
        return WindowPose.of(motion, draft.anchor).values(layout)[:, first : first + size]

    motion, slip = draft.planted(draft.joined(found))
    pose = WindowPose.of(motion, draft.anchor)
    frames, column = (grid.ravel() for grid in np.indices((FRAMES, size)))
    own = slip.holding.turned(-draft.anchor.yaw) if held and slip is not None else None
    given = tangent.at(pose, own).jacobian(layout, frames, first + column)
    expected = [(values(1e-3 * step) - values(-1e-3 * step)) / 2e-3 for step in np.eye(2)]
    apart = given - np.stack(expected, axis=-1).reshape(given.shape)
    return float(np.linalg.norm(apart) / np.linalg.norm(expected))


@pytest.mark.parametrize("block", [PATH, ROTATIONS, PLACES])
def test_derivatives_are_those_of_a_window_in_the_air(draft: tuple[Draft, np.ndarray], block: str) -> None:
    made, found = draft
    found[:, LAYOUT.blocks["contacts"]] = 0.0
    assert wrong(made, found, block, held=True) < 1e-3


@pytest.mark.parametrize("block", [PATH, PLACES])
def test_derivatives_know_of_planted_feet(draft: tuple[Draft, np.ndarray], block: str) -> None:
    made, found = draft
    toes = [POINTS.index("toe_l"), POINTS.index("toe_r")]
    heights = found[:, LAYOUT.blocks["positions"]].reshape(FRAMES, -1, 3)[:, toes, 2]
    found[:, LAYOUT.blocks["contacts"]] = heights <= heights.min(axis=1, keepdims=True)
    known, unknown = (wrong(made, found, block, held=held) for held in (True, False))
    assert known < 0.6 * unknown


def test_the_change_of_a_window_leaves_its_history(draft: tuple[Draft, np.ndarray]) -> None:
    jacobian = np.ones((FRAMES, LAYOUT.size, 1), np.float32)
    change = Tangent.of(jacobian, 8, LAYOUT).features(np.ones(1, np.float32), LAYOUT)
    rotations = change[:, LAYOUT.blocks["rotations"]]
    assert np.abs(rotations[0]).max() < 0.1 < np.abs(rotations[-1]).min()


def test_a_linear_decoder_is_differentiated_exactly() -> None:
    weights = np.random.default_rng(0).normal(size=(3, 2, 4)).astype(np.float32)
    found = decoder_jacobian(lambda latent: weights @ latent[0] + 1.0, 4)
    np.testing.assert_allclose(found, weights, atol=1e-5)


def test_a_bundle_without_derivatives_says_so(bundle: Path) -> None:
    found = Bundle(bundle).jacobian
    layout = Bundle(bundle).layout
    assert found is None or found.shape[1] == layout.size
