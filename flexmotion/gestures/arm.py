"""One arm: from directions, or from the place of the hand, to joint angles, and back to the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.gestures.recipes import ArmPose, Landmark
from flexmotion.human.body import Body
from flexmotion.human.skeleton import LEFT
from flexmotion.human.vectors import unit

Float = NDArray[np.float64]

PRONATION = np.radians((-10.0, 170.0))
"""Range of the forearm's rotation [rad]: palm forward at 0, palm back at 180 degrees (hanging arm)."""

BENT = np.radians((4.0, 145.0))
"""Range of the elbow in a gesture [rad]."""

TRUNK_RADIUS = 0.10
"""Of the torso's shape in `human_model` [m]."""

HEIGHT = 1.75
"""Stature for which offsets of recipes are given [m]."""


@dataclass(frozen=True)
class ArmAngles:
    """Angles of one arm.

    Attributes:
        humerus: orientation of the upper arm in the torso.
        elbow: flexion [rad].
        pronation: [rad]; None for that of the base.
    """

    humerus: Rotation
    elbow: float
    pronation: float | None


def arm_angles(pose: ArmPose, body: Body, side: int, turned: Rotation | None = None) -> ArmAngles:
    """Angles of an arm in a pose.

    Args:
        pose: of the recipe.
        body: of the human.
        side: `LEFT` or `RIGHT`.
        turned: rotation of the pose's directions; None for none.
    """
    out = 1.0 if side == LEFT else -1.0
    turn = turned or Rotation.identity()

    def world(vector: tuple[float, float, float]) -> Float:
        return np.asarray(vector) * [1.0, out, 1.0]

    if pose.upper is not None and pose.forearm is not None:
        upper, forearm = turn.apply(unit(world(pose.upper))), turn.apply(unit(world(pose.forearm)))
    else:
        assert pose.hand is not None and pose.elbow is not None
        offset = turn.apply(world(pose.offset)) * body.height / HEIGHT
        hand = landmark(pose.hand, body, out) + offset
        upper, forearm = _reach(hand - shoulder(body, side), unit(world(pose.elbow)), body)
    elbow = float(np.clip(np.arccos(np.clip(upper @ forearm, -1.0, 1.0)), *BENT))
    # The elbow bends in the plane of x and z of the upper arm (see `human_model`).
    front = unit(forearm - (forearm @ upper) * upper)
    humerus = np.stack([front, np.cross(-upper, front), -upper], axis=1)
    pronation = None
    if pose.palm is not None:
        ulna = humerus @ Rotation.from_euler("y", -elbow).as_matrix()
        palm = unit(world(pose.palm)) @ ulna
        angle = float(np.arctan2(-out * palm[1], palm[0]))
        middle = float(np.mean(PRONATION))
        angle = middle + (angle - middle + np.pi) % (2.0 * np.pi) - np.pi
        pronation = float(np.clip(angle, *PRONATION))
    return ArmAngles(Rotation.from_matrix(humerus), elbow, pronation)


def _reach(line: Float, elbow: Float, body: Body) -> tuple[Float, Float]:
    """Directions of upper arm and forearm for a hand at `line` from the shoulder (3,) [m], by the law of cosines."""
    first, second = body.segments.upper_arm, body.segments.forearm + body.segments.hand
    least, most = (np.sqrt(first**2 + second**2 + 2 * first * second * np.cos(bend)) for bend in BENT[::-1])
    distance = float(np.clip(np.linalg.norm(line), least, most))
    along = unit(line)
    side = unit(elbow - (elbow @ along) * along)
    cosine = (first**2 + distance**2 - second**2) / (2 * first * distance)
    upper = cosine * along + np.sqrt(max(1.0 - cosine**2, 0.0)) * side
    return upper, unit(distance * along - first * upper)


def shoulder(body: Body, side: int) -> Float:
    """Joint centre in the torso, (3,) [m]."""
    size = body.segments
    out = 1.0 if side == LEFT else -1.0
    return np.array([size.shoulder_forward, out * size.shoulder_width / 2, size.shoulder_height])


def landmark(name: Landmark, body: Body, out: float) -> Float:
    """A place on the upright body in the axes of the torso, (3,) [m].

    Args:
        name: `brow`, `chin`, `breastbone`: on the midline; `waist`: on the crest of the hip bone; `front`: half an
            arm's length before the breastbone.
        body: of the human.
        out: 1 on the left, -1 on the right.
    """
    size = body.segments
    neck = np.array([size.neck_forward, 0.0, size.neck_height])
    chest = np.array([0.75 * size.neck_forward + TRUNK_RADIUS, 0.0, 0.75 * size.shoulder_height])
    places = {
        "brow": neck + [0.3 * size.head, 0.0, 0.75 * size.head],
        "chin": neck + [0.3 * size.head, 0.0, 0.25 * size.head],
        "breastbone": chest,
        "waist": np.array([-size.lumbar_forward, out * (size.hip_width / 2 + 0.08), -0.6 * size.lumbar_height]),
        "front": chest + [0.5 * size.arm, 0.0, 0.0],
    }
    return places[name]


def hand_in_torso(humerus: Rotation, elbow: Float, body: Body, side: int) -> Float:
    """Centre of the fist in the torso for N poses, (N,) [rad] -> (N, 3) [m]."""
    size = body.segments
    bent = Rotation.from_rotvec(np.atleast_1d(elbow)[:, None] * [0.0, -1.0, 0.0])
    forearm = bent.apply([0.0, 0.0, -(size.forearm + size.hand)])
    found: Float = shoulder(body, side) + humerus.apply(forearm + [0.0, 0.0, -size.upper_arm])
    return found
