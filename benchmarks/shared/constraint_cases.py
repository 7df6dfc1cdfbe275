"""Constraints taken from held-out clips, and how far motion is from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.model.real_clips import kind_of
from flexmotion.dataset.compact_set import MotionSet
from flexmotion.features.constraint_layout import (
    CENTRES,
    FORCES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
)
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor, decode
from flexmotion.features.encode import LEAD, encode
from flexmotion.features.joint_groups import HINGES
from flexmotion.features.layout import ACTIVATIONS, POINTS
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.human.resample import resample
from flexmotion.human.skeleton import JOINTS
from flexmotion.sampling.sampler import Sampler
from flexmotion.sampling.window_pose import motion_values
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.text.phrases import wordings

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

OF_A_KIND = 3
"""Clips of one kind of motion, at most."""

CAP = 0.8
"""A torque limit is this share of the joint's largest torque in the window without constraints."""

KNEE = JOINTS.index("knee_flexion_r")


@dataclass(frozen=True)
class Case:
    """A part of a held-out clip, as motion of the model's human.

    Attributes:
        text: what the clip shows, in words.
        history: frames that a sample depends on.
        future: the frames after them.
    """

    text: str
    history: Motion
    future: Motion


def cases(found: MotionSet, sampler: Sampler, count: int, frames: int, seed: int) -> Iterator[Case]:
    """Parts of recorded clips of the split `validation`, few of each kind.

    Args:
        found: the set.
        sampler: of the model, whose human and frame rate they get.
        count: how many, at most.
        frames: of the future.
        seed: of the draw.
    """
    rng, layout = np.random.default_rng(seed), sampler.layout
    clips = list(found.select("validation", "original"))
    seen: Counter[str] = Counter()
    past = sampler.history + 2 * LEAD
    for number in rng.permutation(len(clips)):
        clip = clips[number]
        kind = kind_of(clip)
        if not kind or seen[kind] >= OF_A_KIND:
            continue
        motion = resample(found.motion(clip), layout.fps)
        first = int(rng.integers(0, max(len(motion) - past - frames, 1)))
        if len(motion) < first + past + frames:
            continue
        seen[kind] += 1
        features = encode(motion[first : first + past + frames], layout)
        history = decode(features[:past], layout, sampler.body, Anchor.origin())
        text = (*wordings(kind), kind.replace("-", " "))[0]
        yield Case(text, history, decode(features[past:], layout, sampler.body, Anchor.after(history)))
        if seen.total() == count:
            return


@dataclass(frozen=True)
class Kind:
    """A kind of constraint.

    Attributes:
        name: of the row.
        unit: of its error.
        mask: what is asked, (W, C), of a layout and the values of the clip, (W, C).
        error: of each asked entry, from values asked and found and the mask, all (W, C), and the human.
        balanced: whether, without a branch, balanced windows alone follow it.
    """

    name: str
    unit: str
    mask: Callable[[ConstraintLayout, Float], Mask]
    error: Callable[[Float, Float, Mask, ConstraintLayout, Body], Float]
    balanced: bool = False


def asked(kind: Kind, case: Case, sampler: Sampler, plain: Motion) -> Constraints:
    """The constraints of a kind that the first window of a case keeps.

    Args:
        kind: of constraint.
        case: whose future is asked for.
        sampler: of the model.
        plain: what the sampler makes without constraints, to which a limit relates.
    """
    none = Constraints.none(sampler.layout, sampler.body, sampler.future)
    window = case.future[: sampler.future]
    values = motion_values(window, Anchor.after(case.history), none.layout)
    own = motion_values(plain, Anchor.after(case.history), none.layout)
    limits = none.layout.blocks[TORQUE_LIMITS]
    values[:, limits] = CAP * np.abs(own[:, limits]).max(axis=0)
    return replace(none, values=values, mask=kind.mask(none.layout, values))


def _columns(*columns: Callable[[ConstraintLayout], slice], frames: slice = slice(None)) -> Callable[..., Mask]:
    def mask(layout: ConstraintLayout, values: Float) -> Mask:
        found = np.zeros(values.shape, np.bool_)
        for column in columns:
            found[frames, column(layout)] = True
        return found

    return mask


def _point(name: str) -> Callable[[ConstraintLayout], slice]:
    def columns(layout: ConstraintLayout) -> slice:
        first = layout.blocks[PLACES].start + 3 * POINTS.index(name)
        return slice(first, first + 3)

    return columns


def _block(name: str, first: int = 0, last: int | None = None) -> Callable[[ConstraintLayout], slice]:
    def columns(layout: ConstraintLayout) -> slice:
        block = layout.blocks[name]
        return slice(block.start + first, block.stop if last is None else block.start + last)

    return columns


def _distance(size: int) -> Callable[..., Float]:
    """Distances of places of `size` coordinates [cm]."""

    def error(values: Float, found: Float, mask: Mask, layout: ConstraintLayout, body: Body) -> Float:
        away = (found - values)[mask].reshape(-1, size) * body.leg
        return np.asarray(100 * np.linalg.norm(away, axis=1))

    return error


def _size(unit: Callable[[Body], float]) -> Callable[..., Float]:
    def error(values: Float, found: Float, mask: Mask, layout: ConstraintLayout, body: Body) -> Float:
        return np.asarray(np.abs(found - values)[mask] * unit(body))

    return error


def _beyond(values: Float, found: Float, mask: Mask, layout: ConstraintLayout, body: Body) -> Float:
    """How far the size of each torque is beyond its limit [N·m]."""
    over = np.maximum(np.abs(found) - values, 0.0)[mask]
    return np.asarray(over * body.mass * GRAVITY * body.leg)


def _uncorrelated(values: Float, found: Float, mask: Mask, layout: ConstraintLayout, body: Body) -> Float:
    """1 - correlation over the frames of the window, of each muscle that changes."""
    columns = layout.blocks[ACTIVATIONS]
    whole = mask[:, columns].all(axis=0)
    told, made = values[:, columns][:, whole], found[:, columns][:, whole]
    changing = told.std(axis=0) > CHANGING
    told, made = (part[:, changing] - part[:, changing].mean(axis=0) for part in (told, made))
    size = np.linalg.norm(told, axis=0) * np.linalg.norm(made, axis=0)
    return np.asarray(1.0 - (told * made).sum(axis=0) / np.maximum(size, 1e-9))


def _force(values: Float, found: Float, mask: Mask, layout: ConstraintLayout, body: Body) -> Float:
    """Distances of the ground forces on each foot [% of body weight]."""
    forces = layout.blocks[FORCES]
    away = (found - values)[:, forces][mask[:, forces]].reshape(-1, 3)
    return np.asarray(100 * np.linalg.norm(away, axis=1))


CHANGING = 0.01
"""Standard deviation over a window from which on an activation changes: what is constant has no correlation."""


def _muscles(count: int) -> Callable[[ConstraintLayout, Float], Mask]:
    """Some of the muscles that change in the clip, evenly from those that do so most to those that do so least."""

    def mask(layout: ConstraintLayout, values: Float) -> Mask:
        found = np.zeros(values.shape, np.bool_)
        columns = layout.blocks[ACTIVATIONS]
        spread = values[:, columns].std(axis=0)
        order = np.argsort(-spread)[: max(int((spread > CHANGING).sum()), 1)]
        places = (np.arange(count) + 0.5) / count * len(order)
        found[:, columns.start + order[places.astype(int)]] = True
        return found

    return mask


ELBOW = 6 * 7 + HINGES.index("elbow_flexion_r")
"""Column of the right elbow in the block of rotations: behind pelvis and six balls."""

KINDS: tuple[Kind, ...] = (
    Kind("right hand, whole window", "cm", _columns(_point("hand_r")), _distance(3)),
    Kind("right hand, one keyframe", "cm", _columns(_point("hand_r"), frames=slice(20, 21)), _distance(3)),
    Kind("left toes, whole window", "cm", _columns(_point("toe_l")), _distance(3)),
    Kind("16 points, four keyframes", "cm", _columns(_block(PLACES), frames=slice(7, None, 8)), _distance(3)),
    Kind("root path, whole window", "cm", _columns(_block(PATH, 0, 2)), _distance(2)),
    Kind("heading, whole window", "°", _columns(_block(PATH, 3, 4)), _size(lambda body: 180 / np.pi)),
    Kind("right elbow, whole window", "°", _columns(_block(ROTATIONS, ELBOW, ELBOW + 1)), _size(lambda _: 180 / np.pi)),
    Kind("ground forces with place", "% weight", _columns(_block(FORCES), _block(CENTRES)), _force, balanced=True),
    Kind(
        "right knee's torque",
        "N·m",
        _columns(_block(TORQUES, KNEE, KNEE + 1)),
        _size(lambda body: body.mass * GRAVITY * body.leg),
        balanced=True,
    ),
    Kind("limit of the right knee", "N·m", _columns(_block(TORQUE_LIMITS, KNEE, KNEE + 1)), _beyond, balanced=True),
    Kind("1 muscle", "1 - r", _muscles(1), _uncorrelated),
    Kind("20 muscles", "1 - r", _muscles(20), _uncorrelated),
)
"""The rows of `model/control`."""
