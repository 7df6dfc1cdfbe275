"""`delivered`: a sampled window as it is handed on, with ground forces and torques that belong to its motion.

A model decodes motion, torques and forces together, but its feet are planted afterwards, and a body that is moved needs
other forces. After planting, therefore:

1. root and legs are low-passed (`low_pass`) at the cut-off of the data, above which a sample has noise alone, in
   poses that are held at a lower one;
2. the root's path is shifted until the ground can give what the motion needs (`balance`): of a body that stands or
   walks over feet that legs keep on their paths, then, for what the legs' own accelerations need, with its feet; of any
   other one with its feet, which legs keep above the floor;
3. ground forces are shared between the feet as the model predicts, as far as the motion allows (`ground_share`);
4. torques are those of inverse dynamics under these forces; the root's are what no ground can give, the residual.

Activations stay as the model predicts them, but for those that are asked (`muscle_share`): which muscles work against
each other is not seen in the motion, and their sum is not corrected for the change of the torques. Joint contact
forces change by the part of the ground alone.

Accelerations at the end of a window depend on what follows. The forces of the last frames are therefore made once more
with the next window, and `Delivered.before` has them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.dynamics import CONTACT_SHARE
from flexmotion.biomechanics.inverse_dynamics import joint_torques, whole_effort
from flexmotion.biomechanics.joint_contact import BEYOND
from flexmotion.biomechanics.segment_motion import SegmentMotion, moved_by, segment_motion
from flexmotion.biomechanics.smoothing import CUTOFF
from flexmotion.biomechanics.sole import REACH
from flexmotion.human.concatenate import concatenate
from flexmotion.human.human_model import human_model
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import CONTACT_JOINTS, JOINTS, LEG_JOINTS, SIDES
from flexmotion.sampling.balance import BALANCE, Balance, Needs, acceleration, horizontal_shift, vertical_shift
from flexmotion.sampling.ground_share import GroundShare, ground_share
from flexmotion.sampling.leg_reach import smoothly_shifted
from flexmotion.sampling.low_pass import continued
from flexmotion.sampling.resting_feet import RestingFeet
from flexmotion.sampling.soles import Soles
from flexmotion.sampling.walking import Walks
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

KNOWN = 2 * EDGE
"""Frames before a window that its forces, and those of the `EDGE` frames before it, depend on."""

STANDING = 0.8 * REACH
"""A sole point that the balance relies on is lower than this [m]; the shift of the height may raise it by the rest."""

FLIGHT_S = 0.25
"""Longest flight of a body between two steps [s]: in runs it takes .1 to .2. A sample whose soles are above the floor
for longer does not fall: one fell by .4 m, through the floor."""

SUNK = 0.005
"""A sole that is lower than this is below the floor [m]."""

_LEGS = [JOINTS.index(f"{joint}_{side}") for side in SIDES for joint in LEG_JOINTS]


@dataclass(frozen=True)
class Delivered:
    """A window and the frames before it.

    Attributes:
        before: the last frames of the past, `EDGE` or as many as there are, with their forces made again.
        window: the frames after them.
    """

    before: Motion
    window: Motion


def delivered(
    window: Motion,
    past: Motion,
    planned: Float,
    finish: Callable[[Motion, SegmentMotion], Motion] = lambda window, _: window,
    stays: Flags | None = None,
    resting: RestingFeet | None = None,
    cutoff: float = CUTOFF,
    *,
    walks: bool = False,
    stops: bool = False,
    raises: bool = False,
    settings: Balance = BALANCE,
) -> Delivered:
    """Make the forces of a window and of the frames before it those of their motion.

    Args:
        window: planted, with the wrenches, centres of pressure and contacts that a model predicts. Without them it is
            returned as it is.
        past: the motion before it, of the same body and frame rate, at least one frame; with `KNOWN` of them or more
            the seam is exact. Frames without forces keep none.
        planned: second derivative of the root's path in the model's own window, (T, 3) [m/s²]; the first and the last
            row are not used.
        finish: changes joints of the balanced window a last time before its forces are made, given its segments; its
            root must stay, on which the segments that it does not carry are kept.
        stays: feet that `finish` brings back to where they are in `window`, (T, 2); None: none.
        resting: feet of a body that stands, which `finish` keeps in place.
        cutoff: at which root and legs are low-passed [Hz].
        walks: whether `finish` keeps both feet on their paths under a body that goes somewhere.
        stops: whether that is to stand after the window.
        raises: whether legs raise feet that the balance takes below the floor: of a body that neither stands nor
            walks, over nothing that is asked of them.
        settings: weights of the balance.
    """
    last = past[max(0, len(past) - KNOWN) :]
    before = last[max(0, len(last) - EDGE) :]
    if window.wrenches is None or window.pressure_centres is None or window.contacts is None or not len(window):
        return Delivered(before, window)
    window = _low_passed(window, last, cutoff)
    known = _lengthened(last, KNOWN)
    whole = concatenate([known.kinematics, window.kinematics])
    contacts = np.concatenate([_contacts(known), window.contacts])
    segments = segment_motion(whole)
    soles = Soles.of(whole.body, segments)
    root, planned = whole.root_position, np.concatenate([np.zeros((KNOWN, 3)), planned])
    seen = _Seen.of(segments, soles, contacts, whole, planned)
    if raises and (raised := _raised(window, soles, seen, whole.joints[KNOWN - 1])) is not window:
        segments = moved_by(np.asarray((raised.joints != window.joints).any(axis=0)), segments, raised)
        window, soles = raised, Soles.of(whole.body, segments)
        seen = _Seen.of(segments, soles, contacts, whole, planned)
    goes_on = Walks.of(whole, segments, soles, KNOWN, stops=stops) if walks else None
    shift, needs = _balanced(seen, soles, stays, resting, goes_on, settings)
    segments, soles = _moved(segments, shift, whole.fps), soles.moved(shift)
    window = _shifted(window, shift)
    finished = finish(window, _frames(segments, slice(KNOWN, None)))
    if finished is not window:
        segments = moved_by(np.asarray((finished.joints != window.joints).any(axis=0)), segments, finished)
        window = finished
        soles = Soles.of(whole.body, segments)
        # The forces do not depend on the path; that of a walk is shifted once more, from where it is now.
        needs = _needs(segments, root + shift, whole.fps, planned)
        if walks:
            shift = np.zeros((len(whole), 3))
            shift[:, :2] = horizontal_shift(needs, soles.bounds(soles.usable(contacts, STANDING)))
            segments, soles, needs = _moved(segments, shift, whole.fps), soles.moved(shift), needs.shifted(shift)
            window = _shifted(window, shift)
    again = len(before) if before.wrenches is not None and before.pressure_centres is not None else 0
    predicted = concatenate([before, window]) if again else window
    made = slice(KNOWN - again, None)
    usable = soles.usable(contacts, REACH)[made]
    mass, weight = window.body.mass, window.body.mass * GRAVITY
    assert predicted.wrenches is not None and predicted.pressure_centres is not None
    ground = ground_share(
        mass * needs.force[made],
        mass * needs.moment[made],
        soles[made],
        usable,
        predicted.wrenches,
        predicted.pressure_centres,
        weight,
    )
    found = _with_forces(predicted, ground, _frames(segments, made))
    return Delivered(found[:again] if again else before, found[again:])


@dataclass(frozen=True)
class _Seen:
    """What balance sees of a motion, N frames.

    Attributes:
        needs: of the ground.
        usable: sole points that it relies on, (N, 2, 12).
        rise: shift of the height with which the ground can give what the motion needs, (N,) [m].
    """

    needs: Needs
    usable: Flags
    rise: Float

    @classmethod
    def of(cls, segments: SegmentMotion, soles: Soles, contacts: Flags, whole: Motion, planned: Float) -> _Seen:
        needs = _needs(segments, whole.root_position, whole.fps, planned)
        usable = soles.usable(contacts, STANDING)
        return cls(needs, usable, vertical_shift(needs, _borne(usable, whole.fps)))


def _raised(window: Motion, soles: Soles, seen: _Seen, before: Float) -> Motion:
    """The window with feet raised by their legs that its shift in height takes below the floor; else itself."""
    below = (-SUNK - soles.height.min(axis=2) - seen.rise[:, None])[KNOWN:]
    if below.max() <= 0.0:
        return window
    by = np.zeros((*below.shape, 3))
    by[..., 2] = np.maximum(below, 0.0)
    return smoothly_shifted(window, by, before)


def _shifted(window: Motion, shift: Float) -> Motion:
    """A window whose last frames of root and centres of pressure are shifted by the last of (N, 3) [m]."""
    assert window.pressure_centres is not None
    at = shift[len(shift) - len(window) :]
    centres = window.pressure_centres + (at * [1.0, 1.0, 0.0])[:, None]
    return window.changed(root_position=window.root_position + at, pressure_centres=centres)


def _low_passed(window: Motion, past: Motion, cutoff: float) -> Motion:
    joints = window.joints.copy()
    joints[:, _LEGS] = continued(joints[:, _LEGS], past.joints[:, _LEGS], window.fps, cutoff)
    position = continued(window.root_position, past.root_position, window.fps, cutoff)
    return window.changed(joints=joints, root_position=position)


def _lengthened(motion: Motion, frames: int) -> Motion:
    """The motion with its first frame repeated before it: motion before it is taken as even."""
    missing = frames - len(motion)
    return motion if missing <= 0 else concatenate([*[motion[:1]] * missing, motion])


def _contacts(motion: Motion) -> Flags:
    """Feet that carry load; both where nothing is known."""
    return np.ones((len(motion), 2), np.bool_) if motion.contacts is None else motion.contacts


def _balanced(
    seen: _Seen,
    soles: Soles,
    stays: Flags | None,
    resting: RestingFeet | None,
    goes_on: Walks | None,
    settings: Balance,
) -> tuple[Float, Needs]:
    """Shift of the root's path for balance, (N, 3) [m], and what the shifted motion needs of the ground."""
    shift = np.zeros((len(seen.rise), 3))
    shift[:, 2] = seen.rise
    lifted = seen.needs.shifted(shift)
    if resting is not None:
        stays = resting.stands if stays is None else stays | resting.stands
        points = soles.points.copy()
        points[KNOWN:] += resting.shift[:, :, None]
        soles = replace(soles, points=points)
    bounds, kept = soles.bounds(seen.usable), _staying(seen.usable, stays)
    level = np.zeros_like(shift)
    level[:, :2] = horizontal_shift(lifted, bounds, kept, settings, stands=resting is not None, walks=goes_on)
    shift[:, :2] = level[:, :2]
    return shift, lifted.shifted(level)


def _staying(usable: Flags, stays: Flags | None) -> Float | None:
    """Share of the usable sole points of feet that stay, (N,); of a window's frames, which are the last ones."""
    if stays is None or not stays.any():
        return None
    points = usable.sum(axis=2)
    kept = np.zeros((len(usable), 2))
    kept[len(usable) - len(stays) :] = stays
    found: Float = (kept * points).sum(axis=1) / np.maximum(points.sum(axis=1), 1)
    return found


def _needs(segments: SegmentMotion, root: Float, fps: float, planned: Float) -> Needs:
    """What a motion needs of the ground, known frames first; `root`: its path, (N, 3) [m]."""
    force, moment, centre = whole_effort(segments)
    return Needs(
        known=KNOWN,
        fps=fps,
        root=root,
        planned=planned,
        force=force,
        moment=moment,
        centre=centre,
    )


def _borne(usable: Flags, fps: float) -> Flags:
    """Frames in which the ground bears the body, (T,): all but flights, which are shorter than `FLIGHT_S`."""
    found = np.asarray(usable.any(axis=(1, 2)))
    changes = np.flatnonzero(np.diff(np.concatenate([[1], found.astype(int), [1]])))
    for first, end in changes.reshape(-1, 2):
        found[first:end] = end - first > FLIGHT_S * fps
    return found


def _moved(segments: SegmentMotion, shift: Float, fps: float) -> SegmentMotion:
    """Segments of a body that is shifted as a whole."""
    away = shift[:, None]
    return SegmentMotion(
        mass=segments.mass,
        position=segments.position + away,
        rotation=segments.rotation,
        com=segments.com + away,
        acceleration=segments.acceleration + acceleration(shift, fps)[:, None],
        angular_momentum_rate=segments.angular_momentum_rate,
        anchor=segments.anchor + away,
        axis=segments.axis,
    )


def _with_forces(predicted: Motion, ground: GroundShare, segments: SegmentMotion) -> Motion:
    """The motion with these ground forces and the torques that they need."""
    assert predicted.wrenches is not None
    change = ground.wrenches[..., :3] - predicted.wrenches[..., :3]
    return predicted.changed(
        torques=joint_torques(predicted.body, segments, ground.wrenches, ground.centres),
        wrenches=ground.wrenches,
        pressure_centres=ground.centres,
        contacts=ground.wrenches[..., 2] > CONTACT_SHARE * predicted.body.mass * GRAVITY,
        joint_contact=_joint_contact(predicted, segments, change),
    )


def _frames(segments: SegmentMotion, frames: slice) -> SegmentMotion:
    return SegmentMotion(
        mass=segments.mass,
        position=segments.position[frames],
        rotation=segments.rotation[frames],
        com=segments.com[frames],
        acceleration=segments.acceleration[frames],
        angular_momentum_rate=segments.angular_momentum_rate[frames],
        anchor=segments.anchor[frames],
        axis=segments.axis[frames],
    )


def _joint_contact(motion: Motion, segments: SegmentMotion, change: Float) -> Float | None:
    """Contact forces of the legs for ground forces that change by (T, 2, 3) [N], muscle forces unchanged."""
    if motion.joint_contact is None:
        return None
    found, index = motion.joint_contact.copy(), human_model(motion.body).body_index
    legs = [(column, name[:-2], name[-1]) for column, name in enumerate(CONTACT_JOINTS) if "_" in name]
    rotation = segments.rotation[:, [index[f"{BEYOND[joint][0]}_{side}"] for _, joint, side in legs]]
    ground = change[:, [SIDES.index(side) for _, _, side in legs]]
    found[:, [column for column, _, _ in legs]] -= np.einsum("tlji,tlj->tli", rotation, ground)
    return found
