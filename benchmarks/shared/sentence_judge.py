"""`Seen`: what a robot did between two ticks by its true motion, and what is wrong with it for a request.

A turn is right within 15° (long ones 12 %), a way within a quarter and 5 cm, footsteps that carry a foot in the
direction (one more may close the stance), seconds within half a second, gestures that leave the stand and come back as
often as was said (`Repetitions`, the planner's definition, of the true motion), looks by the head's true direction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.shared.gaze import LOOKS, gaze_faults, true_gaze
from flexmotion.configs.robot import Robot
from flexmotion.retarget.arms import UpperBody
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.planning.gesture_way import GestureWay
from flexmotion.streamer.planning.repetitions import Repetitions
from flexmotion.text.phrases import STAND
from flexmotion.text.vocabulary import vocabulary

Float = NDArray[np.float64]

_TURN, _TURN_SHARE = np.radians(15.0), 0.12
_WAY_SHARE, _WAY_M = 0.25, 0.05
_TIME_S = 0.5
_STEP_M = 0.015
"""Way that a foot is carried in a step, in its direction [m]."""
_STILL_M, _STILL_RAD = 0.06, np.radians(12.0)
"""Greatest way and turn of a robot that stands."""
_CHANGE = 0.1
"""Least change of speed, as a share."""


class Seen:
    """The true motion of a robot between two ticks."""

    def __init__(self, robot: Robot, record: RunTrace, begin: int, end: int) -> None:
        self.robot, self.rate = robot, record.rate_hz
        rows = record.rows[begin:end]
        base = rows["true_base"]
        yaw = continuous_heading(base[:, 3:])
        step = np.diff(base[:, :2], axis=0)
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        self.ahead = float((np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]).sum())
        self.aside = float((np.cos(middle) * step[:, 1] - np.sin(middle) * step[:, 0]).sum())
        self.turned, self.walked = float(yaw[-1] - yaw[0]), float(np.hypot(*(base[-1] - base[0])[:2]))
        self.seconds = (end - begin) / self.rate
        self._q, self._base = rows["true_q"], base
        self._feet, self._contacts, self._yaw = rows["true_foot"], rows["contact_ref"], yaw

    @property
    def moved(self) -> bool:
        """Whether it did not stand still."""
        return self.walked > _STILL_M or abs(self.turned) > _STILL_RAD

    def text(self) -> str:
        """Its figures in words."""
        way = f"{self.ahead:.2f} m ahead, {self.aside:.2f} m left, {np.degrees(self.turned):.0f}° left"
        return f"{way}, {self.seconds:.1f} s"

    def faults(self, kind: str, amount: str | None) -> list[str]:
        """What is wrong with a request's motion, in words."""
        table = vocabulary().table
        axis, turn = table["walks"].get(kind), table["turns"].get(kind, 0)
        value, unit = (None, None) if amount is None else (float(amount.split()[0]), amount.split()[1])
        wrong = []
        if turn:
            asked = np.radians(value) if unit == "deg" and value is not None else None
            wrong += self._turn_faults(turn, asked)
        elif axis is not None:
            wrong += self._way_faults(axis, value, unit)
        elif kind == STAND:
            still = self.walked <= _STILL_M and abs(self.turned) <= _STILL_RAD
            # Robots come to a stand first.
            wrong += [] if still or self.seconds > 3.0 or value is None else ["did not stand"]
        elif kind in (*LOOKS, "head") and unit != "times":
            wrong += gaze_faults(true_gaze(self.robot, self._base, self._q), kind, self.rate)
        else:
            wrong += self._gesture_faults(kind, value if unit == "times" else None)
        if unit == "s" and value is not None and abs(self.seconds - value) > _TIME_S + (2.0 if kind == STAND else 0.0):
            wrong.append(f"{self.seconds:.1f} s of {value:g} s")
        return wrong

    def _turn_faults(self, turn: int, asked: float | None) -> list[str]:
        turned = turn * self.turned
        if asked is None:
            return [] if turned > np.radians(30.0) else [f"turned {np.degrees(turned):.0f}°"]
        near = abs(turned - asked) <= max(_TURN, _TURN_SHARE * asked)
        return [] if near else [f"turned {np.degrees(turned):.0f}° of {np.degrees(asked):.0f}°"]

    def _way_faults(self, axis: Sequence[int], value: float | None, unit: str | None) -> list[str]:
        went = axis[0] * self.ahead + axis[1] * self.aside
        if unit == "m" and value is not None:
            near = abs(went - value) <= _WAY_SHARE * value + _WAY_M
            return [] if near else [f"went {went:.2f} m of {value:g} m"]
        if unit == "steps" and value is not None:
            steps = self.steps(axis)
            # A step sideways, and a single one, is one of each foot.
            fewest = 2 * value if axis[1] else value
            wrong = [] if fewest <= steps <= fewest + 1 else [f"{steps} footsteps for {value:g} steps"]
            return wrong + ([] if went > 0.01 else [f"went {went:.2f} m"])
        return [] if went > 0.02 else [f"went {went:.2f} m"]

    def steps(self, axis: Sequence[int]) -> int:
        """Footsteps that carried a foot in a direction of the torso."""
        count = 0
        for side in (0, 1):
            contact, foot = self._contacts[:, side].astype(bool), self._feet[:, side, :2]
            lifts = np.flatnonzero(contact[:-1] & ~contact[1:])
            lands = np.flatnonzero(~contact[:-1] & contact[1:])
            for lift in lifts:
                after = lands[lands > lift]
                if not len(after):
                    continue
                dx, dy = foot[after[0] + 1] - foot[lift]
                yaw = self._yaw[lift]
                ahead, aside = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
                count += int(axis[0] * ahead + axis[1] * aside > _STEP_M)
        return count

    def gestures(self, kind: str) -> Repetitions:
        """How often it made a kind of gesture."""
        made, measure = Repetitions(), GestureWay(self.robot, UpperBody(self.robot))
        tilt = Rotation.from_quat(self._base[:, 3:], scalar_first=True).as_euler("ZYX")[:, [2, 1]]
        for way in measure(kind, self._q, tilt, self._q[0]):
            made.update(float(way))
        return made

    def _gesture_faults(self, kind: str, times: float | None) -> list[str]:
        made = self.gestures(kind)
        if times is None:
            return [] if made.begun else ["nothing of it was seen"]
        wrong = [] if made.begun == times else [f"{made.begun} of {times:g} times"]
        return wrong + (["did not come back"] if made.away else [])


def speed_fault(record: RunTrace, begin: int, end: int, change: str) -> list[str]:
    """Compare the mean speed before a sentence with that after it."""
    ticks = int(3.0 * record.rate_hz)
    base = record.true_base[:, :2]
    before = float(np.hypot(*(base[begin] - base[begin - ticks])))
    after = float(np.hypot(*(base[end - 1] - base[end - 1 - ticks])))
    ratio = after / max(before, 1e-6)
    right = ratio > 1.0 + _CHANGE if change == "up" else ratio < 1.0 - _CHANGE
    return [] if right else [f"speed times {ratio:.2f}"]
