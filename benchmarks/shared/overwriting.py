"""`Overwriting`: the simpler way to keep constraints, for comparison: asked features overwritten at every step.

As inpainting does (Tevet et al., MDM, ICLR 2023): what the network estimates is decoded, asked values take the place of
decoded ones, and the window is encoded again. Nothing is trained. It needs the encoder, which bundles do not have.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from flexmotion.bundles.bundle import Bundle
from flexmotion.features.constraint_layout import (
    FORCES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUES,
    ConstraintLayout,
    window_path,
    window_values,
)
from flexmotion.features.constraints import Constraints
from flexmotion.features.heading_frame import turned
from flexmotion.features.layout import ACTIVATIONS, Layout
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.training.export import load_networks
from flexmotion.training.run import Run

Float32 = NDArray[np.float32]


class Overwriting(Sampler):
    """A sampler that overwrites; without corrections and branch.

    Args:
        bundle: without a control branch.
        training: that it was exported from.
        steps: of the diffusion; None for the bundle's default.
        balanced: see `Sampler`.
    """

    def __init__(self, bundle: Bundle, training: Run, steps: int | None = None, *, balanced: bool = True) -> None:
        super().__init__(bundle, steps, unjudged=True, balanced=balanced, corrections=0)
        self._autoencoder, self._student = load_networks(training, distilled=True)

    def _estimate(self, condition: Condition, scale: float, manner_scale: float) -> Float32:
        clean = super()._estimate(condition, scale, manner_scale)
        asked = condition.constraints
        if asked is None or not asked.asked:
            return clean
        features = overwritten(self._frames(clean), asked, self.layout)
        normalised = torch.from_numpy(self._statistics.normalise(features))[None]
        with torch.no_grad():
            history = torch.from_numpy(self._inputs["history"][:1])
            latent, _ = self._autoencoder.encode(history, normalised)
            found: Float32 = ((latent - self._student.latent_mean) / self._student.latent_spread).numpy()
        return found


def overwritten(features: Float32, asked: Constraints, layout: Layout) -> Float32:
    """Features with asked values in place of their own, (W, layout.size), not normalised."""
    columns, found = ConstraintLayout(layout), features.astype(np.float64)
    own = window_values(found, layout, np)
    wanted = np.where(asked.mask, asked.values, own)
    blocks, parts = layout.blocks, columns.blocks
    path = wanted[:, parts[PATH]]
    yaw = path[:, 3]
    before = np.concatenate([[0.0], yaw[:-1]])
    step = np.diff(path[:, :2], axis=0, prepend=np.zeros((1, 2))) * layout.fps
    root = found[:, blocks["root"]]
    root[:, :2] = turned(np.pad(step, ((0, 0), (0, 1))), -before)[:, :2]
    root[:, 2] = np.diff(yaw, prepend=0.0) * layout.fps
    root[:, 3] = path[:, 2]
    place, heading = window_path(root, layout.fps, np)
    below = np.pad(place, ((0, 0), (0, 1)))[:, None]
    points = wanted[:, parts[PLACES]].reshape(len(found), -1, 3)
    found[:, blocks["positions"]] = turned(points - below, -heading).reshape(len(found), -1)
    found[:, blocks["rotations"]] = wanted[:, parts[ROTATIONS]]
    found[:, blocks["torques"]] = wanted[:, parts[TORQUES]]
    wrenches = found[:, blocks["wrenches"]].reshape(len(found), 2, 2, 3)
    wrenches[:, :, 0] = turned(wanted[:, parts[FORCES]].reshape(len(found), 2, 3), -heading)
    if layout.muscles:
        found[:, blocks[ACTIVATIONS]] = wanted[:, parts[ACTIVATIONS]]
    return found.astype(np.float32)
