"""Bases of gestures: stretches of recordings in which a human stands or walks straight."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from flexmotion.configs.errors import FlexMotionError
from flexmotion.dataset.clips import Clip
from flexmotion.gestures.arm import arm_angles
from flexmotion.gestures.recipes import ArmPose, Ground
from flexmotion.human.angles import three_angles
from flexmotion.human.body import Body
from flexmotion.human.kinematics import HumanKinematics, forward
from flexmotion.human.motion import Motion
from flexmotion.human.signals import low_pass, runs
from flexmotion.human.skeleton import ARM_JOINTS, JOINTS, SIDES
from flexmotion.human.vectors import unit
from flexmotion.importers import read
from flexmotion.importers.load import from_origin
from flexmotion.spatial.heading import continuous_matrix_heading
from flexmotion.spatial.quaternions import continuous_quaternions

Float = NDArray[np.float64]

NORMAL = ("normal", "")
"""Styles of clips that may be bases: the normal one, or none told."""

WALKING = ("walk",)
"""Labels of clips that walk."""

CUTOFF = 3.0
"""Of the speeds by which stretches are found [Hz]."""

SWAY = 1.0
"""Cut-off of the sway of a standing base [Hz]: what its own arms did to its trunk is faster."""

WAY = 0.5
"""Cut-off of pace and turning of a walk [Hz]: strides are faster."""

STILL, PLANTED, QUIET = 0.15, 0.08, 0.5
"""Greatest speed of a standing human's pelvis, of its ankles, and of hands at rest against the torso [m/s]."""

TURNING = 0.35
"""Greatest turning of a base [rad/s]."""

UPRIGHT, AHEAD = np.radians(20.0), np.radians(25.0)
"""Greatest tilt of the torso, and greatest angle between head and torso [rad]."""

HANGING = np.radians((25.0, 45.0))
"""Greatest angle of a hanging arm to the torso's axis, and greatest flexion of its elbow [rad]."""

RESTED = 5
"""Least number of frames in which both arms hang and are quiet, for a clip's own hanging arms."""

HANG = ArmPose(upper=(-0.04, 0.13, -1.0), forearm=(0.24, 0.1, -1.0), palm=(-0.2, -1.0, 0.0), spread=7.0)
"""Hanging arms as in recorded stands, for clips without such frames; each clip has its own."""

ARMS = [JOINTS.index(f"{name}_{side}") for side in SIDES for name in ARM_JOINTS]
ELBOWS = [JOINTS.index(f"elbow_flexion_{side}") for side in SIDES]

TALL, STANCE = 0.95, 0.215
"""Least height of the pelvis, in that of upright stance, and greatest distance of the ankles, in body heights: who
sits, crouches or straddles is no base."""

PACE = (0.6, 1.9)
"""Mean speed of a walking base [m/s]."""

SHORTEST: dict[Ground, float] = {"stand": 2.0, "walk": 2.6}
"""Least duration of a base [s]; standing is extended (`extended`), walking is not."""

ROUND = 0.5
"""Time within which an extended stand reverses [s]."""


@dataclass(frozen=True)
class Base:
    """A stretch of a recording.

    Attributes:
        clip: it is from.
        motion: starts over the origin with the pelvis facing x.
        ground: what the human does.
    """

    clip: Clip
    motion: Motion
    ground: Ground

    @property
    def person(self) -> str:
        """Collection and subject, as far as the clip's labels and name tell them."""
        number = self.clip.labels.get("subject") or self.clip.name.split("_")[0]
        return f"{self.clip.collection} {number}"


def find_bases(clips: Iterable[Clip], fps: float) -> Iterator[Base]:
    """Bases in clips; clips of another style than the normal one, and those that cannot be read, have none.

    Args:
        clips: recordings.
        fps: frame rate of the bases.
    """
    for clip in clips:
        if clip.labels.get("style", "") not in NORMAL:
            continue
        try:
            motion = read(clip.path, fps=fps, clip=clip.member or None).motion
        except FlexMotionError:
            # `data build` reports unreadable clips; here they are no bases.
            continue
        label = clip.labels.get("content") or clip.labels.get("action") or ""
        yield from stretches(clip, motion, label in WALKING)


def stretches(clip: Clip, motion: Motion, walks: bool) -> Iterator[Base]:
    """Stretches of one motion that are bases: stands of any clip, straight walks of clips that walk.

    The arms of a stand hang as they do in the clip where they are quiet, or as most people's do where they never are.
    """
    if motion.duration <= min(SHORTEST.values()):
        return
    human = forward(motion)
    steady, rest = _steady(human, motion.fps), _at_rest(motion, human)
    for first, end in runs(steady & _standing(motion, human)):
        if end - first > SHORTEST["stand"] * motion.fps:
            yield Base(clip, from_origin(_rested(clip, motion, rest)[first:end]), "stand")
    if walks:
        for first, end in runs(steady & _walking(human, motion.fps)):
            if end - first > SHORTEST["walk"] * motion.fps:
                yield Base(clip, from_origin(motion[first:end]), "walk")


def _speed(points: Float, fps: float) -> Float:
    """Speeds of points, (T, ..., 3) [m] -> (T, ...) [m/s]."""
    flat = (
        low_pass(points.reshape(len(points), -1), fps, CUTOFF) if len(points) > 12 else points.reshape(len(points), -1)
    )
    speed: Float = np.linalg.norm(np.gradient(flat.reshape(points.shape), 1.0 / fps, axis=0), axis=-1)
    return speed


def _steady(human: HumanKinematics, fps: float) -> NDArray[np.bool_]:
    """Upright, looking ahead, not turning."""
    upright = human.torso_rotation[:, 2, 2] > np.cos(UPRIGHT)
    looking = np.einsum("ti,ti->t", human.head_rotation[:, :, 0], human.torso_rotation[:, :, 0])
    turning = np.gradient(low_pass(continuous_matrix_heading(human.pelvis_rotation), fps, WAY), 1.0 / fps)
    return upright & (looking > np.cos(AHEAD)) & (np.abs(turning) < TURNING)


def _standing(motion: Motion, human: HumanKinematics) -> NDArray[np.bool_]:
    """Both feet on the floor, the pelvis high and nowhere to go."""
    fps, size = motion.fps, motion.body
    return (
        (_speed(human.pelvis_position, fps) < STILL)
        & (_speed(human.ankle, fps) < PLANTED).all(axis=1)
        & (human.pelvis_position[:, 2] > TALL * size.standing_height)
        & (np.linalg.norm(human.ankle[:, 0] - human.ankle[:, 1], axis=1) < STANCE * size.height)
        & (human.ankle[:, :, 2] < 1.6 * size.segments.ankle_height + 0.02).all(axis=1)
    )


def _at_rest(motion: Motion, human: HumanKinematics) -> NDArray[np.bool_]:
    """Frames in which both arms hang and are quiet."""
    hand = np.einsum("tji,tsj->tsi", human.torso_rotation, human.hand - human.pelvis_position[:, None])
    line = np.einsum("tji,tsj->tsi", human.torso_rotation, unit(human.hand - human.shoulder))
    hanging = (line[:, :, 2] < -np.cos(HANGING[0])) & (motion.joints[:, ELBOWS] < HANGING[1])
    return hanging.all(axis=1) & (_speed(hand, motion.fps) < QUIET).all(axis=1)


def _rested(clip: Clip, motion: Motion, rest: NDArray[np.bool_]) -> Motion:
    """The motion with hanging arms, and with the sway alone of everything else."""
    joints = low_pass(motion.joints, motion.fps, SWAY)
    own = rest.sum() >= RESTED
    joints[:, ARMS] = np.median(motion.joints[rest][:, ARMS], axis=0) if own else hanging(clip.name, motion.body)
    quaternions = low_pass(continuous_quaternions(motion.root_quaternion), motion.fps, SWAY)
    return replace(
        motion,
        root_position=low_pass(motion.root_position, motion.fps, SWAY),
        root_quaternion=quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        joints=joints,
    )


def hanging(name: str, body: Body) -> Float:
    """Angles of both arms as in `HANG`, drawn by the name of a clip, in the order of `ARMS`, (10,) [rad]."""
    rng = np.random.default_rng(list(name.encode()))
    found = []
    for side, letter in enumerate(SIDES):
        turned = Rotation.from_rotvec(np.radians(HANG.spread) * rng.uniform(-1.0, 1.0, 3))
        arm = arm_angles(HANG, body, side, turned)
        shoulder = three_angles(arm.humerus.as_matrix()[None], ARM_JOINTS[:3], letter)[0]
        found += [*shoulder, arm.elbow, arm.pronation or 0.0]
    return np.array(found)


def _walking(human: HumanKinematics, fps: float) -> NDArray[np.bool_]:
    speed = np.gradient(low_pass(human.pelvis_position[:, :2], fps, WAY), 1.0 / fps, axis=0)
    ahead = np.einsum("ti,ti->t", speed, human.pelvis_rotation[:, :2, 0])
    return (ahead > PACE[0]) & (ahead < PACE[1])


def extended(base: Base, frames: int, rng: np.random.Generator) -> Motion | None:
    """Motion of a base of a number of frames; None where a walk is too short.

    A stand that is too short goes to and fro in time: its sway is slow, so that it looks and weighs the same in both
    directions. It reverses within `ROUND`, by a smooth change of pace.
    """
    have = len(base.motion)
    if have >= frames:
        first = int(rng.integers(have - frames + 1))
        return from_origin(base.motion[first : first + frames])
    if base.ground == "walk":
        return None
    return from_origin(_at(base.motion, _to_and_fro(have, frames, base.motion.fps, rng)))


def _to_and_fro(have: int, frames: int, fps: float, rng: np.random.Generator) -> Float:
    """Places in a motion of `have` frames, going to and fro from a drawn one, (frames,) [frames]."""
    width = max(3, round(ROUND * fps) | 1)
    start = rng.uniform(0.0, 2.0 * (have - 1))
    there = (start + np.arange(frames + 2 * width)) % (2.0 * (have - 1))
    folded = np.minimum(there, 2.0 * (have - 1) - there)
    window = np.hanning(width + 2)[1:-1]
    smooth: Float = np.convolve(folded, window / window.sum(), mode="same")[width : width + frames]
    return smooth


def _at(motion: Motion, places: Float) -> Motion:
    """A motion at places between its frames, (N,) [frames]; linear between them."""
    low = np.minimum(np.floor(places).astype(int), len(motion) - 2)
    share = (places - low)[:, None]

    def between(values: Float) -> Float:
        result: Float = values[low] + share * (values[low + 1] - values[low])
        return result

    quaternions = between(continuous_quaternions(motion.root_quaternion))
    return replace(
        motion,
        root_position=between(motion.root_position),
        root_quaternion=Rotation.from_quat(quaternions, scalar_first=True).as_quat(scalar_first=True),
        joints=between(motion.joints),
        torques=None,
        wrenches=None,
        activations=None,
        joint_contact=None,
        contacts=None,
    )


def draw_base(bases: Sequence[Base], rng: np.random.Generator) -> Base:
    """Draw a person by the square root of the number of their bases, then one of these."""
    people: dict[str, list[Base]] = {}
    for base in bases:
        people.setdefault(base.person, []).append(base)
    chance = np.sqrt([len(own) for own in people.values()])
    own = list(people.values())[rng.choice(len(people), p=chance / chance.sum())]
    return own[rng.integers(len(own))]
