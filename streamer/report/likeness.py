"""How much of the human's motion the robot did: the verdict of likeness, beside PASS and FAIL.

A part is judged where the human does it at all: the way, turns, bends, flight, what the arms do. Its share is 1 where
the robot did as much as the human, scaled to its size, and 0 where it did nothing of it. What the robot did less than
half of is left out, by name. The likeness is the mean share of the parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.contacts import ContactDetector
from flexmotion.human.motion import Motion
from flexmotion.retarget.arms import UpperBody
from flexmotion.retarget.human import HumanWindow
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_trace import RunTrace
from flexmotion.streamer.report.directions import (
    angle,
    human_directions,
    pitch,
    robot_directions,
    standing_directions,
    trunk_of,
)
from flexmotion.streamer.report.metrics import LOADED_SHARE, RobotFigures, first_fall

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEFT_OUT = 0.5
"""A part of which the robot did less than this share is left out."""
WAY_M, TURN_RAD, BEND_RAD = 0.5, np.deg2rad(30.0), np.deg2rad(20.0)
"""Least way, turn and range of the trunk's pitch with which a human walks, turns and bends, rather than stands."""
GESTURE_RAD, GESTURE_S = np.deg2rad(30.0), 0.5
"""An arm does something where a segment is further than this from the robot's arm at rest, for this long in all."""
FLIGHT_S, LEAST_FLIGHT_S = 0.1, 0.08
"""Least time of flight in all, and of one flight: shorter ones are a heel that lifts while the other foot lands."""
SAMPLE_S = 0.032
"""Distance of the ticks whose directions are compared [s]: about that of the human's frames."""


@dataclass(frozen=True)
class Likeness:
    """How much of the human's motion the robot did. Units are in the names; None where the part does not occur.

    Attributes:
        score: mean share of the parts, in [0, 1]; 1 where the human does nothing that a robot could leave out.
        parts: share of each part that the human does, in [0, 1]: "path", "turn", "bend", "flight", "hands".
        upper_arm_deg, forearm_deg, trunk_deg: mean angle between the human's segment and the robot's as executed, over
            every sample of the run; `arm_direction_deg`: both arm segments together.
        unreachable_share: share of those samples in which a hand of the human is out of the robot's reach.
        trunk_range: range of the trunk's pitch, robot over human.
        human_turned_deg, human_bend_deg, human_flight_s: what the human does of it.
    """

    score: float
    parts: dict[str, float]
    upper_arm_deg: float | None
    forearm_deg: float | None
    arm_direction_deg: float | None
    trunk_deg: float | None
    unreachable_share: float | None
    trunk_range: float | None
    human_turned_deg: float
    human_bend_deg: float
    human_flight_s: float

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the parts that the robot left out."""
        return tuple(name for name, share in self.parts.items() if share < LEFT_OUT)


def likeness(record: RunTrace, robot: Robot, figures: RobotFigures, motion: Motion) -> Likeness | None:
    """Compare a run with the motion of the human that it followed.

    Args:
        record: the run; compared are the ticks whose reference is the human's, until a fall.
        motion: its frame 0 is at source time 0.

    Returns:
        None where no tick followed the human.
    """
    rows = _compared(record, figures)
    if len(rows) < 2:
        return None
    window = HumanWindow(motion, 0.0, ContactDetector().initial(), None)
    frames = np.clip(np.rint(record.source_s[rows] * motion.fps).astype(int), 0, len(motion) - 1)
    played = slice(int(frames.min()), int(frames.max()) + 1)
    upper = UpperBody(robot)
    human, stand = human_directions(window.kinematics)[frames], standing_directions(robot, upper.chain)
    base = record.true_base[rows]
    made = robot_directions(upper.chain, record.q[rows], trunk_of(base, record.ticks.tilt[rows]))
    measured = np.isfinite(record.q[rows]).all(axis=1)
    errors = np.stack([angle(made.upper_arm, human.upper_arm), angle(made.forearm, human.forearm)])[:, measured]
    away = np.stack([angle(stand.upper_arm, human.upper_arm), angle(stand.forearm, human.forearm)])[:, measured]
    trunk_error = angle(made.trunk, human.trunk)

    parts: dict[str, float] = {}
    way = _way(record, rows, motion, frames, figures.leg_ratio)
    if way is not None:
        parts["path"] = way
    human_yaw = continuous_heading(motion.root_quaternion[frames])
    turned = _most_turned(human_yaw)
    known = np.isfinite(base).all(axis=1)
    if abs(turned) >= TURN_RAD and known.all():
        parts["turn"] = _share(_turned_like(continuous_heading(base[:, 3:]), human_yaw), turned)
    bends = float(np.ptp(pitch(human.trunk)))
    bent = float(np.ptp(pitch(made.trunk)[np.isfinite(made.trunk).all(axis=1)])) if measured.any() else 0.0
    if bends >= BEND_RAD:
        parts["bend"] = min(bent / bends, 1.0)
    aloft: Mask = np.logical_not(window.contacts[played].any(axis=1))
    flight_s = _flight_s(aloft, motion.fps)
    if flight_s >= FLIGHT_S:
        parts["flight"] = min(_robot_flight_s(record, figures) / flight_s, 1.0)
    gestures = (away > GESTURE_RAD).any(axis=0)
    if np.count_nonzero(gestures) * SAMPLE_S >= GESTURE_S:
        parts["hands"] = float(np.clip(1.0 - errors[:, gestures].mean() / away[:, gestures].mean(), 0.0, 1.0))

    reachable = ~upper.straight(upper.targets(window.kinematics))[frames]
    return Likeness(
        score=float(np.mean(list(parts.values()))) if parts else 1.0,
        parts=parts,
        upper_arm_deg=_mean_deg(errors[0]),
        forearm_deg=_mean_deg(errors[1]),
        arm_direction_deg=_mean_deg(errors),
        trunk_deg=_mean_deg(trunk_error),
        unreachable_share=float(np.mean(~reachable)),
        trunk_range=bent / bends if bends >= BEND_RAD else None,
        human_turned_deg=float(np.degrees(turned)),
        human_bend_deg=float(np.degrees(bends)),
        human_flight_s=flight_s,
    )


def _compared(record: RunTrace, figures: RobotFigures) -> NDArray[np.int64]:
    """Ticks to compare, `SAMPLE_S` apart: the reference is the human's, after its time 0 and before a fall."""
    stands = np.isin(record.state, (State.STREAMING, State.HOLD))
    fall = first_fall(record.true_base, record.base_ref, figures.standing_height, stands)
    playing = np.flatnonzero(np.isfinite(record.source_s) & (record.source_s >= 0.0))
    playing = playing if fall is None else playing[playing < fall]
    return playing[:: max(round(SAMPLE_S * record.rate_hz), 1)]


def _way(
    record: RunTrace, rows: NDArray[np.int64], motion: Motion, frames: NDArray[np.int64], ratio: float
) -> float | None:
    """Share of the human's way: furthest place from the start, that of the robot over that of the human.

    The robot's places count as far as they lie in the direction in which the human is at that time, each seen from its
    own first pose: a fall backwards is no part of a way ahead. The direction is that of a human that is at least half
    of its way out; before, it only sways.
    """
    human = _seen_from_start(motion.root_position[frames], motion.root_quaternion[frames])
    away = np.linalg.norm(human, axis=1)
    furthest = float(away.max())
    base = record.true_base[rows]
    if furthest < WAY_M or not np.isfinite(base).all():
        return None
    out = away >= 0.5 * furthest
    along = np.sum(_seen_from_start(base[:, :3], base[:, 3:])[out] * human[out], axis=1) / away[out]
    return _share(float(along.max()), furthest * ratio)


def _seen_from_start(position: Float, quaternion: Float) -> Float:
    """Places ahead of and to the left of the first pose, (T, 2) [m]."""
    yaw = float(continuous_heading(quaternion)[0])
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.asarray((position[:, :2] - position[0, :2]) @ np.array([[cos, -sin], [sin, cos]]))


def _share(done: float, asked: float) -> float:
    """1 where as much was done as asked, 0 where nothing or twice as much, or the opposite, was done."""
    return float(np.clip(1.0 - abs(done - asked) / abs(asked), 0.0, 1.0))


def _most_turned(yaw: Float) -> float:
    """The largest turn away from the first heading, signed [rad]."""
    turned = yaw - yaw[0]
    return float(turned[np.argmax(np.abs(turned))])


def _turned_like(robot: Float, human: Float) -> float:
    """The robot's largest turn in the direction in which the human turned most, signed [rad]."""
    towards = np.sign(_most_turned(human))
    turned = towards * (robot - robot[0])
    return float(towards * turned[np.argmax(np.abs(turned))])


def _flight_s(aloft: Mask, rate_hz: float) -> float:
    """Time in flights of at least `LEAST_FLIGHT_S` [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], aloft, [False]]).astype(np.int8))).reshape(-1, 2)
    lengths = (edges[:, 1] - edges[:, 0]) / rate_hz
    return float(lengths[lengths >= LEAST_FLIGHT_S].sum())


def _robot_flight_s(record: RunTrace, figures: RobotFigures) -> float:
    """Time in which no foot of the robot carried load [s]; on hardware, in which none was planned to."""
    playing = np.isfinite(record.source_s)
    force = record.true_foot_force[playing, :, 2]
    known = np.isfinite(force).all(axis=1)
    loaded = np.where(known[:, None], force >= LOADED_SHARE * figures.weight, record.contact_ref[playing])
    aloft: Mask = np.logical_not(loaded.any(axis=1))
    return _flight_s(aloft, record.rate_hz)


def _mean_deg(errors: Float) -> float | None:
    known = errors[np.isfinite(errors)]
    return float(np.degrees(known.mean())) if len(known) else None
