"""Fit of a body and its joint angles to joint centres, and segment orientations, of a clip.

Ankles are reached exactly within the length of the leg, wrists within the length of the arm from shoulders that are
fixed in the torso. The hinge axis of a straight limb is taken from frames in which it is bent (`limb`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.human.angles import Ball, angles_of_joints, rotation_about
from flexmotion.human.body import Body, Segments
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.signals import fill
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, LEG_JOINTS, SIDES, TRUNK_JOINTS
from flexmotion.human.vectors import cross, in_frame, unit
from flexmotion.importers.body_fit import fit_body
from flexmotion.importers.foot import FlatFoot, dorsiflexion, flat_foot, toe_out
from flexmotion.importers.landmarks import Landmarks
from flexmotion.importers.limb import Limb, hinge_axis, solve_limb
from flexmotion.importers.trunk import head_rotation, neck_tilt, pelvis_rotation, torso_rotation, upright_head
from flexmotion.spatial.quaternions import continuous_quaternions
from flexmotion.spatial.transitions import smoothstep

Float = NDArray[np.float64]

TOE_OUT_LIMIT = np.radians(35)

ELBOW_AT_REST = np.radians(20)
"""Angles of an arm hanging beside the torso, for files without arms below the shoulders [rad]."""

PRONATION_AT_REST = np.pi / 2
"""Pronation of a hanging arm whose palm faces the thigh, for files without hand orientations [rad]."""


@dataclass(frozen=True)
class FitError:
    """Distance between a point of the file and that of the fitted human over a clip [m]."""

    rms: float
    max: float


@dataclass(frozen=True)
class Measures:
    """What a fit takes from all frames of a clip; frames that come one by one are fitted with those of their first.

    Attributes:
        body: with its fitted segments.
        elevation: of the line from ankle to toe joint while the left and the right sole are flat [rad].
        tilt: forward lean of the line from lumbar joint to neck in the torso (see `trunk.neck_tilt`) [rad].
        nod: forward lean and leftward sway of the head's point while the head is upright [rad]; zero for files with its
            orientation, or without it.
    """

    body: Body
    elevation: tuple[float, float]
    tilt: float
    nod: tuple[float, float]


@dataclass(frozen=True)
class Fit:
    """A fitted motion and its errors, for `ankle`, `wrist` and, where the file has it, `head`.

    Attributes:
        measures: that the motion was fitted with.
    """

    motion: Motion
    errors: dict[str, FitError]
    measures: Measures


def fit(found: Landmarks, height: float | None = None) -> Fit:
    """Fit a human to a clip; position, heading and floor stay as in the file.

    `height` is the stature [m] if it is known; it determines the sizes that joint centres do not define.

    Elbow and wrist of a side may be missing: that arm then hangs beside the torso.
    """
    measures = measure(found, height)
    motion = posed(found, measures)
    return Fit(motion, fit_errors(found, forward(motion)), measures)


def measure(found: Landmarks, height: float | None = None) -> Measures:
    """Body and upright posture of the human in a clip; `height`: see `fit`."""
    points = found.points
    root = (points["hip_l"] + points["hip_r"]) / 2
    pelvis = pelvis_rotation(found)
    flat = (flat_foot(found, "l"), flat_foot(found, "r"))
    body = fit_body(found, pelvis, flat, height=height)
    lumbar, chord = _spine(found, pelvis, body.segments)
    tilt = neck_tilt(found, pelvis, chord)
    torso = torso_rotation(found, chord, tilt)
    size = _with_shoulders(body.segments, found, lumbar, torso, tilt)
    tibiae = [_shank(_leg(found, side, root, pelvis, size)) for side in SIDES]
    size = replace(size, toe_out=_toe_out(found, tibiae, flat))
    elevation = (flat[0].elevation, flat[1].elevation)
    return Measures(replace(body, fitted=size), elevation, tilt, upright_head(found, torso))


def posed(found: Landmarks, measures: Measures) -> Motion:
    """The joint angles of a body that is known; position, heading and floor stay as in the file."""
    points, size = found.points, measures.body.segments
    root = (points["hip_l"] + points["hip_r"]) / 2
    pelvis = pelvis_rotation(found)
    lumbar, chord = _spine(found, pelvis, size)
    torso = torso_rotation(found, chord, measures.tilt)

    angles: dict[str, Float] = {}
    head = head_rotation(found, torso, measures.nod)
    balls: dict[Ball, Float] = {
        (TRUNK_JOINTS[:3], ""): _between(pelvis, torso),
        (TRUNK_JOINTS[3:], ""): _between(torso, head),
    }
    for side, sign, elevation in zip(SIDES, (1.0, -1.0), measures.elevation, strict=True):
        leg = _leg(found, side, root, pelvis, size)
        balls[LEG_JOINTS[:3], side] = _between(pelvis, leg.rotation)
        angles[f"knee_flexion_{side}"] = leg.flexion
        line = points[f"toe_{side}"] - points[f"ankle_{side}"]
        angles[f"ankle_dorsiflexion_{side}"] = dorsiflexion(_shank(leg), line, elevation, sign * size.toe_out)
        if found.has_arm(side):
            arm = _arm(found, side, lumbar, torso, size)
            balls[ARM_JOINTS[:3], side] = _between(torso, arm.rotation)
            angles[f"elbow_flexion_{side}"] = arm.flexion
            ulna = arm.rotation @ rotation_about("y", -arm.flexion)
            angles[f"forearm_pronation_{side}"] = _pronation(ulna, found.orientations.get(f"hand_{side}"), sign)
        else:
            _hang_arm(angles, side, len(found))
    names = [f"{joint}_{side}" if side else joint for joints, side in balls for joint in joints]
    angles.update(zip(names, angles_of_joints(np.stack(list(balls.values()), axis=1), list(balls)).T, strict=True))

    quaternions = Rotation.from_matrix(pelvis).as_quat(scalar_first=True)
    return Motion(
        fps=found.fps,
        root_position=root,
        root_quaternion=continuous_quaternions(quaternions),
        joints=np.stack([angles[joint] for joint in JOINTS], axis=1),
        body=measures.body,
        source=found.path,
    )


def _spine(found: Landmarks, pelvis: Float, size: Segments) -> tuple[Float, Float]:
    """The lumbar joint and the line from there to the neck, (T, 3) [m]."""
    points = found.points
    root = (points["hip_l"] + points["hip_r"]) / 2
    lumbar = root + pelvis @ np.array([size.lumbar_forward, 0.0, size.lumbar_height])
    return lumbar, points["neck"] - lumbar


def _with_shoulders(size: Segments, found: Landmarks, lumbar: Float, torso: Float, tilt: float) -> Segments:
    """Median positions of neck and shoulders in the axes of the torso."""
    middle = (found.points["shoulder_l"] + found.points["shoulder_r"]) / 2 - lumbar
    forward_by, _, above = np.median(in_frame(torso, middle), axis=0)
    return replace(
        size,
        neck_forward=size.neck_height * np.sin(tilt),
        neck_height=size.neck_height * np.cos(tilt),
        shoulder_forward=float(forward_by),
        shoulder_height=float(max(above, 0.5 * size.neck_height)),
    )


def _leg(found: Landmarks, side: str, root: Float, pelvis: Float, size: Segments) -> Limb:
    sign = 1.0 if side == "l" else -1.0
    points = found.points
    hip = root + pelvis @ np.array([0.0, sign * size.hip_width / 2, 0.0])
    knee, ankle = points[f"knee_{side}"], points[f"ankle_{side}"]
    # The knee of a straight leg faces along the foot; a foot in line with the shank has no direction.
    guess = cross(unit(knee - ankle), unit(points[f"toe_{side}"] - ankle)) + 0.2 * pelvis[:, :, 1]
    axis = hinge_axis(points[f"hip_{side}"], knee, ankle, 1.0, guess, found.attached.get(f"hip_{side}"))
    return solve_limb(hip, ankle, axis, (size.thigh, size.shank), 1.0)


def _shank(leg: Limb) -> Float:
    """Its rotation, (T, 3, 3)."""
    return leg.rotation @ rotation_about("y", leg.flexion)


def _toe_out(found: Landmarks, tibiae: list[Float], flat: tuple[FlatFoot, FlatFoot]) -> float:
    """Mean of both feet, positive outwards [rad]."""
    outward = []
    for side, sign, tibia, foot in zip(SIDES, (1.0, -1.0), tibiae, flat, strict=True):
        line = found.points[f"toe_{side}"] - found.points[f"ankle_{side}"]
        outward.append(sign * toe_out(tibia, line, foot.frames))
    return float(np.clip(np.mean(outward), -TOE_OUT_LIMIT, TOE_OUT_LIMIT))


def _arm(found: Landmarks, side: str, lumbar: Float, torso: Float, size: Segments) -> Limb:
    sign = 1.0 if side == "l" else -1.0
    points = found.points
    offset = np.array([size.shoulder_forward, sign * size.shoulder_width / 2, size.shoulder_height])
    shoulder = lumbar + torso @ offset
    elbow, wrist = points[f"elbow_{side}"], points[f"wrist_{side}"]
    # Fallback for the elbow axis of a straight arm: that of a hanging arm rotated to its direction by the smallest
    # rotation.
    guess = _lifted(torso, wrist - points[f"shoulder_{side}"])
    axis = hinge_axis(points[f"shoulder_{side}"], elbow, wrist, -1.0, guess, found.attached.get(f"shoulder_{side}"))
    return solve_limb(shoulder, wrist, axis, (size.upper_arm, size.forearm), -1.0)


def _hang_arm(angles: dict[str, Float], side: str, frames: int) -> None:
    rest = {"elbow_flexion": ELBOW_AT_REST, "forearm_pronation": PRONATION_AT_REST}
    angles.update({f"{joint}_{side}": np.full(frames, rest.get(joint, 0.0)) for joint in ARM_JOINTS})


def _lifted(torso: Float, reach: Float) -> Float:
    """The torso's left axis turned by the least rotation that takes its downward axis to `reach`, (T, 3)."""
    down, left = -torso[:, :, 2], torso[:, :, 1]
    target = unit(reach)
    axis, cosine = cross(down, target), np.sum(down * target, axis=-1, keepdims=True)
    turned = cosine * left + cross(axis, left)
    # Rodrigues' formula; the last term has no limit for an arm straight up, where any choice is as good.
    return turned + axis * np.sum(axis * left, axis=-1, keepdims=True) / np.maximum(1 + cosine, 1e-3)


def _pronation(ulna: Float, hand: Float | None, sign: float) -> Float:
    """Angle of the palm about the forearm, (T,) [rad]; interpolated where a bent wrist leaves it undefined."""
    if hand is None:
        return np.full(len(ulna), PRONATION_AT_REST)
    palm = in_frame(ulna, hand[:, :, 0])[:, :2] * [1.0, -sign]
    length = np.linalg.norm(palm, axis=-1)
    weight = smoothstep(length, 0.2, 0.5)
    direction = unit(palm)
    if weight.min() < 1:
        direction = weight[:, None] * direction + (1 - weight)[:, None] * fill(direction, weight, sigma=5.0)
    angle = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
    return angle - 2 * np.pi * np.round((np.median(angle) - PRONATION_AT_REST) / (2 * np.pi))


def _between(proximal: Float, distal: Float) -> Float:
    """Rotation of the distal in the proximal axes, (T, 3, 3)."""
    return proximal.swapaxes(1, 2) @ distal


def fit_errors(found: Landmarks, human: HumanKinematics) -> dict[str, FitError]:
    """Distances between a fitted human and the points of its file."""
    arms = [side for side in SIDES if found.has_arm(side)]
    pairs = {
        name: np.stack(
            [found.points[f"{name}_{side}"] - getattr(human, name)[:, SIDES.index(side)] for side in sides], axis=1
        )
        for name, sides in (("ankle", SIDES), ("wrist", arms))
        if sides
    }
    if "head" in found.points:
        # The file's point may lie anywhere in the head: the reference is its median position.
        offset = found.points["head"] - human.vertex
        local = in_frame(human.head_rotation, offset)
        pairs["head"] = local - np.median(local, axis=0)
    errors = {}
    for name, difference in pairs.items():
        distance = np.linalg.norm(difference, axis=-1)
        errors[name] = FitError(rms=float(np.sqrt(np.mean(distance**2))), max=float(distance.max()))
    return errors
