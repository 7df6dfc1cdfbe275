"""`ConstraintSolver`: closes what is left of the error of constrained values by a fixed number of steps in the latent.

A window is measured as it is handed on, feet planted and balanced, and its latent is changed by one Gauss-Newton step:
for residuals r of R asked values over their tolerances, with derivatives J by the latent,

    d = Jᵀ (J Jᵀ + damping)⁻¹ r = argmin |J d - r|² + damping |d|²

A latent has unit variance under the model, so |d|² is what a step asks of the model's prior.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from flexmotion.features.constraint_layout import ConstraintLayout
from flexmotion.features.constraints import Constraints
from flexmotion.features.layout import Layout
from flexmotion.sampling.delivery import Delivered
from flexmotion.sampling.draft import Draft
from flexmotion.sampling.tangent import LINEAR, Tangent
from flexmotion.sampling.window_pose import WindowPose

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

CORRECTIONS = 2
"""Steps of a sampler that is not told otherwise."""

DAMPING = 0.3
"""Weight of a step's square against that of the residuals over their tolerances."""


class ConstraintSolver:
    """Changes latents so that windows keep what is asked of them.

    Args:
        layout: of the features.
        tangent: of the decoder.
    """

    def __init__(self, layout: Layout, tangent: Tangent) -> None:
        self._layout, self._tangent = layout, tangent
        self._constraints = ConstraintLayout(layout)
        self._weight = 1.0 / np.array(self._constraints.tolerances)

    def window(
        self,
        draft: Draft,
        decode: Callable[[Float32], Float32],
        latent: Float32,
        constraints: Constraints,
        steps: int,
    ) -> Delivered:
        """The window that keeps its constraints.

        Args:
            draft: of the window.
            decode: features of a latent, (1, L) -> (W, F), not normalised.
            latent: that was sampled, (1, L).
            constraints: what is asked; values beyond `tangent.LINEAR` are left to the decoder.
            steps: corrections. The last one sees the window as it is handed on, those before it see it planted, which
                is most of the way and half of the time.
        """
        frames, columns = self._rows(constraints)
        change = np.zeros(self._tangent.size, np.float32)
        found = decode(latent)
        begun, made = draft.joined(found), found
        features = begun
        for step in range(steps if len(frames) else 0):
            motion, holding = draft.planted(features)
            planted = WindowPose.of(motion, draft.anchor)
            measured = planted
            if step == steps - 1 and draft.balanced:
                measured = WindowPose.of(draft.delivered(motion, made).window, draft.anchor)
            jacobian = self._tangent.jacobian(planted, holding, self._constraints, frames, columns)
            values = measured.values(self._constraints)
            weight = self._weight[columns]
            residual = weight * (constraints.values[frames, columns] - values[frames, columns])
            change += _step(jacobian * weight[:, None].astype(np.float32), residual.astype(np.float32))
            features = begun + self._tangent.features(change, self._layout)
            made = found + self._tangent.travel(change, self._layout)
        motion, _ = draft.planted(features)
        return draft.delivered(motion, made, constraints)

    def _rows(self, constraints: Constraints) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Frames and columns of what is asked and can be corrected."""
        known = np.zeros(self._constraints.size, np.bool_)
        for name in LINEAR:
            known[self._constraints.blocks[name]] = True
        frames, columns = np.nonzero(constraints.mask & known)
        return frames, columns


def _step(jacobian: Float32, residual: Float32) -> Float32:
    """Change of the latent, (L,), for R rows over their tolerances."""
    rows, size = jacobian.shape
    found: Float32
    if rows <= size:
        normal = jacobian @ jacobian.T
        normal[np.diag_indices(rows)] += DAMPING
        found = jacobian.T @ cho_solve(cho_factor(normal), residual)
        return found
    normal = jacobian.T @ jacobian
    normal[np.diag_indices(size)] += DAMPING
    found = cho_solve(cho_factor(normal), jacobian.T @ residual)
    return found
