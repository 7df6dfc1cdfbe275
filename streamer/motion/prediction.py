"""What a person does next: sampled from the model, or the speed held while it dies away."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.features.decode import Anchor, decode
from flexmotion.human.concatenate import concatenate
from flexmotion.human.floor import ground_under
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.sampling.condition import GREATEST_VELOCITY
from flexmotion.sampling.planted import planted
from flexmotion.sampling.sampler import Condition, Sampler
from flexmotion.spatial.heading import heading
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

DIES_S = 0.3
"""Time constant with which a held speed dies away [s] (docs/decisions.md)."""
SPEED_S = 0.1
"""Time over which the speed is measured that is held [s]."""
PACE_S, STRIDE_S = 1.0 / 3.0, 1.0
"""Times over which the velocity is measured that the model is asked for: ahead, and of sideways and turning [s]. The
pelvis of a walker sways and turns to and fro with every stride, by up to .5 m/s and 2 rad/s (docs/decisions.md)."""
GROUND_S = 0.6
"""History in which the ground is sought that a person stands on, or jumped from: longer than a person flies [s]."""
STEP_M = 0.08
"""Ground that is less than this from z = 0 is the floor [m]: live poses put it up to .05 m off, steps are higher."""
WALKS = 0.3
"""From this speed on a person walks, and the model gets the words of walking [m/s]."""
GUIDANCE = 1.0
"""Of the model: the request as it is, not amplified (docs/decisions.md)."""


class Predictor(Protocol):
    """Gives the motion after a history.

    Attributes:
        name: for messages.
        remembers: frames of history that are used.
    """

    name: str
    remembers: int

    def __call__(self, history: Motion, frames: int) -> Motion:
        """The `frames` frames after a history of one frame or more, of the same body and frame rate."""
        ...


class HeldSpeed:
    """The speed of root and joints, dying away."""

    name = "held speed"

    def __init__(self, fps: float, dies_s: float = DIES_S) -> None:
        self._fps, self._dies_s = fps, dies_s
        self._over = max(round(SPEED_S * fps), 1)
        self.remembers = self._over + 1

    def __call__(self, history: Motion, frames: int) -> Motion:
        """See `Predictor`."""
        last = history[len(history) - 1 :]
        before = history[max(len(history) - 1 - self._over, 0) :][:1]
        since = min(self._over, len(history) - 1) / self._fps
        # Integral of exp(-t / dies): the way that is still gone, in seconds at full speed.
        way = self._dies_s * (1.0 - np.exp(-np.arange(1, frames + 1) / self._fps / self._dies_s))[:, None]
        rate = 0.0 if since == 0.0 else 1.0 / since
        turn = _rotation(last) * _rotation(before).inv()
        turned = Rotation.from_rotvec(way * rate * turn.as_rotvec()) * _rotation(last)
        return replace(
            last,
            root_position=last.root_position + way * rate * (last.root_position - before.root_position),
            root_quaternion=continuous_quaternions(turned.as_quat(scalar_first=True)),
            joints=last.joints + way * rate * (last.joints - before.joints),
        )


class ModelPrediction:
    """Sampled from a model without noise, at the velocity of the history; after a window the speed dies away.

    A person of another size is given to the model as its own human, at the scale of the legs. The model has learnt from
    humans on a floor at z = 0, and would put one who stands on a ladder down to it: the person is given to it on the
    ground that they stand on, and what it gives is raised again.
    """

    def __init__(self, sampler: Sampler) -> None:
        self.name, self._sampler = f"model {sampler.name}", sampler
        self._after = HeldSpeed(sampler.fps)
        self.remembers = max(sampler.remembers, round(max(STRIDE_S, GROUND_S) * sampler.fps) + 1)

    def __call__(self, history: Motion, frames: int) -> Motion:
        """See `Predictor`."""
        sampler = self._sampler
        scale = sampler.body.leg / history.body.leg
        height = ground_under(forward(history), history.fps)
        ground = np.array([0.0, 0.0, height if abs(height) >= STEP_M else 0.0])
        known = replace(history, body=sampler.body, root_position=scale * (history.root_position - ground))
        velocity = _velocity(known)
        # Words of walking, or of standing, would lower an arm that the person raises.
        wordless = float(np.hypot(*velocity[:2])) < WALKS
        request = Condition(velocity=velocity, wordless=wordless, guidance=GUIDANCE, noise=0.0)
        features = sampler.features(known, request, seed=0)
        window = planted(decode(features, sampler.layout, sampler.body, Anchor.after(known)), known)
        found = replace(
            history[:0],
            root_position=window.root_position / scale + ground,
            root_quaternion=window.root_quaternion,
            joints=window.joints,
        )
        if frames > len(found):
            found = concatenate([found, self._after(found, frames - len(found))])
        return found[:frames]


@dataclass(frozen=True)
class Foreseen:
    """A history and its prediction, on one clock.

    Attributes:
        motion: both.
        first_s: time of its first frame [s].
    """

    motion: Motion
    first_s: float

    def at(self, time_s: float, frames: int) -> Motion:
        """`frames` frames from a time on, between frames by interpolation; outside them the first or the last."""
        motion = self.motion
        place = np.clip((time_s - self.first_s) * motion.fps + np.arange(frames), 0.0, len(motion) - 1.0)
        before = np.minimum(place.astype(int), max(len(motion) - 2, 0))
        after = np.minimum(before + 1, len(motion) - 1)
        share = (place - before)[:, None]
        quaternion = (1.0 - share) * motion.root_quaternion[before] + share * motion.root_quaternion[after]
        return replace(
            motion,
            root_position=(1.0 - share) * motion.root_position[before] + share * motion.root_position[after],
            root_quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
            joints=(1.0 - share) * motion.joints[before] + share * motion.joints[after],
        )


def _rotation(pose: Motion) -> Rotation:
    return Rotation.from_quat(pose.root_quaternion[0], scalar_first=True)


def _velocity(history: Motion) -> tuple[float, float, float]:
    """Forward in the last heading, left in the mean one [m/s], and turning left [rad/s], of the last frames.

    Within what a model can be asked for: a person whose frames jump has any velocity.
    """
    pace, stride = (history[max(len(history) - 1 - round(over * history.fps), 0) :] for over in (PACE_S, STRIDE_S))
    if len(pace) < 2:
        return 0.0, 0.0, 0.0
    yaw = np.unwrap(heading(stride.root_quaternion))
    forward, _ = _in_heading(pace, yaw[-1])
    _, left = _in_heading(stride, yaw.mean())
    found = forward, left, float((yaw[-1] - yaw[0]) / stride.duration)
    forward, left, turning = np.clip(found, np.negative(GREATEST_VELOCITY), GREATEST_VELOCITY).tolist()
    return forward, left, turning


def _in_heading(motion: Motion, yaw: float) -> tuple[float, float]:
    """Mean velocity of the root, ahead and to the left of a heading [m/s]."""
    x, y = (motion.root_position[-1] - motion.root_position[0])[:2] / motion.duration
    return float(np.cos(yaw) * x + np.sin(yaw) * y), float(np.cos(yaw) * y - np.sin(yaw) * x)
