"""`Walks`: how a body goes on that walks at the end of a window.

What comes after a window is not known. A walk that is balanced within it alone would end with a body that falls over
its feet, or is far behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.segment_motion import SegmentMotion
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.sampling.soles import Soles
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]

AHEAD = 0.025
"""How far the capture point of people is ahead of the middle of their feet, over the square of their speed [s²/m]: 4 cm
in the mean of 85 walks and curves at 1.2 m/s."""


@dataclass(frozen=True)
class Walks:
    """See the file.

    Attributes:
        velocity: that it keeps, (2,) [m/s].
        place: that its capture point, beside that velocity, is to have, (2,) [m].
    """

    velocity: Float
    place: Float

    @classmethod
    def of(cls, motion: Motion, segments: SegmentMotion, soles: Soles, first: int, *, stops: bool) -> Walks:
        """With the mean velocity of the window, turned as the torso has turned since its middle.

        The torso says it best: with each step a pelvis turns to and fro by 9°, which looks like a turn within a window.

        Args:
            motion, segments, soles: of the window, N frames, and of known ones before it.
            first: frame of the window.
            stops: whether the body is to stand after the window.
        """
        middle: Float = soles.points[-1].mean(axis=(0, 1))
        if stops:
            return cls(np.zeros(2), middle)
        way = (motion.root_position[-1] - motion.root_position[first])[:2]
        seconds = (len(motion) - 1 - first) / motion.fps
        mean = way / seconds
        torso = segments.rotation[first:, human_model(motion.body).body_index["torso"]]
        heading = continuous_matrix_heading(torso)
        # By the slope of the line through it (least squares).
        share = np.linspace(-0.5, 0.5, len(heading))
        turned = 0.5 * float(share @ heading / (share @ share))
        velocity = _turned(mean, turned)
        # Ahead the middle of the feet swings by .3 m within a gait cycle: its mean counts, where it is to be by now.
        ahead = velocity / max(float(np.hypot(*velocity)), 1e-9)
        mean_middle = soles.points[first:].mean(axis=(0, 1, 2)) + _turned(mean, 0.5 * turned) * (0.5 * seconds)
        middle = middle + ((mean_middle - middle) @ ahead) * ahead
        rate = 2.0 * turned / seconds
        inward = rate * np.array([-velocity[1], velocity[0]]) * segments.centre[-1, 2] / GRAVITY
        return cls(velocity, middle + AHEAD * np.hypot(*velocity) * velocity + inward)


def _turned(vector: Float, angle: float) -> Float:
    """A vector on the floor, (2,), turned to the left by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    found: Float = np.array([[cosine, -sine], [sine, cosine]]) @ vector
    return found
