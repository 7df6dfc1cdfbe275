"""From the record of a motion to the figures of a servo: those that the motion determines, and why not the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmotion.configs.errors import DriverError
from flexmotion.configs.identification import Figure, Identification, IdentifiedFigure, IdentifiedServo
from flexmotion.configs.robot import Robot
from flexmotion.configs.servo import Servo
from flexmotion.drivers.identification.fit import EFFORT, Estimate, Fit
from flexmotion.drivers.identification.model import stretches_of
from flexmotion.drivers.identification.record import LEAST_STRETCH_S, RobotRecord

UNITS: dict[Figure, str] = {
    "delay": "s",
    "kp": "N·m/rad",
    "back_emf": "N·m·s/rad",
    "frictionloss": "N·m",
    "damping": "N·m·s/rad",
    "armature": "kg·m²",
    "torque_constant": "N·m/A",
}

MOTION_FOR: dict[Figure, str] = {
    "delay": "goals that change fast show it",
    "kp": "a limb that hangs sideways on the joint shows it: turn the robot on its stand until gravity bends the joint",
    "back_emf": "a fast motion shows it",
    "frictionloss": "slow motion in both directions shows it",
    "damping": "motion at several speeds, with a servo that measures current, shows it",
    "armature": "quick reversals show it",
    "torque_constant": "a limb that hangs sideways on the joint shows it, by its weight",
}
"""What motion determines a figure."""

_SHARE, _FRICTION_SHARE, _FRICTION_FLOOR, _DAMPING_SHARE, _DELAY_S = 0.2, 0.35, 0.003, 0.1, 0.002
"""Greatest uncertainty of a figure that counts as determined: over its value, dry friction over its value or over the
stall torque, viscous friction over the whole drag, delay [s]."""

_ERROR_SHARE, _ERROR_TICKS, _REJECTED_SHARE = 0.12, 4.0, 0.2
"""Greatest error of the simulated angle: over the motion, or in ticks; greatest share of readings left out."""


@dataclass(frozen=True)
class Identified:
    """Result for one joint.

    Attributes:
        joint: its name.
        figures: those that are determined.
        refused: why the others are not.
        estimate: of the fit.
    """

    joint: str
    figures: dict[Figure, IdentifiedFigure]
    refused: dict[Figure, str]
    estimate: Estimate


def identify(robot: Robot, joint: int, record: RobotRecord, date: str) -> Identified:
    """Fit the servo plant to a record.

    Args:
        robot: with the figures known so far, from which the fit begins.
        joint: index.
        date: of the motion (ISO 8601).

    Raises:
        DriverError: the record is too short, the joint was not measured in it, or the plant does not explain it.
    """
    name = robot.joint_names[joint]
    stretches = [each for each in stretches_of(robot, joint, record) if each.compared.any()]
    if not stretches:
        raise DriverError(
            f"joint {name!r}: was not measured with its torque on for {LEAST_STRETCH_S:g} s without a gap: nothing to "
            "identify from"
        )
    _refuse_at_rest(robot, joint, float(np.std(np.concatenate([each.position[each.compared] for each in stretches]))))
    estimate = Fit(robot, joint, stretches).solve()
    _refuse_unexplained(robot, joint, estimate)
    servo, figures, refused = robot.servos[joint], {}, {}
    for figure, (value, uncertainty) in _figures(robot, joint, estimate).items():
        reason = _undetermined(figure, value, uncertainty, servo, estimate.value["back_emf"])
        if reason is None:
            figures[figure] = IdentifiedFigure(
                value=max(value, 0.0), uncertainty=uncertainty, date=date, motion=record.motion
            )
        else:
            refused[figure] = reason
    if EFFORT not in estimate.names:
        refused["torque_constant"] = "the servo measures no current"
        refused["damping"] = "cannot be told from back-EMF, which includes it: the servo measures no current"
    return Identified(name, figures, refused, estimate)


def merged(known: Identification, robot: Robot, found: Identified) -> Identification:
    """What was known of the joints, with the figures that were found; an older back-EMF's viscous friction goes."""
    joint = robot.joints[robot.index(found.joint)]
    before = known.joints.get(found.joint)
    figures = {} if before is None else dict(before.figures)
    if "back_emf" in found.figures:
        figures.pop("damping", None)
    figures |= found.figures
    if not figures:
        return known
    servo = IdentifiedServo(servo=joint.servo, id=joint.id, figures=figures)
    return Identification(joints=known.joints | {found.joint: servo})


def present(servo: Servo, figure: Figure) -> float | None:
    """A figure as it is used so far; None: not known."""
    if figure == "torque_constant":
        return servo.torque_constant or servo.stall_torque / servo.stall_current
    return float(getattr(servo, figure))


def _figures(robot: Robot, joint: int, estimate: Estimate) -> dict[Figure, tuple[float, float]]:
    """Value and uncertainty of each fitted figure, in the units of the catalogue."""
    servo = robot.servos[joint]
    found: dict[Figure, tuple[float, float]] = {}
    per_gain = servo.kp / float(robot.kp[joint])
    for figure in UNITS:
        if figure in estimate.names:
            unit = per_gain if figure == "kp" else 1.0
            found[figure] = (unit * estimate.value[figure], unit * estimate.uncertainty[figure])
    if EFFORT in estimate.names:
        constant = present(servo, "torque_constant") or 0.0
        share, uncertainty = estimate.value[EFFORT], estimate.uncertainty[EFFORT]
        found["torque_constant"] = (constant / share, constant / share**2 * uncertainty)
    return found


def _undetermined(figure: Figure, value: float, uncertainty: float, servo: Servo, back_emf: float) -> str | None:
    """Why a figure is not determined; None if it is. `back_emf`: that was found [N·m·s/rad]."""
    allowed = {
        "delay": _DELAY_S,
        "damping": _DAMPING_SHARE * (back_emf + value),
        "frictionloss": max(_FRICTION_SHARE * value, _FRICTION_FLOOR * servo.stall_torque),
    }.get(figure, _SHARE * value)
    if uncertainty > allowed:
        found = f"{value:.3g} ± {uncertainty:.2g} {UNITS[figure]}"
        return f"not determined by this motion ({found}): {MOTION_FOR[figure]}"
    if value < -uncertainty:
        return f"impossible ({value:.3g} ± {uncertainty:.2g} {UNITS[figure]}): the plant does not describe this joint"
    return None


def _servo_of(robot: Robot, joint: int) -> str:
    """How messages call the servo of a joint."""
    return f"servo of {robot.joints[joint].name} (id {robot.joints[joint].id})"


def _refuse_at_rest(robot: Robot, joint: int, motion: float) -> None:
    """Raise `DriverError` if the joint hardly moved; motion: RMS around its mean [rad]."""
    if motion < 2.0 * float(robot.tick_rad[joint]):
        raise DriverError(f"{_servo_of(robot, joint)}: hardly moved ({motion:.4f} rad RMS): nothing to identify from")


def _refuse_unexplained(robot: Robot, joint: int, estimate: Estimate) -> None:
    """Raise `DriverError` if the servo plant does not explain the motion."""
    _refuse_at_rest(robot, joint, estimate.motion)
    where, tick = _servo_of(robot, joint), float(robot.tick_rad[joint])
    if estimate.rejected > _REJECTED_SHARE * estimate.samples:
        raise DriverError(
            f"{where}: {estimate.rejected} of {estimate.samples} angles fit no motion of a joint: the readings are "
            "false, or something touches the limb"
        )
    if estimate.error > max(_ERROR_SHARE * estimate.motion, _ERROR_TICKS * tick):
        raise DriverError(
            f"{where}: the servo plant does not explain its motion ({estimate.error:.4f} rad RMS of "
            f"{estimate.motion:.3f}): something touches the limb, it carries "
            "what the robot file does not know, or another joint gives way"
        )
