"""`Training`: walks by several robots in turn, a policy that learns from them, and a state from which it goes on.

The state is written every `KEPT_EVERY` updates, and every robot then begins a new episode: a training that is started
again from its state does the same as one that was never stopped.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.robot.learned.gait import Gait, GaitTable
from benchmarks.robot.learned.ppo import Batch, Learner
from benchmarks.robot.learned.randomised import drawn_options
from benchmarks.robot.learned.walk import ACTIONS, PRIVATE, SEEN, Walk
from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot import Robot

Float = NDArray[np.float64]

WALKS, STEPS = 16, 112
"""Robots, and steps of each between two updates."""
SHORTEST_S, LONGEST_S = 4.0, 10.0
"""Length of an episode, drawn [s]."""
SLOWEST, FASTEST, FIRST_FASTEST = 0.1, 0.7, 0.4
"""Of the speeds asked for: least, most ever, and most at first [m/s]."""
FASTER, SLOWER = 0.005, 0.002
UPRIGHT, KEPT = 0.9, 0.9
"""The greatest speed rises where this share of the fast episodes ends upright, and they keep this share of it."""
FAST = 0.8
"""An episode is fast from this share of the greatest speed."""
JUDGED = 32
"""Fast episodes over which is judged."""
KEPT_EVERY = 25
STATE, POLICY = "training.state", "policy.npz"


class Training:
    """One training in a folder.

    Args:
        robot: that is to walk.
        gait: that is corrected.
        seed: of everything.
        folder: of its state and its policy; a state that lies there is continued.
        walks, steps: robots, and steps of each between updates.
    """

    def __init__(
        self, robot: Robot, gait: Gait, seed: int, folder: Path, walks: int = WALKS, steps: int = STEPS
    ) -> None:
        self._gait, self._folder, self._steps = gait, folder, steps
        table = GaitTable(robot, gait)
        self._walks = [Walk(robot, table) for _ in range(walks)]
        self._ends, self._episode_speed = np.zeros(walks), np.zeros(walks)
        self._begins = np.zeros(walks)
        self.learner, self.rng = Learner(seed), np.random.default_rng(seed)
        self.updates, self.samples, self.seconds = 0, 0, 0.0
        self.fastest, self._judged = FIRST_FASTEST, list[tuple[bool, float]]()
        self._figures: dict[str, float] = {}
        if (folder / STATE).is_file():
            self._restore()

    def run(self, seconds: float, updates: int | None = None) -> None:
        """Train for about this long, or until so many updates were made in all; ends with a written state."""
        console = Console(stderr=True, width=160)
        begin, before = time.monotonic(), self.seconds
        self._begin_all()
        while True:
            figures = self._update()
            self.seconds = before + time.monotonic() - begin
            if self.updates % KEPT_EVERY == 0 or self.updates == updates:
                self._write()
                done = updates is not None and self.updates >= updates
                if done or (updates is None and time.monotonic() - begin > seconds):
                    return
                self._begin_all()
            if self.updates % 5 == 0:
                console.print(
                    f"update {self.updates}, {self.samples / 1e6:.2f} M steps, {self.seconds / 60:.1f} min "
                    f"({self.samples / self.seconds:.0f} steps/s): reward {figures['reward']:.3f}, "
                    f"upright {figures['upright']:.2f}, asked up to {self.fastest:.3f} m/s, "
                    f"keeps {figures['kept']:.2f} of it, noise {figures['noise']:.2f}, "
                    f"divergence {figures['divergence']:.3f}, explained {figures['explained']:.2f}",
                    soft_wrap=True,
                )

    def _begin_all(self) -> None:
        for number in range(len(self._walks)):
            self._begin(number)

    def _begin(self, number: int) -> None:
        """Begin an episode; some walk slowly, most near the greatest speed."""
        rng, walk = self.rng, self._walks[number]
        least = SLOWEST if rng.random() < 0.25 else FAST * self.fastest
        speed = float(rng.uniform(least, self.fastest))
        walk.begin(drawn_options(rng), speed, right_first=bool(rng.random() < 0.5))
        self._ends[number] = rng.uniform(SHORTEST_S, LONGEST_S)
        self._begins[number] = walk.ground.position[0]

    def _update(self) -> dict[str, float]:
        """Walk, and learn from it."""
        count, steps = len(self._walks), self._steps
        policy, deviation = self.learner.policy(self._gait, self.fastest), self.learner.deviation
        seen, private = np.empty((steps, count, SEEN)), np.empty((steps, count, PRIVATE))
        actions, rewards = np.empty((steps, count, ACTIONS)), np.empty((steps, count))
        ended, broken = np.zeros((steps, count), np.bool_), np.zeros((steps, count), np.bool_)
        last_seen, last_private = np.zeros_like(seen), np.zeros_like(private)
        for step in range(steps):
            seen[step] = [walk.seen for walk in self._walks]
            private[step] = [walk.private for walk in self._walks]
            noise = deviation * self.rng.standard_normal((count, ACTIONS))
            actions[step] = policy.act(seen[step]) + noise
            for number, walk in enumerate(self._walks):
                rewards[step, number] = walk.step(actions[step, number])
                ended[step, number] = walk.fell
                over = walk.fell or walk.time >= self._ends[number]
                if over or step == steps - 1:
                    last_seen[step, number], last_private[step, number] = walk.seen, walk.private
                if over:
                    broken[step, number] = True
                    self._judge(number)
                    self._begin(number)
        after = self.learner.values(last_seen, last_private)
        figures = self.learner.update(Batch(seen, private, actions, rewards, ended, broken, after))
        self.updates += 1
        self.samples += steps * count
        self._raise()
        recent = self._judged[-JUDGED:]
        figures |= {
            "reward": float(rewards.mean()),
            "upright": float(np.mean([own[0] for own in recent])) if recent else float("nan"),
            "kept": float(np.mean([own[1] for own in recent])) if recent else float("nan"),
            "noise": float(deviation.mean()),
        }
        return figures

    def _judge(self, number: int) -> None:
        walk = self._walks[number]
        if walk.speed >= FAST * self.fastest:
            self._judged.append((not walk.fell, float(walk.velocity[0]) / walk.speed))

    def _raise(self) -> None:
        recent = self._judged[-JUDGED:]
        self._judged = recent
        if len(recent) < JUDGED:
            return
        upright, kept = np.mean(recent, axis=0)
        if upright >= UPRIGHT and kept >= KEPT:
            self.fastest = min(self.fastest + FASTER, FASTEST)
        elif upright < 0.6:
            self.fastest = max(self.fastest - SLOWER, FIRST_FASTEST)

    def _write(self) -> None:
        state = {
            "learner": self.learner.state(),
            "rng": self.rng.bit_generator.state,
            "counts": (self.updates, self.samples, self.seconds, self.fastest),
            "judged": self._judged,
            "gait": self._gait,
        }
        self._folder.mkdir(parents=True, exist_ok=True)
        fresh = self._folder / f"{STATE}.new"
        torch.save(state, fresh)
        fresh.replace(self._folder / STATE)
        self.learner.policy(self._gait, self.fastest).write(self._folder / POLICY)
        self.learner.policy(self._gait, self.fastest).write(self._folder / f"policy_{self.updates:05d}.npz")

    def _restore(self) -> None:
        file = self._folder / STATE
        try:
            state: dict[str, Any] = torch.load(file, weights_only=False)
            self.learner.restore(state["learner"])
        except (OSError, KeyError, RuntimeError) as error:
            raise ConfigError(f"{file}: not the state of this training: {error}") from error
        self.rng.bit_generator.state = state["rng"]
        self.updates, self.samples, self.seconds, self.fastest = state["counts"]
        self._judged = state["judged"]
        if state["gait"] != self._gait:
            raise ConfigError(f"{file}: a training of another gait")
