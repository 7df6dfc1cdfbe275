"""`AtUse`: how far the human whom a mirroring robot follows is from what the person does at that moment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmotion.human.motion import Motion
from flexmotion.streamer.control.tick_row import TickRow
from flexmotion.streamer.motion.human_channel import POINTS, Human, points_of
from flexmotion.streamer.run.session import Session

Float = NDArray[np.float64]

HANDS = [POINTS.index(f"{side}_hand") for side in ("left", "right")]
FEET = [POINTS.index(f"{side}_{name}") for side in ("left", "right") for name in ("ankle", "toe")]
_HIPS = [POINTS.index(f"{side}_hip") for side in ("left", "right")]
_KEPT = 8


class AtUse:
    """Compares tick by tick, relative to the hips and in their heading: the person may stand elsewhere.

    Args:
        motion: of the person, as it was sent.
        begin_s: when its first frame was sent, on the robot's clock [s].

    Attributes:
        hands, feet: mean distance at each tick at which the person was followed [m].
    """

    def __init__(self, motion: Motion, begin_s: float) -> None:
        self.hands: list[float] = []
        self.feet: list[float] = []
        self._points, self._fps, self._begin_s = points_of(motion).astype(float), motion.fps, begin_s
        self._plans: dict[int, Human] = {}

    def watch(self, session: Session) -> None:
        """Compare the newest tick; to be called before each one."""
        session.humans.watch()
        newest, latest = session.humans.newest(), session.telemetry.ticks.latest()
        if newest is not None:
            self._plans[newest.plan] = newest
            self._plans = dict(list(self._plans.items())[-_KEPT:])
        if latest is None:
            return
        row = TickRow(latest)
        place = (int(row.tick) / session.robot.rate_hz - self._begin_s) * self._fps
        # The source's time is below 0 while the robot goes to the first pose.
        if int(row.plan) not in self._plans or not row.source_s >= 0.0 or not 0.0 <= place < len(self._points) - 1:
            return
        played = self._plans[int(row.plan)].at(float(row.source_s))
        if played is None:
            return
        before, share = int(place), place % 1.0
        true = (1.0 - share) * self._points[before] + share * self._points[before + 1]
        error = np.linalg.norm(_own(played.astype(float)) - _own(true), axis=1)
        self.hands.append(float(error[HANDS].mean()))
        self.feet.append(float(error[FEET].mean()))


def _own(points: Float) -> Float:
    """Points relative to the pelvis, the line of the hips along y, (P, 3)."""
    left = points[_HIPS[0]] - points[_HIPS[1]]
    yaw = np.arctan2(-left[0], left[1])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    moved = points - points[0]
    return np.stack(
        [cosine * moved[:, 0] + sine * moved[:, 1], cosine * moved[:, 1] - sine * moved[:, 0], moved[:, 2]], axis=1
    )
