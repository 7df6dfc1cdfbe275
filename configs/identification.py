"""What was measured of a robot's servos, in a file beside the robot file; `flexmotion servo identify` writes it.

Identified figures take precedence over the servo catalogue, and over the joints of the MJCF, in simulation and in the
inversion of the servos alike. A figure that a motion did not determine is not in the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import mujoco
from pydantic import Field

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.robot_file import JointConfig
from flexmotion.configs.schema import Strict, load, store
from flexmotion.configs.servo import Servo, Source

FILE = "identification.yaml"

Figure = Literal["delay", "kp", "back_emf", "frictionloss", "damping", "armature", "torque_constant"]
"""Figures of a joint's servo that a motion shows; names and units as in `flexmotion.configs.servo.Servo`.

`kp` holds for the catalogue's `gain_register`, `back_emf` is the slope of the speed-torque line [N·m·s/rad].
"""

LONGEST_DELAY_S = 0.1
"""A servo that takes longer follows no motion [s]."""

OF_JOINT: tuple[Figure, ...] = ("armature", "frictionloss", "damping")
"""Figures that the joints of an MJCF have too."""


class IdentifiedFigure(Strict):
    """A measured value.

    Attributes:
        value: in the units of `flexmotion.configs.servo.Servo`.
        uncertainty: covers the true value with a probability of 95 %.
        date: of the measurement (ISO 8601).
        motion: that it was measured with.
    """

    value: float = Field(ge=0)
    uncertainty: float = Field(gt=0)
    date: str
    motion: str


class IdentifiedServo(Strict):
    """The servo of one joint, valid for this model and id; its figures by name."""

    servo: str
    id: int
    figures: dict[Figure, IdentifiedFigure]


class Identification(Strict):
    """Identified servos by joint."""

    joints: dict[str, IdentifiedServo]


def read_identification(folder: Path) -> Identification:
    """What is known beside a robot file; empty if nothing. Raises `ConfigError` if the file is malformed."""
    file = folder / FILE
    return load(Identification, file) if file.is_file() else Identification(joints={})


def write_identification(folder: Path, identification: Identification) -> Path:
    """Write it beside the robot file, completely or not at all. Raises `ConfigError` if the file cannot be written."""
    return store(identification, folder / FILE)


def identified(joints: Sequence[JointConfig], servos: Sequence[Servo], folder: Path) -> tuple[Servo, ...]:
    """The servos of joints with their identified figures, in the order of `joints`.

    Raises `ConfigError` if the file names an unknown joint, or was measured with another servo or id.
    """
    known = dict(zip((joint.name for joint in joints), servos, strict=True))
    addresses = {joint.name: (joint.servo, joint.id) for joint in joints}
    for name, measured in read_identification(folder).joints.items():
        if name not in known:
            raise ConfigError(f"{folder / FILE}: field joints: unknown joint {name!r}, identify again")
        if (measured.servo, measured.id) != addresses[name]:
            servo, id_ = addresses[name]
            raise ConfigError(
                f"{folder / FILE}: joint {name!r} was identified with {measured.servo} (id {measured.id}), "
                f"the robot file has {servo} (id {id_}): identify again, or remove the joint from the file"
            )
        try:
            known[name] = _with(known[name], measured)
        except ValueError as error:
            raise ConfigError(f"{folder / FILE}: joint {name!r}: {error}") from error
    return tuple(known.values())


def complete_joints(spec: mujoco.MjSpec, names: Sequence[str], servos: Sequence[Servo]) -> None:
    """Give joints of an MJCF their servo's armature and frictionloss where it says none, or 0, as of a URDF."""
    for name, servo in zip(names, servos, strict=True):
        joint = spec.joint(name)
        if joint is None:
            continue  # the MJCF lacks a joint of the robot file, which is checked
        for figure in ("armature", "frictionloss"):
            if getattr(joint, figure) == 0.0:
                _set(joint, figure, getattr(servo, figure))


def apply_to_joints(spec: mujoco.MjSpec, folder: Path) -> None:
    """Give the joints of an MJCF what was identified of them."""
    for name, measured in read_identification(folder).joints.items():
        joint = spec.joint(name)
        if joint is None:
            continue  # `identified` has refused it, or the MJCF lacks a joint of the robot file, which is checked
        for figure in OF_JOINT:
            if figure in measured.figures:
                _set(joint, figure, measured.figures[figure].value)


def _with(servo: Servo, measured: IdentifiedServo) -> Servo:
    """A servo with identified figures. Raises ValueError if a figure is not possible."""
    figures: dict[str, float] = {name: figure.value for name, figure in measured.figures.items()}
    for name in ("kp", "back_emf", "torque_constant"):
        if figures.get(name, 1.0) <= 0:
            raise ValueError(f"{name} is {figures[name]:g}, expected more than 0")
    if figures.get("delay", 0.0) > LONGEST_DELAY_S:
        raise ValueError(f"delay is {figures['delay']:g} s, expected at most {LONGEST_DELAY_S:g}")
    if "back_emf" in figures:
        # The slope of the line: the stall torque stays that of the catalogue.
        figures["no_load_speed"] = servo.stall_torque / figures.pop("back_emf")
    sources = {
        "no_load_speed" if name == "back_emf" else name: Source(text=f"identified {figure.date}, {figure.motion}")
        for name, figure in measured.figures.items()
    }
    return servo.model_copy(update={**figures, "provenance": servo.provenance | sources})


def _set(joint: mujoco.MjsJoint, figure: str, value: float) -> None:
    before = getattr(joint, figure)
    if isinstance(before, float):
        setattr(joint, figure, value)
    else:
        before[0] = value  # coefficients of a polynomial in MuJoCo 3.5 and later
