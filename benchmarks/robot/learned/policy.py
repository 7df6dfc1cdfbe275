"""`Policy`: a learned policy in NumPy, with the gait that it corrects; one file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from benchmarks.robot.learned.gait import NAMES, Gait
from benchmarks.robot.learned.walk import ACTIONS, SEEN
from flexmotion.configs.errors import ConfigError

Float = NDArray[np.float64]

SEEN_AT_MOST = 5.0
"""Bound of a normalised observation, in standard deviations."""


@dataclass(frozen=True)
class Policy:
    """A network of tanh layers and a linear one.

    Attributes:
        gait: that it corrects.
        mean, deviation: of the observations that it was trained with, (SEEN,) each.
        weights, biases: of its layers, (out, in) and (out,).
        fastest: speed that it was asked for at most while it was trained [m/s].
    """

    gait: Gait
    mean: Float
    deviation: Float
    weights: tuple[Float, ...]
    biases: tuple[Float, ...]
    fastest: float

    @classmethod
    def still(cls, gait: Gait) -> Self:
        """One that corrects nothing: the gait alone."""
        return cls(gait, np.zeros(SEEN), np.ones(SEEN), (np.zeros((ACTIONS, SEEN)),), (np.zeros(ACTIONS),), 0.0)

    def act(self, seen: Float) -> Float:
        """The actions for observations, (..., SEEN) to (..., ACTIONS)."""
        value = np.clip((seen - self.mean) / self.deviation, -SEEN_AT_MOST, SEEN_AT_MOST)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            value = np.tanh(value @ weight.T + bias)
        return np.asarray(value @ self.weights[-1].T + self.biases[-1])

    def write(self, file: Path) -> None:
        """Write it as `.npz`, in single precision."""
        arrays = {f"weight_{layer}": own.astype(np.float32) for layer, own in enumerate(self.weights)}
        arrays |= {f"bias_{layer}": own.astype(np.float32) for layer, own in enumerate(self.biases)}
        gait = np.array([asdict(self.gait)[name] for name in NAMES])
        np.savez_compressed(
            file,
            gait_names=np.array(NAMES),
            gait=gait,
            mean=self.mean,
            deviation=self.deviation,
            fastest=np.array(self.fastest),
            **arrays,  # type: ignore[arg-type]
        )

    @classmethod
    def load(cls, file: Path) -> Self:
        """Read one that `write` wrote.

        Raises:
            ConfigError: the file cannot be read, or is of another task.
        """
        try:
            with np.load(file) as own:
                layers = sum(name.startswith("weight_") for name in own.files)
                names, numbers = own["gait_names"].tolist(), own["gait"].tolist()
                policy = cls(
                    Gait(**dict(zip(names, numbers, strict=True))),
                    own["mean"],
                    own["deviation"],
                    tuple(own[f"weight_{layer}"].astype(np.float64) for layer in range(layers)),
                    tuple(own[f"bias_{layer}"].astype(np.float64) for layer in range(layers)),
                    float(own["fastest"]),
                )
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise ConfigError(f"{file}: not a policy of this walk: {error}") from error
        shape = (policy.weights[0].shape[1], policy.weights[-1].shape[0])
        if shape != (SEEN, ACTIONS):
            raise ConfigError(
                f"{file}: a policy of {shape[0]} observations, {shape[1]} actions; expected {SEEN}, {ACTIONS}"
            )
        return policy
