"""`NoisySource`: a source whose windows disagree with each other, as redraws of a live model do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.streamer.motion.sources import Source

Float = NDArray[np.float64]

_LOOKAHEAD_S = 1.0
"""How far ahead the error reaches its full size [s]; further ahead it is constant."""
_WARP_S = 0.04
"""Greatest error of timing at full size [s]."""
_HEADING = 1.0
"""Greatest error of heading at full size, per size of the error [rad/m]: 3° for 5 cm."""
_LIMBS = {
    "heel": ("hip_flexion", "hip_adduction", "knee_flexion"),
    "hand": ("shoulder_flexion", "shoulder_adduction", "elbow_flexion"),
}
"""Joints that move each end of a limb; joints that only rotate it are left out."""
_PROBE_RAD, _SHORTEST_LEVER_M = 0.02, 0.15
"""Joint angle by which a limb's lever is measured [rad], and the shortest lever that is used [m/rad]."""


class NoisySource:
    """Another source, each of its windows with an error of its own.

    The error is 0 at a window's first frame and grows linearly to its full size 1 s ahead: the root's path drifts in a
    random horizontal direction and turns by a few degrees, the joint angles move each hand and foot by the same
    distance against the root, and time runs up to 40 ms fast or slow. The error depends only on the seed and the first
    frame, so that the same window is the same again.

    Args:
        source: the source that is disturbed; its name and frame rate are kept.
        size_m: error at 1 s lookahead, of the root and of each hand and foot against it [m].
        seed: of all windows.
    """

    def __init__(self, source: Source, size_m: float, seed: int) -> None:
        self.source, self.size_m, self.seed = source, size_m, seed
        self.name, self.fps = source.name, source.fps

    def window(self, first_frame: int, frames: int) -> Motion | None:
        """See `Source.window`; the motion has no forces."""
        fast = int(np.ceil(_WARP_S * self.fps))
        motion = self.source.window(first_frame, frames + fast)
        if motion is None or self.size_m <= 0.0:
            return None if motion is None else motion[:frames]
        rng = np.random.default_rng([self.seed, first_frame])
        count = min(frames, len(motion))
        growth = np.minimum(np.arange(count) / (self.fps * _LOOKAHEAD_S), 1.0)
        warped = _at(motion, np.arange(count) + rng.uniform(-1.0, 1.0) * _WARP_S * self.fps * growth)
        return self._disturbed(warped, growth, rng)

    def _disturbed(self, motion: Motion, growth: Float, rng: np.random.Generator) -> Motion:
        """The motion with errors of root and limbs, `growth` (T,) of their full size."""
        direction, turn = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-1.0, 1.0) * _HEADING * self.size_m
        drift = self.size_m * np.array([np.cos(direction), np.sin(direction), 0.0])
        yaw = Rotation.from_rotvec(np.outer(growth * turn, [0.0, 0.0, 1.0]))
        root = Rotation.from_quat(motion.root_quaternion, scalar_first=True)
        quaternion = (yaw * root).as_quat(scalar_first=True)
        near = np.sum(quaternion * motion.root_quaternion, axis=1, keepdims=True) >= 0
        return replace(
            motion,
            root_position=motion.root_position + np.outer(growth, drift),
            root_quaternion=np.where(near, quaternion, -quaternion),
            joints=motion.joints + np.outer(growth, self._joint_error(motion, rng)),
        )

    def _joint_error(self, motion: Motion, rng: np.random.Generator) -> Float:
        """Joint angles that move every hand and foot by the full size at the last frame, (26,) [rad]."""
        patterns = np.zeros((len(_LIMBS) * len(SIDES), len(JOINTS)))
        ends = [(name, side) for name in _LIMBS for side in range(len(SIDES))]
        for pattern, (name, side) in zip(patterns, ends, strict=True):
            columns = [JOINTS.index(f"{joint}_{SIDES[side]}") for joint in _LIMBS[name]]
            direction = rng.normal(size=len(columns))
            pattern[columns] = direction / np.linalg.norm(direction)
        last = _at(motion, np.full(1 + len(patterns), len(motion) - 1.0))
        probes = last.joints + _PROBE_RAD * np.concatenate([np.zeros((1, len(JOINTS))), patterns])
        posed = forward(replace(last, joints=probes))
        moved = [
            np.linalg.norm(getattr(posed, name)[k + 1, side] - getattr(posed, name)[0, side])
            for k, (name, side) in enumerate(ends)
        ]
        levers = np.maximum(np.array(moved) / _PROBE_RAD, _SHORTEST_LEVER_M)
        error: Float = (self.size_m / levers) @ patterns
        return error


def _at(motion: Motion, places: Float) -> Motion:
    """A motion at fractional frames (K,), held at its ends; positions and angles only."""
    places = np.clip(places, 0.0, len(motion) - 1.0)
    low = np.minimum(places.astype(int), max(len(motion) - 2, 0))
    high = np.minimum(low + 1, len(motion) - 1)
    share = (places - low)[:, None]

    def between(values: Float) -> Float:
        return values[low] + share * (values[high] - values[low])

    quaternion = between(motion.root_quaternion)
    return replace(
        motion,
        root_position=between(motion.root_position),
        root_quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        joints=between(motion.joints),
        torques=None,
        wrenches=None,
        pressure_centres=None,
        activations=None,
        joint_contact=None,
        contacts=None,
    )
