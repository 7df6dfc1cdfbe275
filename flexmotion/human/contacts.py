"""Foot contacts from kinematics or forces, frame by frame; causal, so that they can be detected on a stream."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import repeat

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
        state = self.initial() if state is None else state
        points = np.stack([human.heel, human.toe], axis=2).reshape(len(human), POINTS, 3)
        before = np.concatenate([state[POSITION].reshape(1, POINTS, 3), points])
        dt = 1.0 / fps
        speeds = np.linalg.norm(np.diff(before, axis=0), axis=-1) / dt
        if len(speeds) and state[STARTED] < 0.5:
            # There is no speed yet.
            speeds[0] = 0.0
        states = np.empty((len(human), STATE_SIZE))
        states[:, POSITION], states[:, STARTED] = points.reshape(-1, 12), 1.0
        self._track(states, state, points[:, :, 2], speeds, force, dt)
        return states[:, FEET] > 0.5, states

    def _track(
        self, states: Float, state: Float, heights: Float, speeds: Float, force: Float | None, dt: float
    ) -> None:
        """Fill in floors, touching points and loaded feet of all frames.

        On single numbers: each frame depends on the one before, and arrays of two and four take ten times as long.
        """
        floor, touching = state[FLOOR].tolist(), (state[TOUCHING] > 0.5).tolist()
        loaded, pending = (state[FEET] > 0.5).tolist(), state[PENDING].tolist()
        guess = state[STARTED] < 0.5
        share = min(dt / self.floor_time, 1.0)
        forces = repeat(None) if force is None else force.tolist()
        frames = zip(heights.tolist(), speeds.tolist(), forces, strict=False)
        for frame, (height, speed, pushes) in enumerate(frames):
            for point in range(POINTS):
                above, fast = height[point] - floor[point], speed[point]
                low, slow = (self.high, self.fast) if touching[point] else (self.low, self.slow)
                touching[point] = above < low and fast < slow
                if touching[point] and fast < self.still:
                    floor[point] += above * share
            for foot in (0, 1):
                heel, toe = 2 * foot, 2 * foot + 1
                if pushes is None or not self.least <= pushes[0] + pushes[1] <= self.most:
                    wanted = touching[heel] or touching[toe]
                else:
                    swings = min(speed[heel], speed[toe]) >= self.fast
                    wanted = pushes[foot] > (self.relieved if loaded[foot] else self.bears) and not swings
                if guess:
                    # Without a speed this is a guess: the next frame may overrule it at once.
                    loaded[foot], pending[foot] = wanted, math.inf
                    continue
                pending[foot] = 0.0 if wanted == loaded[foot] else pending[foot] + dt
                if pending[foot] > (self.lift_time if loaded[foot] else self.load_time):
                    loaded[foot], pending[foot] = wanted, 0.0
            guess = False
            states[frame, FLOOR], states[frame, TOUCHING] = floor, touching
            states[frame, FEET], states[frame, PENDING] = loaded, pending
