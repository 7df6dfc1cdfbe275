"""`Pictures`: the robot as measured and as planned, its feet, its balance and its human, as numbers for a page."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.spatial.heading import heading
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.motion.human_channel import POINTS, HumanChannel
from flexmotion.streamer.page.pose import MeasuredPose, PlannedPose, Pose

Float = NDArray[np.float64]
Row = np.ndarray[Any, Any]

_ASIDE = 0.9
"""The human stands this far to the left of the robot, in heights of the robot."""
_FOLLOWS_NOBODY = (State.OFF, State.READY, State.DAMPED, State.FAULT, State.GET_UP)
_HIPS = (POINTS.index("left_hip"), POINTS.index("right_hip"))
_LEG = tuple(POINTS.index(f"left_{name}") for name in ("hip", "knee", "ankle"))


class Pictures:
    """Makes pictures from the loop's rows.

    A picture is a list of float32, NaN where unknown: time [s]; of each body of the measured and of the planned robot
    position [m] and quaternion w x y z; the human's points [m]; of each sole x, y, z [m], yaw [rad] and whether it
    bears load; zero-moment point as planned and as commanded, divergent component (x, y) [m]; centre of mass [m];
    odometry x, y [m], heading [rad].
    """

    def __init__(self, robot: Robot, humans: HumanChannel | None) -> None:
        self.measured, self.planned = MeasuredPose(robot), PlannedPose(robot)
        self.height = 2.0 * float(self.measured.base[2])
        self._humans = humans
        self._leg = float(WholeBody(robot).leg_length)
        self._human = np.full((len(POINTS), 3), np.nan)

    def of(self, row: Row) -> bytes:
        """The picture of a row."""
        known = self.measured.show(row)
        planned = self.planned.show(row, self.measured)
        place = self.planned.placement
        feet = np.column_stack([place.feet(row["foot_ref"]), row["contact_ref"]])
        parts = (
            [float(row["tick"]) / self.measured.robot.rate_hz],
            _bodies(self.measured, known),
            _bodies(self.planned, planned),
            self._human_of(row),
            feet,
            place.points(row["zmp_ref"]),
            place.points(row["zmp_ref"] + row["zmp_shift"]),
            place.points(row["dcm"]),
            self.measured.com if known else np.full(3, np.nan),
            row["odometry"],
        )
        return np.concatenate([np.ravel(part) for part in parts]).astype("<f4").tobytes()

    def _human_of(self, row: Row) -> Float:
        """The human beside the robot, in the robot's size, place and heading; where it was while the robot stops.

        Nobody is shown once the run with it is over: a robot with a fault, or armed anew, follows nobody.
        """
        if self._humans is None:
            return self._human
        self._humans.watch()
        human = self._humans.newest()
        found = None if human is None or not math.isfinite(row["source_s"]) else human.at(float(row["source_s"]))
        base = self.measured.base
        if found is not None:
            points = found.astype(float)
            hip, knee, ankle = (points[place] for place in _LEG)
            scale = self._leg / float(np.linalg.norm(hip - knee) + np.linalg.norm(knee - ankle))
            self._human = beside(points, scale, float(heading(base[3:])), base, self.height)
        elif int(row["state"]) in _FOLLOWS_NOBODY:
            self._human = np.full_like(self._human, np.nan)
        return self._human


def beside(points: Float, scale: float, yaw: float, base: Float, height: float) -> Float:
    """Points of a human (P, 3) turned to the robot's heading `yaw` [rad], scaled, and put to its left."""
    left, right = points[_HIPS[0]], points[_HIPS[1]]
    across = left - right
    turn = yaw - (math.atan2(across[1], across[0]) - math.pi / 2)
    cos, sin = math.cos(turn), math.sin(turn)
    centre = 0.5 * (left + right)
    away = scale * (points - [centre[0], centre[1], 0.0])
    x = cos * away[:, 0] - sin * away[:, 1] + base[0] - math.sin(yaw) * _ASIDE * height
    y = sin * away[:, 0] + cos * away[:, 1] + base[1] + math.cos(yaw) * _ASIDE * height
    return np.column_stack([x, y, away[:, 2]])


def _bodies(pose: Pose, known: bool) -> Float:
    found = np.column_stack([pose.data.xpos, pose.data.xquat])
    return found if known else np.full_like(found, np.nan)
