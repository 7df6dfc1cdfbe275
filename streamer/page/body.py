"""`page_robot`: what a page must know of a robot to draw it, once for each page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.sampling.pace import Pace
from flexmotion.streamer.motion.human_channel import POINTS
from flexmotion.streamer.page.geometry import geom_meshes
from flexmotion.streamer.page.pose import Pose

BONES = (
    ("left_hip", "right_hip"),
    ("pelvis", "neck"),
    ("neck", "vertex"),
    ("left_shoulder", "right_shoulder"),
    *(
        (f"{side}_{a}", f"{side}_{b}")
        for side in ("left", "right")
        for a, b in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "heel"),
            ("heel", "toe"),
            ("ankle", "toe"),
            ("shoulder", "elbow"),
            ("elbow", "hand"),
        )
    ),
)
"""Segments of the human; the neck is between the shoulders."""

_USUAL_PACE = Pace(ahead=0.5, back=0.3, aside=0.2, turning=0.5)
"""For a robot whose file says none, in a human's speed [m/s, rad/s]."""


def page_robot(
    robot: Robot, driver: str, pace: Pace | None, clips: Sequence[str] = (), kinds: Sequence[str] = ()
) -> dict[str, Any]:
    """Meshes, names, limits and the stick's range as JSON. Arrays of numbers are base64 of float32 or uint32.

    Args:
        pace: of a human that the robot keeps up with: the full deflection of the stick.
        clips: names of those that targets may name; kinds: of motion that words may ask for.
    """
    pose = Pose(robot)
    pace = pace or _USUAL_PACE
    temperature = min(servo.temperature_limit for servo in robot.servos)
    return {
        "type": "robot",
        "version": 1,
        "name": robot.name,
        "driver": driver,
        "rate_hz": robot.rate_hz,
        "joints": robot.joint_names,
        "bodies": [robot.model.body(i).name for i in range(robot.model.nbody)],
        "height_m": round(2.0 * float(pose.base[2]), 4),
        "meshes": [
            {
                "body": mesh.body,
                "colour": mesh.colour,
                "vertices": _packed(mesh.vertices, np.float32),
                "faces": _packed(mesh.faces, np.uint32),
            }
            for mesh in geom_meshes(robot.model)
        ],
        "soles_m": np.round(2.0 * robot.sole_half_size, 4).tolist(),
        "trunk": int(robot.torso_id),
        "hands": _hands(robot),
        "points": POINTS,
        "bones": BONES,
        "pace": [pace.ahead, pace.back, pace.aside, pace.turning],
        "clips": sorted(clips),
        "kinds": list(kinds),
        "temperature_limit": temperature,
        "temperature_margin": robot.safety.thermal_margin,
        "voltage_min": robot.safety.voltage_min,
    }


def _hands(robot: Robot) -> list[dict[str, Any]]:
    """Body and point of the left and the right hand; empty where the robot file names none."""
    hands = robot.config.hands
    found = [] if hands is None else [hands.left, hands.right]
    return [{"body": int(robot.model.body(hand.body).id), "point": list(hand.point)} for hand in found]


def _packed(values: Any, kind: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()
