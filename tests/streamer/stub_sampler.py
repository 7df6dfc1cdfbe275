"""`StubSampler`: a sampler without a model, whose human glides in one pose as words or a velocity say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flexmotion.features.constraints import Constraints
from flexmotion.features.layout import Layout
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.delivery import Delivered
from flexmotion.sampling.sampler import Condition
from flexmotion.spatial.heading import continuous_heading
from flexmotion.text.prompt_reader import Prompt

NOISE_M = 1e-3
POSE, HELD_NOISE = "raise your hand", 0.3
"""Words of the one pose, and the noise with which it is held."""

BRIEF = "hands up"
"""Words of a pose that people leave at once; the stub's arms do not move."""

GESTURES = {"bow": True, "wave": False}
"""Words for what is done on the spot, and whether a walking human walks on with them."""

SPEEDS = {"walk forward": (1.0, 0.0), "turn left": (0.0, 1.0)}
"""Forward [m/s] and turning [rad/s]."""


@dataclass(frozen=True)
class Asked:
    """One window that was requested."""

    begin: Motion
    condition: Condition
    seed: int


class StubSampler:
    """The part of `flexmotion.sampling.sampler.Sampler` that a source needs; the pelvis' height shows the noise."""

    def __init__(self, follows_velocity: bool = True) -> None:
        self.fps, self.history, self.future, self.remembers, self.unsettled = 30.0, 8, 32, 10, 6
        self.name, self.follows_velocity, self.body = "stub", follows_velocity, Body()
        self.requests, self.travelling_noise, self.kinds = self, 1.0, ("stand", "walk")
        self.manners = ("normal", "old")
        self.free = Constraints.none(Layout(self.fps), self.body, self.future)
        self.prepared = False
        self.asked: list[Asked] = []
        self.read: list[str] = []

    def prepare(self) -> None:
        self.prepared = True

    def standing(self, after: Motion | None = None) -> Motion:
        place, yaw = np.zeros(2), 0.0
        if after is not None:
            place, yaw = after.root_position[-1, :2], float(continuous_heading(after.root_quaternion)[-1])
        return self._motion(np.broadcast_to(place, (self.history, 2)), np.full(self.history, yaw), 0.0)

    def extend(self, history: Motion, condition: Condition, seed: int) -> Delivered:
        return Delivered(history[max(0, len(history) - 6) :], self.sample(history, condition, seed))

    def sample(self, history: Motion, condition: Condition, seed: int) -> Motion:
        assert len(history) >= min(self.remembers, self.history)
        self.asked.append(Asked(history[-self.remembers :], condition, seed))
        if condition.velocity is not None:
            speed, turning = condition.velocity[0], condition.velocity[2]
        else:
            speed, turning = SPEEDS.get(condition.text or "", (0.0, 0.0))
        if GESTURES.get(condition.text or "", False) and len(history) > 1:
            last = history.root_position[-2:, :2]
            speed = float(np.linalg.norm(last[1] - last[0])) * self.fps
        t = np.arange(1, self.future + 1) / self.fps
        yaw = continuous_heading(history.root_quaternion)[-1] + turning * t
        step = speed / self.fps * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        return self._motion(history.root_position[-1, :2] + np.cumsum(step, axis=0), yaw, self._noise(seed))

    def own_velocity(self, condition: Condition) -> tuple[float, float, float] | None:
        if condition.velocity is not None:
            return condition.velocity
        speed, turning = SPEEDS.get(condition.text or "", (0.0, 0.0))
        return speed, 0.0, turning

    def rests(self, condition: Condition, history: Motion) -> bool:
        return False

    def made_pose(self, condition: Condition, begin: Motion, seed: int) -> None:
        return None

    def rhythm(self, condition: Condition, size: int = 0) -> None:
        return None

    def travels(self, condition: Condition) -> bool:
        return condition.text not in GESTURES

    def pose(self, condition: Condition) -> str | None:
        return condition.text if condition.text in (POSE, BRIEF) else None

    def held(self, condition: Condition) -> Condition:
        return replace(condition, noise=HELD_NOISE) if condition.text == POSE else condition

    def is_brief(self, condition: Condition) -> bool:
        return condition.text == BRIEF

    def meant(self, condition: Condition) -> Condition:
        if condition.velocity is None or condition.pace is None:
            return condition
        return replace(condition, velocity=condition.pace.slowed(condition.velocity))

    def prompt(self, text: str) -> Prompt:
        if text not in self.read:
            self.read.append(text)
        return Prompt(np.zeros(1, np.float32), text, 1.0, True)

    def is_word(self, word: str) -> bool:
        return True

    def _noise(self, seed: int) -> float:
        return NOISE_M * float(np.random.default_rng(seed).uniform())

    def _motion(self, place: np.ndarray, yaw: np.ndarray, noise: float) -> Motion:
        frames, weight = len(yaw), self.body.mass * 9.81
        wrenches = np.zeros((frames, 2, 6))
        wrenches[:, :, 2] = weight / 2
        standing = Motion(
            fps=self.fps,
            root_position=np.column_stack([place, np.full(frames, self.body.standing_height + noise)]),
            root_quaternion=np.column_stack([np.cos(yaw / 2), np.zeros(frames), np.zeros(frames), np.sin(yaw / 2)]),
            joints=np.zeros((frames, len(JOINTS))),
            body=self.body,
        )
        return replace(standing, wrenches=wrenches, source="model:stub")
