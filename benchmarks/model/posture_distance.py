"""How near the postures of some motions are to those of others, whatever the phase: Wasserstein distances."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wasserstein_distance

from benchmarks.model.posture_figures import on_body
from flexmotion.biomechanics.mirror import mirror
from flexmotion.features.encode import body_points
from flexmotion.features.heading_frame import turned
from flexmotion.human.body import Body
from flexmotion.human.kinematics import forward
from flexmotion.human.motion import Motion
from flexmotion.spatial.heading import continuous_matrix_heading

Float = NDArray[np.float64]


def postures(motions: Iterable[Motion], body: Body) -> Float:
    """Postures of all frames of motions and of their mirror images, (T, 48) [m].

    The 16 points of the body in the heading of each frame, horizontally from the pelvis, vertically from the floor. A
    hand that is waved may be the left or the right one: with its mirror image a motion has no side.

    Args:
        motions: at one frame rate.
        body: that all are mapped to, so that equal joint angles are equal postures.
    """
    found = []
    for motion in motions:
        own = on_body(motion, body)
        for image in (own, mirror(own)):
            human = forward(image)
            from_pelvis = body_points(human) - human.pelvis_position[:, None] * [1.0, 1.0, 0.0]
            yaw = continuous_matrix_heading(human.pelvis_rotation)
            found.append(turned(from_pelvis, -yaw).reshape(len(image), -1))
    return np.concatenate(found)


def posture_distance(first: Float, second: Float) -> float:
    """Mean over the coordinates of two sets of postures, (N, C) and (M, C), of their Wasserstein distance [m].

    The distance of two distributions of a number is the mean distance by which one has to be moved to be the other.
    """
    columns = zip(first.T, second.T, strict=True)
    return float(np.mean([wasserstein_distance(own, other) for own, other in columns]))
