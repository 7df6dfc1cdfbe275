"""`Draft`: a window on its way from a decoder's features to the motion that is delivered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmotion.biomechanics.differentiation import EDGE
from flexmotion.biomechanics.dynamics import CONTACT_SHARE
from flexmotion.biomechanics.segment_motion import SegmentMotion
from flexmotion.features.constraint_layout import CENTRES, FORCES
from flexmotion.features.constraints import Constraints
from flexmotion.features.decode import Anchor, decode, root_path
from flexmotion.features.heading_frame import turned
from flexmotion.features.inertialise import inertialised
from flexmotion.features.layout import ACTIVATIONS, Layout
from flexmotion.features.unhurried import unhurried
from flexmotion.human.body import Body
from flexmotion.human.kinematics import foot_points
from flexmotion.human.motion import Motion
from flexmotion.human.skeleton import SIDES
from flexmotion.sampling.at_rest import at_rest
from flexmotion.sampling.balance import BALANCE, STILL
from flexmotion.sampling.beside import Beside
from flexmotion.sampling.delivery import Delivered, delivered
from flexmotion.sampling.kept_feet import LIFTED
from flexmotion.sampling.kept_pose import KeptPose
from flexmotion.sampling.leg_reach import smoothly_shifted
from flexmotion.sampling.limb_closing import LEG, closed, staying
from flexmotion.sampling.low_pass import steadied
from flexmotion.sampling.muscle_share import with_muscles
from flexmotion.sampling.placed_legs import placed
from flexmotion.sampling.planted import Holding, Slip, lifted, planted_slip
from flexmotion.sampling.resting_feet import RestingFeet, standing_on
from flexmotion.sampling.rhythm import Rhythm
from flexmotion.sampling.still_stance import SWAYING, StillStance
from flexmotion.sampling.window_pose import PELVIS, WindowPose
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

WALKS = 0.4
"""A body that arrives, or crosses the window, faster than this [m/s] still walks, whatever is asked."""

ARRIVING = 4
"""Last known frames over which the speed of its arrival is measured."""

UPRIGHT = np.radians(0.1)
"""A pelvis that leans by less than this [rad] is upright."""

RUNS = 2.0
"""People run rather than walk from this speed on [m/s]: half of gravity's at the length of a leg (Froude number .5)."""

STOOD = 0.03
"""Feet that moved less than this in the last `ARRIVING` frames have come to rest [m]."""

GLIDES = 0.5
"""Feet of which the slowest end is faster than this glide [m/s]."""

HELD = 0.15
"""Legs hold feet against a shift of the body by no more than this [m]."""

BRAKES = 1.25
"""A body that is slower or faster in a window than it arrives, by this [m/s], is not held by its feet: its capture
point is .4 m beside where they want it."""

IN_PLACE = 1e-6
"""Legs are not closed where feet and balance moved no farther than this [m]."""

FAR = 0.015
"""Resting feet that slip farther than this in a planted window [m] are brought back before it is balanced, too, which
takes as much time again: where legs do not reach, the balance is to know."""


@dataclass(frozen=True)
class Draft:
    """The steps from a decoder's features to a window, for one history.

    Attributes:
        layout: of the features.
        body: of the human.
        history: the frames before the window.
        remembered: features of the last of them, not normalised, (H, F).
        balanced: whether windows are low-passed and balanced, with forces that belong to their motion.
        rest: a standing human; its last frame counts.
        idle: joints above the legs that nothing is asked of.
        stands: whether standing still is asked: idle joints move to `rest`. In a gesture those near it stay.
        quiet: whether nothing is asked of pelvis and legs: once the human stands they rest.
        on_the_spot: whether what is asked is done there: feet that rest are kept in place by their legs.
        in_place: whether feet that have come to rest stay on the floor.
        fastest: turn of an upper arm that is not too fast [rad/s].
        asked: of the window beside words. Where that is anything of single frames, legs end as they were decoded, and
            where it is of the legs, feet that rest are not kept before balance.
        pose: see `Condition`; None: arms and head move as decoded.
        beside: see `Condition`.
        cutoff: at which balanced windows are low-passed [Hz].
        source: of the motion.
    """

    layout: Layout
    body: Body
    history: Motion
    remembered: Float32
    balanced: bool
    rest: Motion
    idle: frozenset[int]
    stands: bool
    quiet: bool
    on_the_spot: bool
    in_place: bool
    fastest: float
    asked: Constraints | None
    pose: KeptPose | Rhythm | None
    beside: Beside | None
    cutoff: float
    source: str

    @cached_property
    def anchor(self) -> Anchor:
        """The frame before the window."""
        return Anchor.after(self.history)

    def joined(self, found: Float32) -> Float32:
        """Decoded features that continue the history, (W, F).

        Those of balanced windows are low-passed, and legs of a body that travels end at their ankles' places there,
        where nothing is asked of frames.
        """
        features = inertialised(found, self.remembered, self.layout)
        features = unhurried(features, self.remembered, self.layout, self.fastest)
        if not self.balanced:
            return features
        features = steadied(features, self.remembered, self.layout, self.cutoff)
        return placed(features, self.layout, self.body) if self._free and not self.on_the_spot else features

    def planted(self, features: Float32) -> tuple[Motion, Slip | None]:
        """Motion with its loaded feet in place, forces as decoded; and how the feet slipped before."""
        decoded = decode(features, self.layout, self.body, self.anchor, source=self.source)
        if self._on_both_feet and decoded.contacts is not None:
            decoded = decoded.changed(contacts=np.ones_like(decoded.contacts))
        if self.still is not None:
            motion, slip = self._standing(decoded, self.still), None
        else:
            stays = self._keeps_feet and self._stays(self._way(decoded), len(decoded))
            motion, slip = planted_slip(decoded, self._feet_before, self.anchor.joints if stays else None)
        if self.idle:
            rest = self.rest.joints[-1]
            motion = at_rest(motion, self.history, rest, self.idle, stays=self._in_gesture)
        for own in (self.pose, self.beside):
            motion = motion if own is None else own.kept(motion, self.history)
        return motion, slip

    def _standing(self, motion: Motion, still: StillStance) -> Motion:
        """A window of a human that stands still; a pelvis that leans comes upright."""
        upright = still.leans > (SWAYING if self._in_gesture else UPRIGHT)
        found = still.kept(motion, upright=upright)
        if still.rests and not upright:
            return found
        # Legs keep the feet on the floor, below a pelvis that turns.
        nothing = Constraints.none(self.layout, self.body, len(found))
        return closed(found, self.anchor, standing_on(still.places(len(found)), nothing, self.anchor), (LEG,))

    def sketched(self, features: Float32) -> tuple[WindowPose, Holding]:
        """Kinematics of the planted window without its motion, and how its feet are held, in the frame of the window.

        It takes half of the time; legs are as they were decoded.
        """
        pose = WindowPose.of_features(features, self.layout, self.body)
        feet = np.concatenate([self.anchor.local(self._feet_before), pose.feet])
        contacts = (features[:, self.layout.blocks["contacts"]] > 0.5) | self._on_both_feet
        way = float(np.hypot(*pose.position[-1, PELVIS, :2]))
        stays = self._keeps_feet and self._stays(way, len(features))
        holding = Slip.of(feet, contacts, pose.rotation[:, PELVIS], self.layout.fps, stays).holding
        lift = lifted(pose.feet[..., 2].min(axis=2), contacts, self.layout.fps)
        return pose.moved(np.column_stack([-holding.shift(feet), lift])), holding

    @cached_property
    def still(self) -> StillStance | None:
        """The stance in which pelvis and legs stay; None: they move as decoded."""
        return StillStance.of(self.history, self.rest) if self.quiet else None

    @cached_property
    def _on_both_feet(self) -> bool:
        """Whether both feet have come to rest, and stay so: a model that bows takes a step in one bow of four."""
        feet = self._feet_arriving
        low = feet[-1, ..., 2].min(axis=1).max() < LIFTED
        return bool(self.in_place and low and np.ptp(feet[..., :2], axis=0).max() < STOOD)

    @property
    def _in_gesture(self) -> bool:
        """Whether a gesture is made, standing: what it leaves alone stays as it is."""
        return not self.stands or self.pose is not None

    @cached_property
    def _feet_before(self) -> Float:
        """Heel and toe of both feet in the last known frame, in the world, (1, 2, 2, 3) [m]."""
        return self._feet_arriving[-1:] if self.still is None else self.still.feet[None]

    @cached_property
    def _feet_arriving(self) -> Float:
        """Heel and toe of both feet in the last known frames, in the world, (at most ARRIVING, 2, 2, 3) [m]."""
        return foot_points(self.history[max(0, len(self.history) - ARRIVING) :])

    def delivered(
        self, motion: Motion, found: Float32, constraints: Constraints | None = None, *, closes: bool = True
    ) -> Delivered:
        """A planted window as it is handed on.

        Args:
            motion: planted.
            found: features that it was decoded from, before they were joined to the history.
            constraints: what is asked of its limbs is kept by them, as far as they reach; contact forces that are asked
                take the place of the decoder's, as far as the motion allows; so do activations that are asked.
            closes: whether its limbs do that; else the window is balanced as if they did, and shows what is missing.
        """
        if not self.balanced:
            kept = constraints if closes else None
            window = motion if kept is None else closed(motion, self.anchor, kept)
            made = Delivered(self.history[max(0, len(self.history) - EDGE) :], window)
        else:
            planned = self._accelerations(found) if self.still is None else np.zeros((len(found), 3))
            made = self._in_balance(motion, planned, constraints, closes=closes)
        return made if constraints is None else replace(made, window=_with_muscles(made.window, constraints))

    def _in_balance(
        self, motion: Motion, accelerations: Float, constraints: Constraints | None, *, closes: bool
    ) -> Delivered:
        """See `delivered`; feet that rest stay where they are, and those of a walk on their paths."""
        resting = self._resting(motion)
        if resting is None and self._walks(motion):
            return self._walking(motion, accelerations)
        if resting is not None:
            assert motion.contacts is not None
            # A body that stood on both feet and was said to stand on one would fall away from it.
            motion = motion.changed(contacts=motion.contacts | resting.stands)
        stays, in_place = None, False
        if constraints is not None:
            reaching = closed(motion, self.anchor, constraints, (LEG,))
            stays = staying(reaching, self.anchor, constraints)
            # Forces are shared between the feet as asked before what the motion lacks of them is seen.
            motion = _with_forces(reaching if closes else motion, constraints, self.anchor)
        if resting is not None:
            nothing = Constraints.none(self.layout, self.body, len(motion))
            resting = resting if constraints is None else resting.beside(constraints)
            in_place = constraints is None and np.abs(resting.away).max() < IN_PLACE
            if np.abs(resting.away).max() > FAR:
                motion = closed(motion, self.anchor, resting.asked(nothing, self.anchor), (LEG,))
                resting = resting.reached(foot_points(motion))

        def finish(window: Motion, segments: SegmentMotion) -> Motion:
            moved = np.abs(window.root_position - motion.root_position).max()
            if in_place and moved < IN_PLACE:
                return window
            kept = constraints if closes else None
            if resting is not None:
                kept = resting.asked(nothing if kept is None else kept, self.anchor)
            return window if kept is None else closed(window, self.anchor, kept, segments=segments)

        weights, raises = BALANCE if self.still is None else STILL, resting is None and self._keeps_feet
        return delivered(
            motion, self.history, accelerations, finish, stays, resting, self.cutoff, settings=weights, raises=raises
        )

    def _walking(self, motion: Motion, accelerations: Float) -> Delivered:
        """A planted window of a walk as it is handed on; its feet keep their paths under the body."""

        def finish(window: Motion, segments: SegmentMotion) -> Motion:
            back = motion.root_position - window.root_position
            back *= np.minimum(1.0, HELD / np.maximum(np.linalg.norm(back, axis=1, keepdims=True), 1e-9))
            back = np.repeat(back[:, None], len(SIDES), axis=1)
            return smoothly_shifted(window, back, self.anchor.joints)

        stays = np.ones((len(motion), len(SIDES)), np.bool_)
        return delivered(
            motion, self.history, accelerations, finish, stays, cutoff=self.cutoff, walks=True, stops=self.on_the_spot
        )

    def _resting(self, motion: Motion) -> RestingFeet | None:
        """Feet of a planted window that rest; None where it does not stand, or its forces are not known."""
        if motion.wrenches is None or motion.contacts is None or not self._stays(self._way(motion), len(motion)):
            return None
        feet = np.concatenate([self._feet_before, foot_points(motion)])
        return RestingFeet.of(feet, motion.contacts, self.layout.fps)

    def _walks(self, motion: Motion) -> bool:
        """Whether the body walks, and nothing is asked of single frames.

        Runs are balanced with their feet: their legs would be held to the end of their reach.
        """
        if motion.wrenches is None or motion.contacts is None or self.still is not None:
            return False
        if not self._free or self._glides:
            return False
        goes = self._way(motion) * motion.fps / len(motion)
        return max(self._arrived, goes) < RUNS and abs(self._arrived - goes) < BRAKES

    @cached_property
    def _glides(self) -> bool:
        """Whether the feet slide on as the body comes into the window: after a run that is to stop, no leg holds it."""
        speed = np.linalg.norm(np.diff(self._feet_arriving[..., :2], axis=0), axis=-1) * self.history.fps
        return bool(len(speed) and speed.min(axis=(1, 2)).mean() > GLIDES)

    def _way(self, motion: Motion) -> float:
        """How far the body goes from the frame before the window to its end, along the floor [m]."""
        return float(np.hypot(*(motion.root_position[-1, :2] - self.anchor.place)))

    def _stays(self, way: float, frames: int) -> bool:
        """Whether a body that goes so far [m] in so many frames stays where it is."""
        return self.on_the_spot and max(self._arrived, way * self.layout.fps / frames) <= WALKS

    @property
    def _free(self) -> bool:
        """Whether nothing is asked of single frames: corrections of the latent know legs as they are decoded."""
        return self.asked is None or not self.asked.of_frames

    @property
    def _keeps_feet(self) -> bool:
        return self.asked is None or not self.asked.of_legs

    @cached_property
    def _arrived(self) -> float:
        """Speed at which the body comes into the window [m/s]."""
        return self.history[max(0, len(self.history) - ARRIVING) :].net_speed

    def _accelerations(self, found: Float32) -> Float:
        """Second derivative of the root's path before it was joined to the history, (W, 3) [m/s²]."""
        path, _ = root_path(found, self.layout, self.body, self.anchor)
        middle = np.diff(path, n=2, axis=0) * self.layout.fps**2
        return np.concatenate([middle[:1], middle, middle[-1:]]) if len(middle) else np.zeros_like(path)


def _with_forces(motion: Motion, constraints: Constraints, anchor: Anchor) -> Motion:
    """The motion with ground forces, centres of pressure and contacts as asked, in place of the predicted ones."""
    blocks, body = constraints.layout.blocks, motion.body
    asked = constraints.mask[:, blocks[FORCES].start : blocks[CENTRES].stop]
    if motion.wrenches is None or motion.pressure_centres is None or not asked.any():
        return motion
    yaw, frames = np.full(len(motion), anchor.yaw), len(motion)
    wrenches, centres = motion.wrenches.copy(), motion.pressure_centres.copy()
    # Components that are free keep their predicted values in the axes of the window.
    own = turned(wrenches[..., :3], -yaw)
    force = constraints.values[:, blocks[FORCES]].reshape(frames, 2, 3) * (body.mass * GRAVITY)
    mask = constraints.mask[:, blocks[FORCES]].reshape(frames, 2, 3)
    wrenches[..., :3] = turned(np.where(mask, force, own), yaw)
    # A foot that is asked to bear stands, and one that is not does not.
    contacts = np.ones((frames, 2), np.bool_) if motion.contacts is None else motion.contacts
    contacts = np.where(mask[..., 2], force[..., 2] > CONTACT_SHARE * body.mass * GRAVITY, contacts)
    place = turned(centres - np.append(anchor.place, 0.0), -yaw)
    centre = constraints.values[:, blocks[CENTRES]].reshape(frames, 2, 2) * body.leg
    mask = constraints.mask[:, blocks[CENTRES]].reshape(frames, 2, 2)
    place[..., :2] = np.where(mask, centre, place[..., :2])
    centres = turned(place, yaw) + np.append(anchor.place, 0.0)
    return motion.changed(wrenches=wrenches, pressure_centres=centres, contacts=contacts)


def _with_muscles(motion: Motion, constraints: Constraints) -> Motion:
    """The motion with the activations that are asked."""
    columns = constraints.layout.blocks.get(ACTIVATIONS)
    if columns is None or not constraints.mask[:, columns].any():
        return motion
    return with_muscles(motion, constraints.values[:, columns], constraints.mask[:, columns])
