"""`ConstraintSolver`: closes what is left of the error of constrained values by a fixed number of steps in the latent.

A window is measured as it is handed on, feet planted and balanced, and its latent is changed by one Gauss-Newton step:
for residuals r of R asked values over their tolerances, with derivatives J by the latent,

    d = Jᵀ (J Jᵀ + damping)⁻¹ r = argmin |J d - r|² + damping |d|²

A latent has unit variance under the model, so |d|² is what a step asks of the model's prior: it stays near.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from flexmotion.bundles.bundle import Bundle
from flexmotion.configs.errors import SamplingError
from flexmotion.features.constraint_layout import (
    BLOCKS,
    CENTRES,
    FORCES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
)
from flexmotion.features.constraints import Constraints, end_mean
from flexmotion.features.decode import Anchor
from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE
from flexmotion.features.layout import POINTS, Layout
from flexmotion.human.motion import Motion
from flexmotion.sampling.delivery import Delivered
from flexmotion.sampling.draft import Draft
from flexmotion.sampling.limb_closing import ARM, closable, within_arms
from flexmotion.sampling.tangent import Tangent
from flexmotion.sampling.torque_change import force_change, torque_change
from flexmotion.sampling.window_change import LINEAR, WindowChange
from flexmotion.sampling.window_pose import WindowPose, motion_values

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

OF_BALANCED = (TORQUES, TORQUE_LIMITS, FORCES, CENTRES)
"""Blocks that corrections reach in balanced windows alone, whose forces are those of their motion."""

MARGIN, HELD = 0.7, 0.5
"""Share of a torque limit to which greater torques are brought, and from which on they are held; others are free."""

CORRECTIONS = 1
"""Steps of a sampler that is not told otherwise: what a sample with constraints takes is in
`benchmarks/model/control.py`."""

ARMS_CLOSE = 0.12
"""Distance over which arms bring hands in reach to their places without a correction of the latent [m]. Behind a
branch a hand is 1.2 cm off with it and with .05 m, in 1.6 and 1.7 times a sample (30 held-out clips)."""

DAMPING, FAR = 1.0, 0.1
"""Damping of a step near the solution, and what the mean square of the residuals adds to it (Fan and Yuan, Computing
74, 2005): far from it, undamped steps go beyond where the derivatives hold. Over ten held-out clips three steps left a
hand 1.5 cm off with it, 3.4 without, and sixteen points at four keyframes 1.4 cm, 7.9 without. Derivatives of torques
are rough: more torques than the latent has numbers are damped by as many times more, lest they outweigh it."""


MEAN_TOLERANCES = (0.01, 0.01, 0.01, 0.005)
"""Errors of means of the path that count as one standard deviation of a latent, as `constraint_layout.TOLERANCES`. A
heading comes before a place, which is farther off where balance shifts the path: with .01 a walk back turned by 9°."""


def check(constraints: Constraints, bundle: Bundle, balanced: bool, *, branch: bool) -> None:
    """Check that a model can follow constraints.

    Args:
        constraints: what is asked.
        bundle: of the model.
        balanced: whether its windows are.
        branch: whether a control branch is used for them.

    Raises:
        SamplingError: they are of another layout, body or number of frames, or of what the model cannot follow.
    """
    name, frames = bundle.manifest.name, bundle.manifest.future
    if constraints.layout.layout != bundle.layout or constraints.body != bundle.body:
        raise SamplingError(f"the constraints are of another layout or body than model {name}'s")
    if len(constraints.mask) != frames:
        raise SamplingError(f"the constraints have {len(constraints.mask)} frames, a window has {frames}")
    for block in () if branch or balanced else OF_BALANCED:
        if constraints.mask[:, constraints.layout.blocks[block]].any():
            lacks = "has no control branch" + (" in this manner" if bundle.has_control else "")
            raise SamplingError(f"constraints of {block}: model {name} {lacks} and its windows are not balanced")


class ConstraintSolver:
    """Changes latents so that windows keep what is asked of them.

    Args:
        layout: of the features.
        tangent: of the decoder.
    """

    def __init__(self, layout: Layout, tangent: Tangent) -> None:
        self._layout, self._tangent = layout, tangent
        self._constraints = ConstraintLayout(layout)
        self._legs = _of_legs(self._constraints)
        self._forces = slice(layout.blocks["torques"].start, layout.size)
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
            constraints: what is asked; values beyond `window_change.LINEAR` are left to the decoder.
            steps: corrections; without any elbows and hands are left to the arms alone, near hands always. The
                last one sees the window as it is handed on, those before it a sketch of it; what neither arms keep nor
                forces are has one more. The last of several sees the window decoded anew. Where legs or forces were
                asked, forces and contacts are at last decoded from the latent as it became.
        """
        rows = self._rows(constraints, draft.balanced)
        change = np.zeros(self._tangent.size, np.float32)
        decoded = change  # of which the decoder has been run
        found = decode(latent)
        features = begun = draft.joined(found)
        # Places of the arms are kept at last wherever feet and balance take the body.
        left = rows.columns[~closable(constraints, (ARM,))[rows.columns]]
        exact = bool(draft.balanced and len(left)) or self._moves_legs(left)
        before = bool(len(left)) and not rows.of_forces
        for step in range(steps + before if steps and rows.count else 0):
            last = step == steps + before - 1
            if last and (steps > 1 or exact and step):
                decoded, found = change, decode(latent + change)
                features = begun = draft.joined(found)
            if last and exact or rows.of_forces:
                motion, slip = draft.planted(features)
                travelled = found + self._travelled(change - decoded)
                window = draft.delivered(motion, travelled, constraints, closes=False).window
                pose = WindowPose.of(window, draft.anchor)
                holding = None if slip is None else slip.holding.turned(-draft.anchor.yaw)
            else:
                window = None
                pose, holding = draft.sketched(features)
                arms_do = not step and not len(left) and within_arms(pose, constraints, ARMS_CLOSE)
                if arms_do and bool((np.abs(self._missing_means(rows, pose)) < 1.0).all()):
                    break
            jacobian, residual = self._linear(rows, self._tangent.at(pose, holding), pose, window, draft.anchor)
            change = (change + solved(jacobian, residual, rows.of_torques)).astype(np.float32)
            features = begun + self._tangent.features(change - decoded, self._layout)
        if (self._moves_legs(rows.columns) or rows.of_forces) and change is not decoded:
            features[:, self._forces] = draft.joined(decode(latent + change))[:, self._forces]
        motion, _ = draft.planted(features)
        return draft.delivered(motion, found + self._travelled(change - decoded), constraints)

    def _linear(
        self, rows: _Rows, changes: WindowChange, pose: WindowPose, window: Motion | None, anchor: Anchor
    ) -> tuple[Float32, Float32]:
        """Derivatives, (R, L), and residuals, (R,), of what is asked, over their tolerances: of frames, of means."""
        jacobian, residual = self._of_frames(rows, changes, pose, window, anchor)
        if not len(rows.means):
            return jacobian, residual
        means = (rows.weights / rows.tolerances[:, None]) @ end_mean(changes.path)
        missing = np.append(residual, self._missing_means(rows, pose))
        return np.concatenate([jacobian, means.astype(np.float32)]), missing

    def _of_frames(
        self, rows: _Rows, changes: WindowChange, pose: WindowPose, window: Motion | None, anchor: Anchor
    ) -> tuple[Float32, Float32]:
        """Those of what is asked of single frames."""
        frames, columns, weight = rows.frames, rows.columns, self._weight[rows.columns]
        jacobian = changes.jacobian(self._constraints, frames, columns)
        if not rows.of_forces or window is None:
            values = pose.values(self._constraints, rows.of_rotations)[frames, columns]
            return _over(weight, jacobian, rows.asked - values)
        values = motion_values(window, anchor, self._constraints, pose)[frames, columns]
        missing = rows.asked - values
        cut = self._constraints.blocks[FORCES]
        own = np.flatnonzero((columns >= cut.start) & (columns < cut.stop))
        if len(own):
            feet = force_change(changes, pose, window).reshape(len(window), cut.stop - cut.start, -1)
            jacobian[own] = feet[frames[own], columns[own] - cut.start]
        for name in (TORQUES, TORQUE_LIMITS):
            cut = self._constraints.blocks[name]
            own = (columns >= cut.start) & (columns < cut.stop)
            for joint in np.unique(columns[own]) - cut.start:
                of_joint = np.flatnonzero(columns == cut.start + joint)
                changed = torque_change(changes, pose, window, anchor.yaw, int(joint))
                jacobian[of_joint] = changed[frames[of_joint]]
            if name == TORQUE_LIMITS:
                beyond = np.maximum(np.abs(values) - MARGIN * rows.asked, 0.0)
                missing = np.where(own, -np.sign(values) * beyond, missing)
                jacobian[own & (np.abs(values) < HELD * rows.asked)] = 0.0
        return _over(weight, jacobian, missing)

    def _missing_means(self, rows: _Rows, pose: WindowPose) -> Float32:
        """What the window lacks of the means that are asked of its path, over their tolerances."""
        return np.asarray((rows.means - rows.weights @ end_mean(pose.path)) / rows.tolerances, np.float32)

    def _travelled(self, change: Float32) -> Float32:
        return self._tangent.travel(change, self._layout)

    def _moves_legs(self, columns: NDArray[np.intp]) -> bool:
        """Whether any of the columns is of the legs, which are stretched and bent where feet are planted."""
        return bool(self._legs[columns].any())

    def _rows(self, constraints: Constraints, balanced: bool) -> _Rows:
        """What is asked and can be corrected; torques and forces of windows alone that have those of their motion."""
        layout = self._constraints
        known = np.zeros(layout.size, np.bool_)
        for name in (*LINEAR, *((TORQUES, TORQUE_LIMITS, FORCES) if balanced else ())):
            known[layout.blocks[name]] = True
        frames, columns = np.nonzero(constraints.mask & known)
        rotations, asked, limits = (layout.blocks[name] for name in (ROTATIONS, TORQUES, TORQUE_LIMITS))
        forces = slice(asked.start, layout.blocks[FORCES].stop)
        of_torques = (columns >= asked.start) & (columns < limits.stop)
        weights = np.array([mean.weights for mean in constraints.means]).reshape(-1, BLOCKS[PATH])
        return _Rows(
            frames=frames,
            columns=columns,
            asked=constraints.values[frames, columns],
            of_rotations=bool(((columns >= rotations.start) & (columns < rotations.stop)).any()),
            of_forces=bool(((columns >= forces.start) & (columns < forces.stop)).any()),
            of_torques=np.append(of_torques, np.zeros(len(constraints.means), np.bool_)),
            weights=weights,
            tolerances=np.linalg.norm(weights * MEAN_TOLERANCES, axis=1),
            means=np.array([mean.value for mean in constraints.means]),
        )


@dataclass(frozen=True)
class _Rows:
    """Asked values: R of single frames, then M means.

    Attributes:
        frames, columns, asked: of each of a frame, with its value, (R,).
        of_rotations, of_forces: whether any is of rotations; of torques, their limits or ground forces.
        of_torques: which are of torques or their limits, (R + M,).
        weights, means, tolerances: of the columns of the block `PATH`, (M, 4), with their values, (M,).
    """

    frames: NDArray[np.intp]
    columns: NDArray[np.intp]
    asked: Float
    of_rotations: bool
    of_forces: bool
    of_torques: NDArray[np.bool_]
    weights: Float
    means: Float
    tolerances: Float

    @property
    def count(self) -> int:
        """Values, R + M."""
        return len(self.of_torques)


def _over(weight: Float, jacobian: Float32, missing: Float) -> tuple[Float32, Float32]:
    """Derivatives and residuals over tolerances, whose inverses are `weight`."""
    return jacobian * weight[:, None].astype(np.float32), (weight * missing).astype(np.float32)


def _of_legs(layout: ConstraintLayout) -> NDArray[np.bool_]:
    """Columns of angles and points of the legs, (C,)."""
    found = np.zeros(layout.size, np.bool_)
    rotations, places = layout.blocks[ROTATIONS].start + PELVIS_SIZE, layout.blocks[PLACES].start
    for number, ball in enumerate(BALLS):
        found[rotations + 6 * number : rotations + 6 * (number + 1)] = ball[0].startswith("hip")
    for number, hinge in enumerate(HINGES):
        found[rotations + 6 * len(BALLS) + number] = hinge.startswith(("knee", "ankle"))
    for number, point in enumerate(POINTS):
        found[places + 3 * number : places + 3 * (number + 1)] = point.startswith(("knee", "ankle", "heel", "toe"))
    return found


def solved(jacobian: Float32, residual: Float32, of_torques: NDArray[np.bool_] | None = None) -> Float32:
    """Change of the latent.

    Derivatives of torques are rough: more of them than the latent has numbers count together as so many.

    Args:
        jacobian, residual: of what is asked, over its tolerances, (R, L) and (R,).
        of_torques: which of the R values are torques, or limits of torques; None: none.

    Returns:
        (L,), in standard deviations of the latent.
    """
    rows, size = jacobian.shape
    damping = DAMPING + FAR * float(np.mean(residual**2))
    if of_torques is not None and np.count_nonzero(of_torques) > size:
        acting = of_torques & jacobian.any(axis=1)  # limits that are kept have no derivatives
        share = np.where(acting, np.float32(np.sqrt(size / max(np.count_nonzero(acting), size))), np.float32(1.0))
        jacobian, residual = jacobian * share[:, None], residual * share
    if rows <= size:
        normal = jacobian @ jacobian.T
        normal[np.diag_indices(rows)] += damping
        found = jacobian.T @ cho_solve(cho_factor(normal), residual)
    else:
        normal = jacobian.T @ jacobian
        normal[np.diag_indices(size)] += damping
        found = cho_solve(cho_factor(normal), jacobian.T @ residual)
    return np.asarray(found, np.float32)
