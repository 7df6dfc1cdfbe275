"""`ArmBranches`: in which of its configurations an arm follows the human, decided over all frames of a window at once.

An arm reaches about the same directions in several configurations (shoulder pitch half a turn further with the roll
negated, say). The best of a frame by itself changes from frame to frame, and each change swings the whole arm around.
So a few candidates a frame are drawn from all parts of the joint space, and the sequence is chosen that costs least in
directions and in movement beyond what the joints can do in a frame (Viterbi 1967), from the present pose on. The window
ends where the next plan goes on: its last pose costs its distance from the stand pose too, so that an arm does not wind
up to follow the human within the window, and comes back where it has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget import arm_loops
from flexmotion.retarget.arm_chain import ArmChain
from flexmotion.retarget.arm_cost import ArmCost, ArmTargets
from flexmotion.retarget.spread_points import halton

Float = NDArray[np.float64]

_CELLS, _SAMPLES = 16, 64
"""Parts of the joint space, and sampled poses in each. Denser samples change no figure: candidates are refined."""
_CANDIDATES = 8
"""Candidates of a frame: the best sample of each of as many parts. With five, poses with the elbow bent backward left
no room for the configuration of the frames before, and folded arms swung around."""
_REFINEMENTS = 1
"""Gauss-Newton steps of the candidates before they are compared; two change no figure."""
_RATE_HZ = 15.0
"""Frames a second for which configurations are decided; between them joints move evenly."""
_TRAVEL_COST = 4.0
"""Cost of a radian that a joint must move faster than it can, in squared chords of directions times frames at
`_COST_FPS`: swinging an arm around by 3 rad costs as much as both directions being 26 degrees off for a second."""
_WINDING_COST = 3.0
"""Cost of a squared radian away from the stand pose at the end of the window, in squared chords times frames at
`_COST_FPS`: half a turn of two joints costs as much as both directions being 60 degrees off for a second."""
_COST_FPS = 30.0


class ArmBranches:
    """Chooses configurations of both arms of one robot.

    Args:
        chain: the arms.
        cost: of their poses.
        speed: greatest speed of each arm joint, (2, m) [rad/s].
    """

    def __init__(self, chain: ArmChain, cost: ArmCost, speed: Float) -> None:
        self.chain, self.cost, self.speed = chain, cost, speed
        cells = _cells(chain.lower, chain.upper, _CELLS)
        spread = halton(_SAMPLES, chain.lower.shape[1])
        low, high = cells[:, None, 0], cells[:, None, 1]
        # (cells, samples, 2, m)
        self._poses = low + spread[None, :, None, :] * (high - low)
        self._features = cost.features(chain.poses(self._poses.reshape(-1, *chain.lower.shape)))

    def choose(self, targets: ArmTargets, start: Float, fps: float) -> Float:
        """Configurations near the best sequence, (F, 2, m) [rad]: starts for a refinement.

        Args:
            targets: of each frame.
            start: joint angles before the first frame, (2, m) [rad].
            fps: frames a second.
        """
        frames = len(targets.upper)
        every = max(round(fps / _RATE_HZ), 1)
        rows = np.arange(0, frames, every)
        chosen = self._sequence(targets.frames(rows), start, fps / every)
        last = len(rows) - 1
        place = np.minimum(np.arange(frames) / every, last)
        low = np.minimum(place.astype(int), max(last - 1, 0))
        share = (place - low)[:, None, None]
        found: Float = chosen[low] + share * (chosen[np.minimum(low + 1, last)] - chosen[low])
        return found

    def _sequence(self, targets: ArmTargets, start: Float, fps: float) -> Float:
        """The best sequence of candidates; arguments as in `choose`."""
        poses, costs = self._candidates(targets)
        share = _COST_FPS / fps
        return arm_loops.cheapest(
            poses, costs, start, self.speed / fps, _TRAVEL_COST * share, _WINDING_COST / share, self.cost.rest
        )

    def _candidates(self, targets: ArmTargets) -> tuple[Float, Float]:
        """Poses (F, K, 2, m) [rad] and their costs (F, K, 2)."""
        poses = arm_loops.best_samples(self.cost.compare(targets, self._features), self._poses, _CANDIDATES)
        each = poses.reshape(-1, *poses.shape[2:])
        for _ in range(_REFINEMENTS):
            each = self.cost.improved(targets, each)
        return each.reshape(poses.shape), self.cost.of(targets, each).reshape(poses.shape[:-1])


def _cells(lower: Float, upper: Float, count: int) -> Float:
    """Boxes that fill the limits (2, m), halved along their longest edge: (count, lower and upper, 2, m) [rad]."""
    boxes = [np.stack([lower, upper])]
    while len(boxes) < count:
        edges = [(box[1] - box[0])[0] for box in boxes]
        longest = int(np.argmax([edge.max() for edge in edges]))
        joint = int(np.argmax(edges[longest]))
        box = boxes.pop(longest)
        middle = 0.5 * (box[0, :, joint] + box[1, :, joint])
        near, far = box.copy(), box.copy()
        near[1, :, joint], far[0, :, joint] = middle, middle
        boxes += [near, far]
    return np.array(boxes)
