"""`SwingCheck`: gives the steps of a plan the time that their swings need over the hips' own path in that plan.

The table of shortest swings (`swing.py`) assumes a steady walk: the hips pass over the standing foot in the middle of a
swing. Where a robot begins to walk, changes its direction or stops, a foot may begin or end far from the hips with a
nearly straight knee, and needs more time for the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.retarget.schedule import Schedule
from flexmotion.retarget.state import RetargetState
from flexmotion.retarget.steps import Step, settled_from
from flexmotion.retarget.swing import Swings
from flexmotion.retarget.swing_effort import SwingEffort

Float = NDArray[np.float64]

_ALLOWED, _ALLOWED_SETTLED, _AIM = 1.0, 1.1, 0.95
"""What a swing may ask of the servos, over what they give with their margin: before it is settled, and once it is.
Beyond that it is given the time with which it asks for the third. Legs lagged by 1.8° (median; p90 3°) where a swing
asked for .85 to .95, by 3.5° (5°) up to 1.0, by 4.9° (9°) up to 1.03 (276 swings of changing clips)."""
_MOST_LONGER = 1.6
"""Most time of a swing, over what it would have by its travel alone."""
_MOST_SHARE = 4.0
"""What a swing asks counts up to here: one out of the leg's reach is infinite."""
_NEXT_PLAN = 1.6
"""The next plan begins within so many times the time between plans: it takes time to be made."""


@dataclass(frozen=True)
class Sway:
    """Where the torso of a plan goes.

    Attributes:
        ticks: loop tick of each row, (T,).
        schedule: of the feet.
        com: centre of mass, (T, 2) [m]; com_velocity: (T, 2) [m/s].
        reach: greatest height of the hips at which both legs reach their feet, (T,) [m].
    """

    ticks: Float
    schedule: Schedule
    com: Float
    com_velocity: Float
    reach: Float


class SwingCheck:
    """Checks swings of one robot.

    Args:
        swings: paths of its feet.
        effort: what swings ask of its servos.
        omega: natural frequency of the filter of its hips' height [1/s].
        pause: ticks from a touch-down to the lift of the other foot, at least.
        rate_hz: loop ticks a second.
        replan_s: time between two plans [s].
    """

    def __init__(
        self,
        swings: Swings,
        effort: SwingEffort,
        omega: float,
        pause: int,
        rate_hz: float,
        replan_s: float,
    ) -> None:
        self.swings, self.effort = swings, effort
        self.omega, self.pause, self.rate = omega, pause, rate_hz
        self._next_plan = _NEXT_PLAN * replan_s * rate_hz

    def lengthen(
        self,
        longer: dict[int, int],
        steps: Sequence[Step],
        settled: int,
        state: RetargetState,
        sway: Sway,
        *,
        last: bool,
    ) -> bool:
        """Add to `longer` the ticks that swings need more, by the place of their step.

        A foot in the air keeps its time, and a settled step the tick of its lift.

        Args:
            longer: what the steps are longer by already.
            steps: of the plan, in order; `settled`: number of the first ones that are settled.
            state: where the plan resumes.
            last: no plan may follow: all steps are seen. Else those that are settled before the next plan.

        Returns:
            Whether any swing needs more time than it has.
        """
        if not steps:
            return False
        now = sway.ticks[0]
        before = np.inf if last else now + self._next_plan
        soon = settled_from(list(steps), self.rate) <= before
        seen = [k for k, step in enumerate(steps) if step.lift > now and soon[k]]
        if not seen:
            return False
        changed = False
        for k, share in zip(seen, self.asked([steps[k] for k in seen], state, sway), strict=True):
            if share <= (_ALLOWED_SETTLED if k < settled else _ALLOWED):
                continue
            step, added = steps[k], longer.get(k, 0)
            ticks = step.land - step.lift
            # What the rotors ask falls with the square of the duration.
            wanted = added + int(np.ceil(ticks * (np.sqrt(min(share, _MOST_SHARE) / _AIM) - 1.0)))
            most = int((_MOST_LONGER - 1.0) * (ticks - added))
            if k + 1 < settled:
                most = min(most, added + steps[k + 1].lift - self.pause - step.land)
            if min(wanted, most) > added:
                longer[k], changed = min(wanted, most), True
        return changed

    def asked(self, steps: Sequence[Step], state: RetargetState, sway: Sway) -> Float:
        """What steps ask of their swing legs, over what the servos give, (S,); infinite where the leg cannot reach.

        Args:
            steps: one or more that lift in this plan.
            state: where the plan resumes.
        """
        phase, ticks = self.effort.phase, sway.ticks
        lift, land = (np.array([getattr(step, name) for step in steps], dtype=float) for name in ("lift", "land"))
        at = lift[:, None] + np.outer(land - lift, phase)
        soles = np.stack([self.swings.path(phase, step.side, step.start, step.target) for step in steps])
        torso = np.empty(soles.shape)
        for axis in (0, 1):
            torso[..., axis] = np.interp(at, ticks, sway.com[:, axis]) - state.com_offset[axis]
        torso[..., 2] = self._height(at - ticks[0], float(state.position[0]), float(state.velocity[0]))
        torso[..., 3] = np.interp(at, ticks, sway.schedule.feet[:, :, 3].mean(axis=1))
        for row, step in enumerate(steps):
            over = (ticks >= step.lift) & (ticks < step.land)
            torso[row, :, 2] = np.minimum(torso[row, :, 2], sway.reach[over].min(initial=np.inf))
        right = np.array([step.side == 1 for step in steps])
        asked = self.effort.asked_over(right, soles, torso, (land - lift) / self.rate)
        most: Float = np.abs(asked).reshape(len(steps), -1).max(axis=1)
        return np.where(np.isnan(most), np.inf, most)

    def _height(self, rows: Float, height: float, rate: float) -> Float:
        """Height of the hips over the ankles after some rows, while they lower to that of a walk [m].

        The critically damped filter of the trunk, without its bounds.
        """
        seconds, walking = rows / self.rate, self.effort.gait.walk_hip_height
        away = height - walking
        found: Float = walking + (away + (rate + self.omega * away) * seconds) * np.exp(-self.omega * seconds)
        return found
