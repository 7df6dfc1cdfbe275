"""A robot whose servo differs from its catalogue, as `servo identify` must find it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from flexmotion.configs.identification import (
    Identification,
    IdentifiedFigure,
    IdentifiedServo,
    write_identification,
)
from flexmotion.configs.robot import Robot, load_robot


def drawn(robot: Robot, joint: str, rng: np.random.Generator) -> dict[str, float]:
    """Figures of a servo that is not as its catalogue says."""
    servo = robot.servo(joint)
    return {
        "kp": servo.kp * rng.uniform(0.7, 1.3),
        "back_emf": servo.back_emf * rng.uniform(0.7, 1.3),
        "frictionloss": servo.stall_torque * rng.uniform(0.005, 0.03),
        "damping": servo.back_emf * rng.uniform(0.03, 0.25),
        "armature": servo.armature * rng.uniform(0.6, 1.6),
    }


def hide(robot: Robot, joint: str, folder: Path, figures: dict[str, float]) -> Robot:
    """A copy of a robot below `folder`, in which a joint's servo has these figures."""
    place = folder / f"hidden_{joint}"
    shutil.copytree(robot.folder, place)
    (place / robot.file.name).rename(place / "robot.yaml")
    config = robot.joints[robot.index(joint)]
    known = {
        name: IdentifiedFigure(value=value, uncertainty=1e-6, date="2026-01-01", motion="hidden")
        for name, value in figures.items()
    }
    servo = IdentifiedServo(servo=config.servo, id=config.id, figures=known)
    write_identification(place, Identification(joints={joint: servo}))
    return load_robot(place)
