"""Differentiable muscle torques: polynomials of joint angles and speeds, fitted to the muscle models.

The torque of a muscle at a joint is moment arm times gain times activation, plus a passive part; both are polynomials
of the pose (`biomechanics/muscle_arms.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.biomechanics.muscle_arms import LIMBS, polynomial
from flexmotion.biomechanics.muscle_geometry import muscle_models
from flexmotion.biomechanics.static_optimisation import muscle_moments
from flexmotion.dataset.compact_set import MotionSet
from flexmotion.dataset.training_set import SetClip
from flexmotion.features.joint_groups import BALL_COLUMNS, BALL_SIGNS, HINGE_COLUMNS
from flexmotion.features.layout import ACTIVATIONS, Layout
from flexmotion.human.skeleton import JOINTS
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.training.format import FORMAT, MUSCLES_VERSIONS, UNVERSIONED
from flexmotion.training.human_tensors import HumanTensors
from flexmotion.training.kinematics import pose

CLIPS, FRAMES = 300, 40
"""The polynomials are fitted to the middle frames of this many clips."""

RIDGE = 1e-4
"""Penalty of the regression, per frame."""


@dataclass(frozen=True)
class Limb:
    """Polynomials of one muscle model, J joints, M muscles, P terms.

    Attributes:
        columns: indices of the joints in `JOINTS`, (J,).
        active: coefficients of the torque at full activation, (P, J, M) [N·m].
        passive: coefficients of the passive torque, (P, J) [N·m].
    """

    columns: np.ndarray
    active: Tensor
    passive: Tensor


@dataclass(frozen=True)
class MuscleTorques:
    """Polynomials of all muscle models, in the order of their activations."""

    limbs: tuple[Limb, ...]

    def residual(self, features: Tensor, layout: Layout, humans: HumanTensors) -> Tensor:
        """Muscle torques minus joint torques, per body weight and leg length, (N, T - 2, 13).

        Args:
            features: not normalised, (N, T, F).
            layout: with activations.
            humans: N of them.
        """
        angles = joint_angles(features, layout, humans)
        speeds = 0.5 * layout.fps * (angles[:, 2:] - angles[:, :-2])
        inner = features[:, 1:-1]
        activations, torques = inner[..., layout.blocks[ACTIVATIONS]], inner[..., layout.blocks["torques"]]
        scale = (humans.strength / (humans.mass.sum(dim=1) * GRAVITY * humans.leg))[:, None, None]
        found, start = [], 0
        for limb in self.limbs:
            columns = torch.from_numpy(limb.columns)
            terms = polynomial(angles[:, 1:-1, columns], speeds[..., columns], torch)
            count = limb.active.shape[2]
            arms = torch.einsum("ntp,pjm->ntjm", terms, limb.active.to(terms.device))
            total = torch.einsum("ntjm,ntm->ntj", arms, activations[..., start : start + count])
            total = total + terms @ limb.passive.to(terms.device)
            found.append(scale * total - torques[..., columns])
            start += count
        return torch.cat(found, dim=-1)


def joint_angles(features: Tensor, layout: Layout, humans: HumanTensors) -> Tensor:
    """Joint angles in the order of `JOINTS`, (N, T, 26) [rad]; second angles of ball joints within ±90°."""
    found = pose(features, layout, humans)
    balls = found.balls
    angles = features.new_zeros((*features.shape[:2], len(JOINTS)))
    three = torch.stack(
        [
            torch.atan2(balls[..., 0, 2], balls[..., 2, 2]),
            torch.asin((-balls[..., 1, 2]).clamp(-0.999, 0.999)),
            torch.atan2(balls[..., 1, 0], balls[..., 1, 1]),
        ],
        dim=-1,
    )
    signs = torch.as_tensor(BALL_SIGNS, dtype=features.dtype, device=features.device)
    angles[..., torch.from_numpy(BALL_COLUMNS)] = three * signs
    angles[..., torch.from_numpy(HINGE_COLUMNS)] = found.hinges
    return angles


def fit_muscle_torques(source: MotionSet, path: Path, seed: int = 0) -> None:
    """Fit the polynomials to poses of a set and write them.

    Args:
        source: set of clips.
        path: of the file.
        seed: of the choice of clips.

    Raises:
        ConfigError: `myo-sim` is not installed.
    """
    clips = list(source.select(split="train"))
    chosen = np.random.default_rng((seed, 71)).permutation(len(clips))[:CLIPS]
    arrays: dict[str, np.ndarray] = {"format": np.array(FORMAT)}
    for number, (active, passive) in enumerate(_fitted(source, [clips[at] for at in sorted(chosen)])):
        arrays |= {f"active{number}": active, f"passive{number}": passive}
    np.savez(path, allow_pickle=False, **arrays)


def load_muscle_torques(path: Path) -> MuscleTorques:
    """Read the file of `fit_muscle_torques`.

    Raises:
        ConfigError: its format is too old or too new.
    """
    with np.load(path) as found:
        MUSCLES_VERSIONS.check(int(found["format"]) if "format" in found else UNVERSIONED, path)
        limbs = [
            Limb(
                np.array([JOINTS.index(name) for name in names]),
                torch.from_numpy(found[f"active{number}"]),
                torch.from_numpy(found[f"passive{number}"]),
            )
            for number, names in enumerate(LIMBS)
        ]
    return MuscleTorques(tuple(limbs))


def _fitted(source: MotionSet, clips: list[SetClip]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Coefficients of every muscle model, (P, J, M) and (P, J), by ridge regression."""
    found = []
    for muscles, names in zip(muscle_models(), LIMBS, strict=True):
        assert muscles.joints == names
        terms, moments = [], []
        for clip in clips:
            middle = max(0, (clip.frames - FRAMES) // 2)
            motion = source.motion(clip)[middle : middle + FRAMES]
            angles = motion.joints[:, muscles.columns]
            active, passive = muscle_moments(muscles, motion)
            speeds = derivative(angles, motion.fps)
            terms.append(polynomial(angles, speeds, np))
            moments.append(np.concatenate([active.reshape(len(motion), -1), passive], axis=1))
        design, wanted = np.concatenate(terms), np.concatenate(moments)
        normal = design.T @ design + RIDGE * len(design) * np.eye(design.shape[1])
        solution = np.linalg.solve(normal, design.T @ wanted).astype(np.float32)
        joints = len(names)
        split = solution.shape[1] - joints
        found.append((solution[:, :split].reshape(len(solution), joints, split // joints), solution[:, split:]))
    return found
