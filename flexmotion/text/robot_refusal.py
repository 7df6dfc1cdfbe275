"""`robot_refusal`: that a robot was judged not to do a kind of motion, in words."""

from __future__ import annotations

from flexmotion.configs.repertoire import RobotRepertoire
from flexmotion.text.phrases import first_wording


def robot_refusal(robot: RobotRepertoire, kind: str) -> str:
    """Who does not do a kind of motion that the robot does not offer, and what its judge found."""
    return f"robot {robot.robot} cannot {first_wording(kind)} ({robot.figure(kind)})"
