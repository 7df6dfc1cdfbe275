"""`Constraints`: what is asked of one window beside words: places, rotations, path, torques, forces, its mean path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmotion.configs.errors import SamplingError
from flexmotion.features.constraint_layout import (
    CENTRES,
    FORCES,
    LEG_POINTS,
    LEG_ROTATIONS,
    LEG_TORQUES,
    PATH,
    PLACES,
    ROTATIONS,
    TORQUE_LIMITS,
    TORQUES,
    ConstraintLayout,
)
from flexmotion.features.joint_groups import BALLS, HINGES, PELVIS_SIZE, ball_matrices, six
from flexmotion.features.layout import ACTIVATIONS, POINTS, Layout
from flexmotion.human.body import Body
from flexmotion.human.skeleton import JOINTS, SIDES
from flexmotion.spatial.gravity import GRAVITY

Float = NDArray[np.float64]
Frames = int | slice | Sequence[int]


END = 0.75
"""Share of a window over which means are asked, at its end. A window begins where the last one ended: a mean over all
of it is met by going as far beyond as it began before, window after window. Of half of it a pelvis that turns with each
step is off by 5°. Walks of 60 s: 3.0° over half, 1.8 over three quarters, 2.5° with more weight on later frames."""


FASTEST = 6.0
"""No place is farther from where the window begins than the body's height and the way at this speed [m/s]."""


def end_mean(values: NDArray[Any]) -> NDArray[Any]:
    """Means over the last `END` of W frames, (W, ...) -> (...)."""
    return np.asarray(values[len(values) - round(END * len(values)) :].mean(axis=0))


_HEADING = (0.0, 0.0, 0.0, 1.0)
"""Weights of the heading among the columns of `PATH`."""


@dataclass(frozen=True)
class PathMean:
    """What `end_mean` is to be of the path of a window.

    Attributes:
        weights: of the columns of the block `PATH`, (4,).
        value: of their sum, in the units of the layout.
    """

    weights: tuple[float, float, float, float]
    value: float


@dataclass(frozen=True, eq=False)
class Constraints:
    """Values that are asked of a window, and where; made by adding to `Constraints.none`.

    Places are in the frame of the window: on the floor below the pelvis of the last known frame, x along its heading, z
    up (`Anchor.local` brings places of the world there). Every method gives new constraints with more asked.

    Attributes:
        layout: of the columns.
        body: of the human, for units.
        values: in the units of the layout, (W, C).
        mask: whether a value is asked, (W, C).
        means: that are asked of the path, beside the values of frames.
    """

    layout: ConstraintLayout
    body: Body
    values: Float
    mask: NDArray[np.bool_]
    means: tuple[PathMean, ...] = ()

    @classmethod
    def none(cls, layout: Layout, body: Body, frames: int) -> Constraints:
        """Nothing is asked of a window.

        Args:
            layout: of the model's features (`Sampler.layout`).
            body: of the human (`Sampler.body`).
            frames: of a window (`Sampler.future`), W.
        """
        columns = ConstraintLayout(layout)
        shape = (frames, columns.size)
        return cls(columns, body, np.zeros(shape), np.zeros(shape, np.bool_))

    @property
    def asked(self) -> bool:
        """Whether anything is."""
        return self.of_frames or bool(self.means)

    @property
    def of_frames(self) -> bool:
        """Whether anything is asked of single frames."""
        return bool(self.mask.any())

    @property
    def turn(self) -> float:
        """The mean heading that is asked for [rad], positive to the left; 0 where none is."""
        return next((float(mean.value) for mean in self.means if mean.weights == _HEADING), 0.0)

    @property
    def of_legs(self) -> bool:
        """Whether a path, ground forces, or places, angles or torques of legs, are asked of single frames."""
        of = {name: self.mask[:, cut] for name, cut in self.layout.blocks.items()}
        places = of[PLACES].reshape(len(self.mask), -1, 3)[:, LEG_POINTS]
        torques = of[TORQUES][:, LEG_TORQUES], of[TORQUE_LIMITS][:, LEG_TORQUES]
        asked = (of[PATH], of[FORCES], of[CENTRES], places, of[ROTATIONS][:, LEG_ROTATIONS], *torques)
        return any(bool(mask.any()) for mask in asked)

    def place(self, point: str, frames: Frames, place: ArrayLike) -> Constraints:
        """A point of the body is at a place.

        Args:
            point: of `layout.POINTS`, such as `hand_r`.
            frames: of the window, from 0.
            place: (3,), or one for each frame, (K, 3) [m]; NaN for a coordinate that is free.

        Raises:
            SamplingError: unknown point, another shape, or a place that the body does not reach by then.
        """
        first = self.layout.blocks[PLACES].start + 3 * _index(point, POINTS, "point")
        given = np.asarray(place, float)
        self._require_near(point, frames, given)
        return self._with(slice(first, first + 3), frames, given / self.body.leg)

    def places(self, points: Sequence[str], told: NDArray[np.bool_], places: Float) -> Constraints:
        """Points of the body are at places in some frames each: what `place` of one after the other asks, in one go.

        Args:
            points: P of `layout.POINTS`.
            told: frames of the window in which each one is, (W, P).
            places: of all frames, those of others do not count, (W, P, 3) [m].

        Raises:
            SamplingError: unknown point, or a place that the body does not reach by then.
        """
        numbers = [_index(point, POINTS, "point") for point in points]
        away = np.where(told, np.sqrt(np.einsum("tpi,tpi->tp", places, places)), 0.0).max(axis=0)
        last = np.where(told, np.arange(1, len(told) + 1)[:, None], 0).max(axis=0)
        for point, one, frames in zip(points, away.tolist(), last.tolist(), strict=True):
            self._require_reached(point, one, frames)
        cut, shape = self.layout.blocks[PLACES], (len(told), len(POINTS), 3)
        values, mask = self.values.copy(), self.mask.copy()
        own, asked = values[:, cut].reshape(shape), mask[:, cut].reshape(shape)
        own[:, numbers] = np.where(told[..., None], places / self.body.leg, own[:, numbers])
        asked[:, numbers] |= told[..., None]
        values[:, cut], mask[:, cut] = own.reshape(len(told), -1), asked.reshape(len(told), -1)
        return replace(self, values=values, mask=mask)

    def path(self, frames: Frames, place: ArrayLike | None = None, heading: ArrayLike | None = None) -> Constraints:
        """The pelvis is above a place of the floor, or heads somewhere.

        Args:
            frames: of the window, from 0.
            place: forward and left, (2,) or (K, 2) [m]; None where it is free.
            heading: (,) or (K,) [rad], positive to the left; None where it is free.

        Raises:
            SamplingError: another shape, or a place that the body does not reach by then.
        """
        first, found = self.layout.blocks[PATH].start, self
        if place is not None:
            given = np.asarray(place, float)
            self._require_near("path", frames, given)
            found = found._with(slice(first, first + 2), frames, given / self.body.leg)
        if heading is not None:
            found = found._with(slice(first + 3, first + 4), frames, np.asarray(heading, float)[..., None])
        return found

    def mean_heading(self, heading: float) -> Constraints:
        """At the end of the window (`end_mean`) the pelvis heads somewhere on average [rad], positive to the left.

        How it turns about that is the model's; asked of single frames, a heading takes away the turning of each step.

        Raises:
            SamplingError: it is not finite.
        """
        _require_finite("mean heading", heading)
        return replace(self, means=(*self.means, PathMean(_HEADING, heading)))

    def mean_place(self, place: ArrayLike, direction: float | None = None) -> Constraints:
        """At the end of the window (`end_mean`) the pelvis is on average above a place of the floor, or on a line.

        Args:
            place: forward and left, (2,) [m].
            direction: of a line through the place [rad], positive to the left; None: at the place.

        Raises:
            SamplingError: another shape, or a value that is not finite.
        """
        given = np.asarray(place, float)
        if given.shape != (2,):
            raise SamplingError(f"place has shape {given.shape}, expected (2,)")
        _require_finite("mean place", *given, 0.0 if direction is None else direction)
        axes = ((1.0, 0.0), (0.0, 1.0)) if direction is None else ((-sin(direction), cos(direction)),)
        found = (PathMean((x, y, 0.0, 0.0), (x * given[0] + y * given[1]) / self.body.leg) for x, y in axes)
        return replace(self, means=(*self.means, *found))

    def height(self, frames: Frames, height: ArrayLike) -> Constraints:
        """The pelvis is at a height above the floor, (,) or (K,) [m].

        Raises:
            SamplingError: another shape, or a height that the body does not reach by then.
        """
        first, given = self.layout.blocks[PATH].start + 2, np.asarray(height, float)[..., None]
        self._require_near("height", frames, given)
        return self._with(slice(first, first + 1), frames, given / self.body.leg)

    def angles(self, joint: str, frames: Frames, angles: ArrayLike) -> Constraints:
        """A joint has an angle, or three.

        Args:
            joint: a single hinge by its name (`knee_flexion_l`), or a joint of three coordinates by its first part
                (`hip_l`, `shoulder_r`, `lumbar`, `neck`).
            frames: of the window, from 0.
            angles: of a hinge (,) or (K,), of three coordinates in the order of `skeleton.JOINTS` (3,) or (K, 3) [rad].

        Raises:
            SamplingError: unknown joint, or another shape.
        """
        start = self.layout.blocks[ROTATIONS].start + PELVIS_SIZE
        if joint in HINGES:
            column = start + 6 * len(BALLS) + HINGES.index(joint)
            return self._with(slice(column, column + 1), frames, np.asarray(angles, float)[..., None])
        names = [_ball_name(ball) for ball in BALLS]
        number = _index(joint, (*names, *HINGES), "joint")
        given = np.asarray(angles, float)
        if given.shape[-1:] != (3,):
            raise SamplingError(f"{joint}: angles have shape {given.shape}, expected (3,) or (K, 3)")
        joints = np.zeros((*given.shape[:-1], len(JOINTS)))
        joints[..., [JOINTS.index(name) for name in BALLS[number]]] = given
        first = start + 6 * number
        return self._with(slice(first, first + 6), frames, six(ball_matrices(joints)[..., number, :, :]))

    def torque(self, joint: str, frames: Frames, torque: ArrayLike) -> Constraints:
        """A joint has a torque, (,) or (K,) [N·m].

        Raises:
            SamplingError: unknown joint, or another shape.
        """
        return self._torques(TORQUES, joint, frames, torque)

    def torque_limit(self, joint: str, frames: Frames, limit: ArrayLike) -> Constraints:
        """A joint's torque is no larger than a limit in either direction, (,) or (K,) [N·m].

        Raises:
            SamplingError: unknown joint, another shape, or a negative limit.
        """
        if np.min(limit) < 0:
            raise SamplingError(f"{joint}: torque limit is {np.min(limit):g} N·m, expected 0 or more")
        return self._torques(TORQUE_LIMITS, joint, frames, limit)

    def contact_force(self, side: str, frames: Frames, force: ArrayLike, place: ArrayLike | None = None) -> Constraints:
        """The ground acts on a foot.

        Args:
            side: `l` or `r`.
            frames: of the window, from 0.
            force: (3,) or (K, 3) [N]; zeros for a foot that bears nothing, NaN for a component that is free.
            place: centre of pressure on the floor, (2,) or (K, 2) [m]; None where it is free.

        Raises:
            SamplingError: unknown side, or another shape.
        """
        number = _index(side, SIDES, "side")
        first = self.layout.blocks[FORCES].start + 3 * number
        weight = self.body.mass * GRAVITY
        found = self._with(slice(first, first + 3), frames, np.asarray(force, float) / weight)
        if place is None:
            return found
        first = self.layout.blocks[CENTRES].start + 2 * number
        return found._with(slice(first, first + 2), frames, np.asarray(place, float) / self.body.leg)

    def activation(self, muscle: int, frames: Frames, activation: ArrayLike) -> Constraints:
        """A muscle is active, (,) or (K,) in [0, 1].

        Raises:
            SamplingError: the model has no such muscle, or another shape.
        """
        muscles = self.layout.layout.muscles
        if not 0 <= muscle < muscles:
            there = f"expected 0 to {muscles - 1}" if muscles else "the model has no muscles"
            raise SamplingError(f"muscle {muscle}: {there}")
        first = self.layout.blocks[ACTIVATIONS].start + muscle
        return self._with(slice(first, first + 1), frames, np.asarray(activation, float)[..., None])

    def _torques(self, block: str, joint: str, frames: Frames, torque: ArrayLike) -> Constraints:
        column = self.layout.blocks[block].start + _index(joint, JOINTS, "joint")
        unit = self.body.mass * GRAVITY * self.body.leg
        return self._with(slice(column, column + 1), frames, np.asarray(torque, float)[..., None] / unit)

    def _chosen(self, frames: Frames) -> NDArray[np.intp]:
        """Numbers of frames of the window, (K,); negative ones are counted from its end, as by NumPy."""
        every = np.arange(len(self.mask))
        expected = f"expected some of 0 to {len(every) - 1}, the frames of a window"
        try:
            chosen = np.atleast_1d(every[frames if isinstance(frames, (int, slice)) else np.asarray(frames, np.intp)])
        except IndexError as error:
            raise SamplingError(f"frames {frames!r}: {expected}") from error
        if isinstance(frames, slice) and not len(chosen):
            raise SamplingError(f"frames {frames!r}: {expected}")
        return chosen

    def _require_near(self, what: str, frames: Frames, place: Float) -> None:
        """Raise `SamplingError` where a place, of coordinates (…, 1 to 3) [m], is farther off than a body gets."""
        away = float(np.sqrt(np.nansum(np.square(place), axis=-1)).max(initial=0.0))
        self._require_reached(what, away, int(self._chosen(frames).max(initial=0)) + 1)

    def _require_reached(self, what: str, away: float, frames: int) -> None:
        """Raise `SamplingError` where a body does not get so far [m] in so many frames."""
        farthest = self.body.height + FASTEST * frames / self.layout.layout.fps
        if not away <= farthest:
            raise SamplingError(
                f"{what}: {away:.3g} m away, expected {farthest:.3g} m at most: the body's height, and {FASTEST:g} m/s"
                " until then"
            )

    def _with(self, columns: slice, frames: Frames, values: Float) -> Constraints:
        """With values in some columns of some frames; NaN: not asked."""
        chosen = self._chosen(frames)
        shape = (len(chosen), columns.stop - columns.start)
        try:
            given = np.broadcast_to(values, shape)
        except ValueError:
            raise SamplingError(f"values have shape {values.shape}, expected {shape} or {shape[1:]}") from None
        if np.isinf(given).any():
            raise SamplingError(f"values of frames {frames!r}: one is infinite, expected numbers, NaN for a free one")
        found, mask = self.values.copy(), self.mask.copy()
        asked = ~np.isnan(given)
        found[chosen, columns] = np.where(asked, given, found[chosen, columns])
        mask[chosen, columns] |= asked
        return replace(self, values=found, mask=mask)


def _require_finite(what: str, *values: float) -> None:
    if not np.isfinite(values).all():
        raise SamplingError(f"{what}: a value is {', '.join(f'{value:g}' for value in values)}, expected finite ones")


def _ball_name(ball: tuple[str, ...]) -> str:
    parts = ball[0].split("_")
    return "_".join([parts[0], *parts[2:]])


def _index(name: str, names: Sequence[str], what: str) -> int:
    if name not in names:
        raise SamplingError(f"{what} {name!r}: expected one of {', '.join(names)}")
    return list(names).index(name)
