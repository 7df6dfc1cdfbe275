"""`Tangent`: how path, rotations and points of a window change with its latent, to first order.

The motion that a decoder makes is nearly linear in its latent: Jacobians of different windows differ by 3 % in the
features of motion (and by 70 % and more in those of forces, which are therefore not here). One Jacobian of these
features is enough; forward kinematics, in which the curvature lies, are differentiated in closed form at the motion as
it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmotion.bundles.bundle import Bundle
from flexmotion.features.inertialise import inertialised
from flexmotion.features.layout import Layout
from flexmotion.sampling.column_cuts import ColumnCuts
from flexmotion.sampling.low_pass import steadied
from flexmotion.sampling.planted import Holding
from flexmotion.sampling.window_change import WindowChange
from flexmotion.sampling.window_pose import WindowPose

Float32 = NDArray[np.float32]

DIFFERENCE = 0.5
"""Change of a number of the latent, which has unit variance, by which a decoder is differentiated."""


@dataclass(frozen=True)
class Tangent:
    """Derivatives of a window's features by its latent of L numbers, not normalised.

    Attributes:
        made: of the block `root` as decoded, before the window is joined to its history, (W, 4, L).
        root: of the block `root`, (W, 4, L).
        rotations: of the block `rotations`, (W, 50, L).
        fps: frames per second.
    """

    made: Float32
    root: Float32
    rotations: Float32
    fps: float

    @classmethod
    def of(cls, jacobian: NDArray[np.float32], history: int, layout: Layout) -> Tangent:
        """Of the window as it leaves the sampler: joined to its history, and low-passed.

        Both are linear in the window, so that its changes are joined to a history without any change. Windows that are
        not low-passed get low-passed changes all the same.

        Args:
            jacobian: of the decoder's features, not normalised, (W, F, L); of the blocks `root` and `rotations` at
                least.
            history: frames that are known before a window.
            layout: of the features.
        """
        still = np.zeros((history, layout.size), np.float32)
        columns = [steadied(inertialised(one, still, layout), still, layout) for one in np.moveaxis(jacobian, -1, 0)]
        whole = np.stack(columns, axis=-1).astype(np.float32)
        root, rotations = layout.blocks["root"], layout.blocks["rotations"]
        parts = (jacobian[:, root], whole[:, root], whole[:, rotations])
        made, joined, turned = (np.ascontiguousarray(part, np.float32) for part in parts)
        return cls(made, joined, turned, layout.fps)

    @property
    def size(self) -> int:
        """Numbers of the latent, L."""
        return self.root.shape[-1]

    def travel(self, change: Float32, layout: Layout) -> Float32:
        """Change of the features of a window before it is joined to its history: of the block `root` alone, (W, F)."""
        found = np.zeros((len(self.root), layout.size), np.float32)
        found[:, layout.blocks["root"]] = self.made @ change
        return found

    def features(self, change: Float32, layout: Layout) -> Float32:
        """Change of a window's features for a change of its latent, (L,) -> (W, layout.size); forces do not change."""
        found = np.zeros((len(self.root), layout.size), np.float32)
        found[:, layout.blocks["root"]] = self.root @ change
        found[:, layout.blocks["rotations"]] = self.rotations @ change
        return found

    def at(self, pose: WindowPose, holding: Holding | None) -> WindowChange:
        """Derivatives of a planted window as it is.

        Args:
            pose: of the window.
            holding: how its feet were held in place, in the frame of the window; None where they were not.
        """
        return WindowChange(self.root, self._cuts, self.fps, pose, holding)

    @cached_property
    def _cuts(self) -> ColumnCuts:
        return ColumnCuts(self.rotations)


def tangent_of(bundle: Bundle, decode: Callable[[Float32, Float32], Float32]) -> Tangent:
    """The tangent of a bundle's decoder; measured at a standing human where the bundle has no Jacobian.

    Args:
        bundle: of the model.
        decode: normalised frames (W, F) of a latent (1, L) after a normalised history (1, H, F).
    """
    manifest, statistics, rest = bundle.manifest, bundle.statistics, bundle.rest
    found = bundle.jacobian
    if found is None:
        history = statistics.normalise(rest[len(rest) - manifest.history :])[None]
        found = decoder_jacobian(lambda latent: decode(latent, history), manifest.latent)
    return Tangent.of(found * statistics.spread[:, None], manifest.history, bundle.layout)


def decoder_jacobian(decode: Callable[[Float32], Float32], size: int) -> Float32:
    """Derivatives of what a decoder makes by its latent, by differences from the latent of zeros, (W, F, L).

    Args:
        decode: frames (W, F) of a latent (1, L).
        size: of the latent, L.
    """
    middle = decode(np.zeros((1, size), np.float32))
    steps = DIFFERENCE * np.eye(size, dtype=np.float32)
    return np.stack([(decode(step[None]) - middle) / DIFFERENCE for step in steps], axis=-1)
