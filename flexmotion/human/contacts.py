"""Foot contacts from kinematics or forces, frame by frame; causal, so that they can be detected on a stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.kinematics import HumanKinematics

Float = NDArray[np.float64]

POINTS = 4
"""Heel and toe joint of the left foot, then of the right one."""

# Layout of the state vector.
POSITION = slice(0, 12)  # of the points in the last frame [m]
FLOOR = slice(12, 16)  # height of the floor under each point [m]
TOUCHING = slice(16, 20)  # whether each point touches it (0 or 1)
FEET = slice(20, 22)  # whether each foot is loaded (0 or 1)
PENDING = slice(22, 24)  # for how long the points of each foot have indicated the opposite [s]
STARTED = 24  # whether there was a last frame (0 or 1)
STATE_SIZE = 25


@dataclass(frozen=True)
class ContactDetector:
    """Height and speed of heel and toe joint against thresholds with hysteresis, over a floor that is tracked.

    A point begins to touch the floor when it is low and slow, and ceases to when it is high or fast. A foot is loaded
    while one of its points touches; the flag changes only after its points have indicated it for some time. Each point
    has its own floor height, because recorded floors drift from place to place and a fitted sole is never quite flat.
    The height follows the point while it touches, so that a foot held still in the air does not become a step.

    Ground forces decide instead, where they are known and plausible: a foot becomes loaded when it bears a share of
    body weight, and unloaded below a smaller share, each after some time. The points decide in frames in which the sum
    of both forces is nearly zero or several body weights: in flight they agree, and implausible predictions of a model
    are ignored. A foot whose heel and toe are both fast is never loaded. The points are tracked in every frame.

    Speeds are backward differences: a result depends on no later frame, and is the same however a stream is cut into
    chunks.

    Attributes:
        low, high: heights above the floor at which touching begins and ends [m].
        slow, fast: speeds at which it begins and ends [m/s].
        still: speed below which a touching point moves the floor [m/s].
        floor_time: time constant of the floor [s].
        bears, relieved: shares of the body's weight at which a foot begins and ceases to be loaded.
        least, most: plausible sum of both forces [body weights].
        load_time, lift_time: time before a foot counts as loaded, as lifted [s].
    """

    low: float = 0.04
    high: float = 0.075
    slow: float = 0.5
    fast: float = 0.9
    still: float = 0.3
    floor_time: float = 0.3
    bears: float = 0.15
    relieved: float = 0.07
    least: float = 0.3
    most: float = 3.0
    load_time: float = 0.05
    lift_time: float = 0.05

    def initial(self, floor: float = 0.0) -> Float:
        """State before the first frame, over a floor of this height [m], (25,)."""
        state = np.zeros(STATE_SIZE)
        state[FLOOR] = floor
        return state

    def detect(
        self, human: HumanKinematics, fps: float, state: Float | None = None, force: Float | None = None
    ) -> tuple[NDArray[np.bool_], Float]:
        """Load flags of a chunk of frames and the state after each of them.

        Args:
            human: kinematics of the chunk, T frames.
            fps: frames per second.
            state: of the frame before the chunk, (25,); None starts over a floor at z = 0.
            force: vertical ground force on each foot over body weight, (T, 2); None where unknown.

        Returns:
            Flags of left and right foot, (T, 2), and states, (T, 25).
        """
        state = self.initial() if state is None else state.copy()
        points = np.stack([human.heel, human.toe], axis=2).reshape(len(human), POINTS, 3)
        flags = np.empty((len(human), 2), np.bool_)
        states = np.empty((len(human), STATE_SIZE))
        for frame, point in enumerate(points):
            self._step(state, point, None if force is None else force[frame], 1.0 / fps)
            flags[frame] = state[FEET] > 0.5
            states[frame] = state
        return flags, states

    def _step(self, state: Float, point: Float, force: Float | None, dt: float) -> None:
        """Advance the state by one frame, in place."""
        started = state[STARTED] > 0.5
        speed = (
            np.linalg.norm(point - state[POSITION].reshape(POINTS, 3), axis=-1) / dt if started else np.zeros(POINTS)
        )
        height = point[:, 2] - state[FLOOR]
        was = state[TOUCHING] > 0.5
        touching = np.where(was, (height < self.high) & (speed < self.fast), (height < self.low) & (speed < self.slow))
        state[TOUCHING] = touching
        resting = touching & (speed < self.still)
        state[FLOOR] += resting * height * min(dt / self.floor_time, 1.0)
        state[POSITION] = point.ravel()
        state[STARTED] = 1.0

        loaded = state[FEET] > 0.5
        if force is None or not self.least <= force.sum() <= self.most:
            wanted = touching.reshape(2, 2).any(axis=1)
        else:
            swings = speed.reshape(2, 2).min(axis=1) >= self.fast
            wanted = (force > np.where(loaded, self.relieved, self.bears)) & ~swings
        if not started:
            # Without a speed this is a guess: the next frame may overrule it at once.
            state[FEET] = wanted
            state[PENDING] = np.inf
            return
        pending = np.where(wanted == loaded, 0.0, state[PENDING] + dt)
        patience = np.where(loaded, self.lift_time, self.load_time)
        changed = pending > patience
        state[FEET] = np.where(changed, wanted, loaded)
        state[PENDING] = np.where(changed, 0.0, pending)
