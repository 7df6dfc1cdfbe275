"""Which foot carries load, frame by frame, from kinematics or forces; causal, so that it can run on a stream."""

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
LOADED = slice(20, 22)  # whether each foot is loaded (0 or 1)
PENDING = slice(22, 24)  # for how long its points have said otherwise [s]
STARTED = 24  # whether there was a last frame (0 or 1)
STATE_SIZE = 25


@dataclass(frozen=True)
class ContactDetector:
    """Height and speed of heel and toe joint against thresholds with hysteresis, over a floor that is tracked.

    A point begins to touch the floor when it is low and slow, and ceases to when it is high or fast; a foot is loaded
    while one of its points touches, and changes only after its points have said so for a while. Each point has its own
    floor: recorded floors drift from place to place, and a fitted sole is never quite flat. It follows the point while
    it touches, so a foot that is merely held still in the air does not become a step.

    Where ground forces are known and plausible they decide instead: a foot is loaded once it bears a share of the
    body's weight, and until it bears less than a smaller one, again after a while. Forces that together are next to
    nothing or several body weights are not believed, the points decide that frame: in flight they say the same, and a
    model that predicts nonsense cannot take the floor away. Nor is a foot loaded whose heel and toe both are fast:
    nobody stands on a foot that swings. The points are watched all along.

    Speeds are backward differences: a frame's result depends on nothing after it, and cutting a stream into chunks in
    whatever way changes nothing.

    Attributes:
        low, high: heights above the floor at which touching begins and ends [m].
        slow, fast: speeds at which it begins and ends [m/s].
        still: speed below which a touching point moves the floor [m/s].
        floor_time: time constant of the floor [s].
        bears, relieved: shares of the body's weight at which a foot begins and ceases to be loaded.
        least, most: sums over both feet between which forces are believed [body weights].
        load_time, lift_time: for how long that must be so before a foot counts as loaded, as lifted [s].
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
            state: that of the frame before the chunk, (25,); None begins over a floor at z = 0.
            force: vertical ground force on each foot over the body's weight, (T, 2); None where it is not known.

        Returns:
            Flags of left and right foot, (T, 2), and states, (T, 25).
        """
        state = self.initial() if state is None else state.copy()
        points = np.stack([human.heel, human.toe], axis=2).reshape(len(human), POINTS, 3)
        flags = np.empty((len(human), 2), np.bool_)
        states = np.empty((len(human), STATE_SIZE))
        for frame, point in enumerate(points):
            self._step(state, point, None if force is None else force[frame], 1.0 / fps)
            flags[frame] = state[LOADED] > 0.5
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

        loaded = state[LOADED] > 0.5
        if force is None or not self.least <= force.sum() <= self.most:
            wanted = touching.reshape(2, 2).any(axis=1)
        else:
            swings = speed.reshape(2, 2).min(axis=1) >= self.fast
            wanted = (force > np.where(loaded, self.relieved, self.bears)) & ~swings
        if not started:
            # Without a speed this is a guess: let the next frame overrule it at once.
            state[LOADED] = wanted
            state[PENDING] = np.inf
            return
        pending = np.where(wanted == loaded, 0.0, state[PENDING] + dt)
        patience = np.where(loaded, self.lift_time, self.load_time)
        changed = pending > patience
        state[LOADED] = np.where(changed, wanted, loaded)
        state[PENDING] = np.where(changed, 0.0, pending)
