"""`MuscleArms`: the torque of every muscle at full activation, without the muscle models' libraries.

Moment arms times gains are smooth functions of the pose, given by polynomials (Sartori et al., J. Biomech. 45(3),
2012) of third order in the angles and second order in the speeds. `flexmotion/data/muscle_torques.npz` holds those
that `training.muscle_torques.fit_muscle_torques` fitted to 300 clips; over 60 held-out clips they are off by 4 %
(legs) and 2 % (trunk), root mean square.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import derivative
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS

Float = NDArray[np.float64]
Array = Any
"""NumPy array or torch tensor."""

FILE = Path(__file__).resolve().parents[1] / "data" / "muscle_torques.npz"

SPEED = 5.0
"""Unit of the speeds, so that all terms are of similar size [rad/s]."""

LIMBS = tuple(
    tuple(f"{joint}_{side}" for joint in ("hip_flexion", "hip_adduction", "hip_rotation", "knee_flexion"))
    + (f"ankle_dorsiflexion_{side}",)
    for side in ("l", "r")
) + (("lumbar_extension", "lumbar_bending", "lumbar_rotation"),)
"""Joints of every muscle model, in the order of `muscle_geometry.muscle_models`."""


@dataclass(frozen=True)
class MuscleArms:
    """Polynomials of all muscle models in the order of their activations; J joints, M muscles, P terms.

    Attributes:
        columns: of each model: indices of its joints in `JOINTS`, (J,).
        active: of each model: coefficients of the torque at full activation, (P, J, M) [N·m].
    """

    columns: tuple[NDArray[np.intp], ...]
    active: tuple[NDArray[np.float32], ...]

    @classmethod
    @lru_cache(maxsize=1)
    def shipped(cls) -> MuscleArms:
        """Those of the package."""
        with np.load(FILE, allow_pickle=False) as found:
            active = tuple(found[f"active{number}"] for number in range(len(LIMBS)))
        return cls(tuple(np.array([JOINTS.index(name) for name in names]) for names in LIMBS), active)

    @property
    def muscles(self) -> int:
        """All muscles."""
        return sum(part.shape[2] for part in self.active)

    def at(self, motion: Motion) -> list[Float]:
        """Torques at full activation over a motion, of each model, (T, J, M) [N·m of the muscle models' human]."""
        speeds = derivative(motion.joints, motion.fps)
        found = []
        for columns, active in zip(self.columns, self.active, strict=True):
            terms = polynomial(motion.joints[:, columns], speeds[:, columns], np)
            found.append((terms @ active.reshape(len(active), -1)).reshape(len(terms), *active.shape[1:]))
        return found


def polynomial(angles: Array, speeds: Array, xp: ModuleType) -> Array:
    """Terms of angles (..., J) [rad] up to the third order and of speeds (..., J) [rad/s] up to the second, (..., P).

    Args:
        angles, speeds: of the joints of one model.
        xp: `numpy` or `torch`, as they are.
    """
    joints = angles.shape[-1]
    pairs = np.array([(i, j) for i in range(joints) for j in range(i, joints)]).T
    triples = np.array([(i, j, k) for i in range(joints) for j in range(i, joints) for k in range(j, joints)]).T
    two = angles[..., pairs[0]] * angles[..., pairs[1]]
    three = angles[..., triples[0]] * angles[..., triples[1]] * angles[..., triples[2]]
    speeds = speeds / SPEED
    return xp.concatenate([xp.ones_like(angles[..., :1]), angles, two, three, speeds, speeds * abs(speeds)], -1)
