"""`Gait`: a periodic walk of both legs from some thirty numbers, which a learned policy corrects.

Soles move flat along closed paths under a torso that sways; the legs' angles follow by the closed form of
`flexmotion.retarget.legs`. Right and left are mirror images half a cycle apart. The feedback is linear in tilt and
gyroscope. Nothing here knows of dynamics: the numbers are found by a search over whole runs (`gait_search.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.retarget.legs import CHAIN, Leg

Float = NDArray[np.float64]

PHASES = 64
"""Rows of the table of a cycle; angles between them are interpolated."""
SPEEDS = np.arange(0.0, 0.81, 0.1)
"""Speeds of the table [m/s]."""
_HIP_ROLL, _HIP_PITCH, _KNEE, _ANKLE_PITCH, _ANKLE_ROLL = (
    CHAIN.index(name) for name in ("hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
)


@dataclass(frozen=True)
class Gait:
    """The numbers of a gait. Offsets and gains are of the left leg, in the signs of the robot's joints.

    Attributes:
        period: of a cycle of two steps [s].
        swing: share of the cycle that a foot is in the air, below .5.
        lift: of the sole [m].
        skew: exponent of the lift's course; below 1 it is highest early in the swing.
        stride: length of the steps over what the commanded speed asks for.
        sway: of the torso toward the standing foot [m]; sway_phase: how late it is, of a cycle.
        width: half the distance of the feet [m].
        height: hip axes over ankle axes [m].
        lean: pitch of the torso [rad].
        ahead: middle of the soles' path ahead of the hips [m].
        lead: share of the back-EMF of the path's speed that goals make up for.
        arms: swing of the shoulders at .2 m/s [rad].
        hip_roll, hip_pitch, knee, ankle_pitch, ankle_roll: offsets of a loaded leg, against its servos' sag [rad].
        ankle_p, ankle_d, hip_p, hip_d: gains of a loaded leg's pitch joints on pitch, and on its rate [1, s].
        ankle_roll_p, ankle_roll_d, hip_roll_p, hip_roll_d: the same of its roll joints on roll.
        step_p, step_d, aside_p, aside_d: gains of a swinging leg's hip on pitch, and on roll.
    """

    period: float = 0.6
    swing: float = 0.4
    lift: float = 0.025
    skew: float = 1.0
    stride: float = 1.0
    sway: float = 0.02
    sway_phase: float = 0.0
    width: float = 0.05
    height: float = 0.178
    lean: float = 0.08
    ahead: float = -0.01
    lead: float = 0.7
    arms: float = 0.1
    hip_roll: float = 0.04
    hip_pitch: float = 0.0
    knee: float = 0.04
    ankle_pitch: float = 0.0
    ankle_roll: float = 0.0
    ankle_p: float = 0.0
    ankle_d: float = 0.02
    hip_p: float = 0.0
    hip_d: float = 0.0
    ankle_roll_p: float = 0.0
    ankle_roll_d: float = 0.0
    hip_roll_p: float = 0.0
    hip_roll_d: float = 0.0
    step_p: float = 0.0
    step_d: float = 0.0
    aside_p: float = 0.0
    aside_d: float = 0.0

    @classmethod
    def of(cls, numbers: Float) -> Self:
        """The gait of numbers around the default one, in units of `SPREAD`, (30,); within what makes sense."""
        values = dict(zip(NAMES, CENTRE + SPREAD * numbers, strict=True))
        for name, (least, most) in _WITHIN.items():
            values[name] = min(max(values[name], least), most)
        return cls(**{name: float(value) for name, value in values.items()})


NAMES = tuple(own.name for own in fields(Gait))
CENTRE = np.array([getattr(Gait(), name) for name in NAMES])
_SPREADS = {
    "period": 0.08,
    "swing": 0.03,
    "lift": 0.006,
    "skew": 0.15,
    "stride": 0.15,
    "sway": 0.008,
    "sway_phase": 0.04,
    "width": 0.006,
    "height": 0.006,
    "lean": 0.05,
    "ahead": 0.008,
    "lead": 0.25,
    "arms": 0.1,
}
SPREAD = np.array([_SPREADS.get(name, 0.03 if name[-2:] not in ("_p", "_d") else 0.0) for name in NAMES])
SPREAD[[name.endswith("_p") for name in NAMES]] = 0.15
SPREAD[[name.endswith("_d") for name in NAMES]] = 0.025
_WITHIN = {
    "period": (0.3, 1.0),
    "swing": (0.25, 0.48),
    "lift": (0.015, 0.05),
    "skew": (0.5, 2.0),
    "stride": (0.5, 2.0),
    "width": (0.042, 0.075),
    "height": (0.14, 0.2),
    "lead": (0.0, 1.5),
}


class GaitTable:
    """A gait's angles over phase and speed, and its feedback.

    Args:
        robot: with six-axis legs and arms that swing.
        gait: its numbers.

    Attributes:
        legs: joints of the left and the right leg in the order of `CHAIN`, (2, 6).
        shoulders: the joints that swing the arms, (2,).
    """

    def __init__(self, robot: Robot, gait: Gait) -> None:
        self.gait, self._robot = gait, robot
        self._left = Leg.of(robot, "left")
        self.legs = np.stack([self._left.indices, Leg.of(robot, "right").indices])
        self.shoulders = np.array([robot.chain(f"{side}_arm")["sho_pitch"] for side in ("left", "right")])
        phase = np.arange(PHASES) / PHASES
        self._load = load_share(phase, gait.swing)
        self._angles = np.stack([self._leg(phase, float(speed)) for speed in SPEEDS])  # (speeds, phases, 6)

    def at(self, phase: float, speed: float) -> tuple[Float, Float, Float]:
        """Angles (2, 6) [rad], their change a cycle (2, 6) [rad], and the load shares (2,), without feedback."""
        level = min(max(speed / SPEEDS[1], 0.0), len(SPEEDS) - 1.001)
        low = int(level)
        part = level - low
        angles, slopes, loads = np.empty((2, 6)), np.empty((2, 6)), np.empty(2)
        for side in (0, 1):
            place = ((phase + 0.5 * side) % 1.0) * PHASES
            row = int(place)
            between, after = place - row, (row + 1) % PHASES
            row %= PHASES
            first = (1.0 - part) * self._angles[low, row] + part * self._angles[low + 1, row]
            second = (1.0 - part) * self._angles[low, after] + part * self._angles[low + 1, after]
            sign = 1.0 if side == 0 else -1.0
            angles[side] = sign * ((1.0 - between) * first + between * second)
            slopes[side] = sign * PHASES * (second - first)
            loads[side] = (1.0 - between) * self._load[row] + between * self._load[after]
        return angles, slopes, loads

    def feedback(self, loads: Float, tilt: Float, rate: Float) -> Float:
        """Change of the legs' angles, (2, 6) [rad].

        Args:
            loads: share that each leg carries, (2,).
            tilt: roll and pitch [rad]; rate: of them [rad/s].
        """
        gait, change = self.gait, np.zeros((2, 6))
        (roll, pitch), (roll_rate, pitch_rate) = tilt, rate
        for side, sign in ((0, 1.0), (1, -1.0)):
            load, own = loads[side], change[side]
            own[_ANKLE_PITCH] = sign * load * (gait.ankle_p * pitch + gait.ankle_d * pitch_rate)
            own[_HIP_PITCH] = sign * load * (gait.hip_p * pitch + gait.hip_d * pitch_rate)
            own[_HIP_PITCH] += sign * (1.0 - load) * (gait.step_p * pitch + gait.step_d * pitch_rate)
            # Roll changes its sign in the mirror as the joints do.
            own[_ANKLE_ROLL] = load * (gait.ankle_roll_p * roll + gait.ankle_roll_d * roll_rate)
            own[_HIP_ROLL] = load * (gait.hip_roll_p * roll + gait.hip_roll_d * roll_rate)
            own[_HIP_ROLL] += (1.0 - load) * (gait.aside_p * roll + gait.aside_d * roll_rate)
        return change

    def arms(self, phase: float, speed: float) -> Float:
        """Change of the shoulders' pitch, (2,) [rad]: each arm swings with the other side's leg."""
        swing = self.gait.arms * speed / 0.2 * float(np.cos(2 * np.pi * phase))
        return np.array([swing, swing])

    def _leg(self, phase: Float, speed: float) -> Float:
        """Angles of the left leg over a cycle, (T, 6) [rad]."""
        gait, leg = self.gait, self._left
        lifted = phase < gait.swing
        way = gait.stride * speed * gait.period * (1.0 - gait.swing)
        air = np.clip(phase / gait.swing, 0.0, 1.0)
        ground = np.clip((phase - gait.swing) / (1.0 - gait.swing), 0.0, 1.0)
        forth = air * air * (3.0 - 2.0 * air) - 0.5
        sole = np.zeros((len(phase), 3))
        sole[:, 0] = gait.ahead + way * np.where(lifted, forth, 0.5 - ground)
        sole[:, 1] = gait.width
        sole[:, 2] = np.where(lifted, gait.lift * 0.5 * (1.0 - np.cos(2 * np.pi * air**gait.skew)), 0.0)
        torso = np.zeros((len(phase), 3))
        torso[:, 1] = -gait.sway * np.cos(2 * np.pi * (phase - 0.5 * gait.swing - gait.sway_phase))
        torso[:, 2] = gait.height - leg.hip[2] - leg.sole[2]
        cos, sin = np.cos(gait.lean), np.sin(gait.lean)
        leaning = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        upright = np.broadcast_to(np.eye(3), (len(phase), 3, 3))
        # The hips stay where they are: the torso's origin turns about them.
        hip = np.array([leg.hip[0], 0.0, leg.hip[2]])
        torso += hip - leaning @ hip
        angles, _ = leg.solve(torso, np.broadcast_to(leaning, upright.shape), sole, upright)
        offsets = np.zeros(6)
        for joint, value in (
            (_HIP_ROLL, gait.hip_roll),
            (_HIP_PITCH, gait.hip_pitch),
            (_KNEE, gait.knee),
            (_ANKLE_PITCH, gait.ankle_pitch),
            (_ANKLE_ROLL, gait.ankle_roll),
        ):
            offsets[joint] = value
        return np.asarray(angles + self._load[:, None] * offsets)


def load_share(phase: Float, swing: float) -> Float:
    """Share of the weight on the left foot, which is in the air from phase 0 to `swing`, (T,)."""
    rise = np.clip((phase - swing) / (0.5 - swing), 0.0, 1.0)
    fall = np.clip((1.0 - phase) / (0.5 - swing), 0.0, 1.0)
    return np.where(phase < swing, 0.0, np.minimum(rise, fall))
