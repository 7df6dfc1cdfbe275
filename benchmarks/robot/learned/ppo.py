"""`Learner`: proximal policy optimisation (Schulman et al. 2017, arXiv:1707.06347) with a critic that knows more.

The actor sees what the loop has; the critic sees the true state besides (Pinto et al. 2017, arXiv:1710.06542). The step
of the optimiser follows the divergence between the policy before and after.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from benchmarks.robot.learned.gait import Gait
from benchmarks.robot.learned.policy import SEEN_AT_MOST, Policy
from benchmarks.robot.learned.walk import ACTIONS, PRIVATE, SEEN

Float = NDArray[np.float64]

WIDTH = 128
DISCOUNT, TRACE = 0.985, 0.95
"""Of a step of 16 ms; `TRACE` is the lambda of generalised advantage estimation."""
SCALE = 0.05
"""Of rewards, so that values are of the size of 1: a critic that is far off fills the bound on the gradient, of which
the actor then gets nothing."""
EPOCHS, PARTS, CLIP = 5, 4, 0.2
RATE, LEAST_RATE, MOST_RATE = 3e-4, 5e-5, 1e-3
DIVERGENCE = 0.012
"""Of the policies before and after an update, that the rate of learning aims at."""
FIRST_DEVIATION = 0.12
"""Of the noise on actions, of which 1 is a quarter of a radian."""


@dataclass(frozen=True)
class Batch:
    """Steps of several walks, (steps, walks, ...)."""

    seen: Float
    private: Float
    actions: Float
    rewards: Float
    ended: NDArray[np.bool_]  # the robot fell in this step
    broken: NDArray[np.bool_]  # a new episode begins after this step
    after: Float  # critic's value after a step that is the last of its episode or of the batch


class Learner:
    """Actor, critic and optimiser. `seed`: of weights and of the noise on actions."""

    def __init__(self, seed: int) -> None:
        torch.manual_seed(seed)
        self.actor, self.critic = _network(SEEN, ACTIONS, 0.01), _network(SEEN + PRIVATE, 1, 1.0)
        self.log_deviation = nn.Parameter(torch.full((ACTIONS,), float(np.log(FIRST_DEVIATION))))
        parameters = [*self.actor.parameters(), *self.critic.parameters(), self.log_deviation]
        self._optimiser = torch.optim.Adam(parameters, lr=RATE)
        self._parameters = parameters
        self.mean, self.square, self.count = np.zeros(SEEN + PRIVATE), np.ones(SEEN + PRIVATE), 1.0
        self.generator = torch.Generator().manual_seed(seed)

    @property
    def deviation(self) -> Float:
        """Of the noise on actions, (ACTIONS,)."""
        return np.asarray(self.log_deviation.detach().exp().numpy(), np.float64)

    def policy(self, gait: Gait, fastest: float) -> Policy:
        """The actor as it is."""
        layers = [own for own in self.actor if isinstance(own, nn.Linear)]
        mean, spread = self._normal()
        return Policy(
            gait,
            mean[:SEEN],
            spread[:SEEN],
            tuple(own.weight.detach().numpy().astype(np.float64) for own in layers),
            tuple(own.bias.detach().numpy().astype(np.float64) for own in layers),
            fastest,
        )

    def values(self, seen: Float, private: Float) -> Float:
        """What the critic expects, (...,)."""
        with torch.no_grad():
            return np.asarray(self.critic(self._inputs(seen, private)).squeeze(-1).numpy(), np.float64)

    def update(self, batch: Batch) -> dict[str, float]:
        """Learn from a batch; returns figures of the update."""
        steps, walks = batch.rewards.shape
        values = self.values(batch.seen, batch.private)
        advantages, running = np.zeros((steps, walks)), np.zeros(walks)
        for step in reversed(range(steps)):
            last = batch.broken[step] | (step == steps - 1)
            following = np.where(last, batch.after[step], values[min(step + 1, steps - 1)])
            following = np.where(batch.ended[step], 0.0, following)
            delta = SCALE * batch.rewards[step] + DISCOUNT * following - values[step]
            running = delta + DISCOUNT * TRACE * np.where(last, 0.0, running)
            advantages[step] = running
        targets = _tensor((advantages + values).ravel())
        inputs = self._inputs(batch.seen, batch.private).reshape(steps * walks, -1)
        actions = _tensor(batch.actions.reshape(steps * walks, -1))
        gains = _tensor(((advantages - advantages.mean()) / (advantages.std() + 1e-6)).ravel())
        with torch.no_grad():
            before = self.actor(inputs[:, :SEEN])
            before_deviation = self.log_deviation.exp().clone()
            old = _log_likelihood(actions, before, before_deviation)
        divergences, errors = [], []
        for _ in range(EPOCHS):
            order = torch.randperm(len(inputs), generator=self.generator)
            for part in order.chunk(PARTS):
                mean, deviation = self.actor(inputs[part, :SEEN]), self.log_deviation.exp()
                with torch.no_grad():
                    divergence = float(_divergence(before[part], before_deviation, mean, deviation))
                self._adapt(divergence)
                divergences.append(divergence)
                ratio = (_log_likelihood(actions[part], mean, deviation) - old[part]).exp()
                clipped = ratio.clamp(1.0 - CLIP, 1.0 + CLIP)
                gain = torch.minimum(ratio * gains[part], clipped * gains[part]).mean()
                error = (self.critic(inputs[part]).squeeze(-1) - targets[part]).square().mean()
                self._optimiser.zero_grad()
                (error - gain).backward()
                nn.utils.clip_grad_norm_(self._parameters, 1.0)
                self._optimiser.step()
                errors.append(float(error.detach()))
        spread = float(np.var(targets.numpy())) + 1e-9
        self._look(np.concatenate([batch.seen, batch.private], axis=-1).reshape(steps * walks, -1))
        return {"divergence": float(np.mean(divergences)), "explained": 1.0 - float(np.mean(errors)) / spread}

    def state(self) -> dict[str, Any]:
        """All that an exact continuation needs."""
        return {
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "log_deviation": self.log_deviation.detach().clone(),
            "optimiser": self._optimiser.state_dict(),
            "normal": (self.mean, self.square, self.count),
            "generator": self.generator.get_state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        with torch.no_grad():
            self.log_deviation.copy_(state["log_deviation"])
        self._optimiser.load_state_dict(state["optimiser"])
        self.mean, self.square, self.count = state["normal"]
        self.generator.set_state(state["generator"])

    def _adapt(self, divergence: float) -> None:
        for group in self._optimiser.param_groups:
            if divergence > 2.0 * DIVERGENCE:
                group["lr"] = max(group["lr"] / 1.5, LEAST_RATE)
            elif 0.0 < divergence < 0.5 * DIVERGENCE:
                group["lr"] = min(group["lr"] * 1.5, MOST_RATE)

    def _normal(self) -> tuple[Float, Float]:
        """Mean and standard deviation of observations so far."""
        return self.mean, np.sqrt(np.maximum(self.square - self.mean**2, 1e-4))

    def _look(self, rows: Float) -> None:
        """Take observations into the mean and the mean square; after two million, they hardly change."""
        share = len(rows) / (self.count + len(rows))
        self.mean = self.mean + share * (rows.mean(axis=0) - self.mean)
        self.square = self.square + share * (np.square(rows).mean(axis=0) - self.square)
        self.count += len(rows)

    def _inputs(self, seen: Float, private: Float) -> torch.Tensor:
        mean, spread = self._normal()
        rows = (np.concatenate([seen, private], axis=-1) - mean) / spread
        return _tensor(np.clip(rows, -SEEN_AT_MOST, SEEN_AT_MOST))


def _network(inputs: int, outputs: int, scale: float) -> nn.Sequential:
    network = nn.Sequential(
        nn.Linear(inputs, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh(), nn.Linear(WIDTH, outputs)
    )
    last = network[-1]
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        last.weight.mul_(scale)
        last.bias.zero_()
    return network


def _tensor(array: Float) -> torch.Tensor:
    return torch.as_tensor(np.asarray(array, np.float32))


def _log_likelihood(actions: torch.Tensor, mean: torch.Tensor, deviation: torch.Tensor) -> torch.Tensor:
    return -(0.5 * ((actions - mean) / deviation).square() + deviation.log()).sum(dim=-1)


def _divergence(
    mean: torch.Tensor, deviation: torch.Tensor, other_mean: torch.Tensor, other_deviation: torch.Tensor
) -> torch.Tensor:
    """Kullback-Leibler divergence of the first from the second, mean over rows."""
    ratio = deviation.square() / other_deviation.square()
    apart = ((mean - other_mean) / other_deviation).square()
    return 0.5 * (ratio + apart - 1.0 - ratio.log()).sum(dim=-1).mean()
