"""Figures of merit of a run: whether the robot fell, how closely it followed, how hard its servos worked.

Each figure is a pure function of arrays with one row a tick, which can be checked by hand; `motion_figures` and
`joint_loads` apply them to a `RunTrace`. An unknown figure (no ground truth, the human stood still) is None, never 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from flexmotion.configs.robot import Robot
from flexmotion.human.body import Body
from flexmotion.human.motion import Motion
from flexmotion.retarget.whole_body import WholeBody
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.spatial.heading import continuous_heading
from flexmotion.streamer.control.ladder import State
from flexmotion.streamer.control.run_totals import laid_down, toppled
from flexmotion.streamer.control.run_trace import RunTrace

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

FALL_HEIGHT_SHARE = 0.6
"""The robot has fallen if its torso has toppled (`flexmotion/spatial/tilt.py`), or is lower than this share of its
standing height."""
MAX_LAG_S = 0.1
"""Longest delay between reference and measurement that counts as lag instead of error."""
LOADED_SHARE = 0.05
"""A foot carries load when it bears at least this share of the robot's weight."""
STANDS_AGAIN_S = 3.0
"""Time after the source's last frame within which the robot comes to a stand; later it no longer follows [s]."""
MOVING_HUMAN_M = 0.5
"""Shortest straight path of the human for which a ratio of paths is meaningful."""
EPISODE_GAP_S = 0.1
"""Contacts closer together than this are one episode, so that a chattering contact counts once."""


@dataclass(frozen=True)
class HumanTrack:
    """Path of the human, on the source's clock.

    Attributes:
        t: ascending times, (T,) [s].
        pelvis_position: in the world, (T, 3) [m].
        heading: yaw of the pelvis, unwrapped, (T,) [rad].
    """

    t: Float
    pelvis_position: Float
    heading: Float

    @classmethod
    def of(cls, motion: Motion) -> HumanTrack:
        """The path of a whole motion, its first frame at time 0."""
        yaw = continuous_heading(motion.root_quaternion)
        return cls(np.arange(len(motion)) / motion.fps, motion.root_position, yaw)

    def at(self, source_s: Float) -> tuple[Float, Float]:
        """Pelvis position (K, 3) and heading (K,) at the given times (K,), held constant outside the track."""
        position = [np.interp(source_s, self.t, axis) for axis in self.pelvis_position.T]
        return np.stack(position, axis=1), np.interp(source_s, self.t, self.heading)


@dataclass(frozen=True)
class RobotFigures:
    """Properties of the robot that the figures need; joints in the order of the record's columns.

    Attributes:
        legs: columns of the leg joints, (k,).
        standing_height: height of the torso's origin when the robot stands [m].
        weight: mass times gravity [N].
        leg_ratio: leg length of the robot over the human's [1].
        torque_limit: usable torque of each servo, (n,) [N·m].
        stall_torque: stall torque of each servo at nominal voltage, (n,) [N·m].
        speed_limit: no-load speed, (n,) [rad/s].
        arm_length: shoulder to hand [m]; NaN for a robot without arms.
    """

    legs: NDArray[np.int64]
    standing_height: float
    weight: float
    leg_ratio: float
    torque_limit: Float
    stall_torque: Float
    speed_limit: Float
    arm_length: float = float("nan")

    @classmethod
    def of(cls, robot: Robot, human_leg: float | None = None) -> RobotFigures:
        """From the robot's model; `human_leg` is the human's leg length [m], None: the default human's."""
        body = WholeBody(robot)
        data = mujoco.MjData(robot.model)
        data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
        data.qpos[robot.qpos_address] = robot.stand_pose
        mujoco.mj_kinematics(robot.model, data)
        soles = [
            data.xpos[foot] + data.xmat[foot].reshape(3, 3) @ sole
            for foot, sole in zip(robot.foot_ids, robot.soles, strict=True)
        ]
        return cls(
            legs=np.sort(np.concatenate([leg.indices for leg in body.legs])),
            standing_height=-min(float(sole[2]) for sole in soles),
            weight=robot.mass * GRAVITY,
            leg_ratio=body.leg_length / (human_leg or Body().leg),
            torque_limit=robot.usable_torque,
            stall_torque=robot.stall_torque,
            speed_limit=robot.no_load_speed,
            arm_length=float(body.upper.lengths.sum(axis=1).mean()),
        )


@dataclass(frozen=True)
class Displacement:
    """Net displacement in the frame of the first pose. Units are in the names.

    Attributes:
        ahead_m, left_m: along and across the first heading.
        turned_rad: counter-clockwise, whole turns included.
    """

    ahead_m: float
    left_m: float
    turned_rad: float

    @classmethod
    def of(cls, position: Float, heading: Float, scale: float = 1.0) -> Displacement:
        """From positions (T, >= 2) [m], times `scale`, and unwrapped headings (T,) [rad]."""
        (x, y), cos, sin = scale * (position[-1, :2] - position[0, :2]), np.cos(heading[0]), np.sin(heading[0])
        return cls(float(cos * x + sin * y), float(cos * y - sin * x), float(heading[-1] - heading[0]))


@dataclass(frozen=True)
class MotionFigures:
    """How the robot moved. Units are in the names; None where unknown.

    Attributes:
        robot_went: displacement from the source's first frame until the robot stands again; of a robot that was set up
            again, all its ways together.
        human_went: displacement of the human over the part that was followed, scaled to the robot's legs.
        behind_m: how far from there the robot was with the source's last frame: its lag.
        limb_stiffness: mean share of the robot file's stiffness with which arms and head followed.
    """

    fell: bool
    time_to_fall_s: float | None
    joint_rmse_rad: float | None
    lag_s: float | None
    foot_slip_mm_s: float | None
    net_path_ratio: float | None
    robot_went: Displacement | None
    human_went: Displacement | None
    behind_m: float | None
    heading_rms_rad: float | None
    hand_error_share: float | None
    limb_stiffness: float | None
    self_collisions: int | None


@dataclass(frozen=True)
class JointLoad:
    """Load of one joint and its limits."""

    peak_torque_nm: float | None
    rms_torque_nm: float | None
    torque_limit_nm: float
    rms_share_of_stall: float | None
    peak_speed_rad_s: float | None
    speed_limit_rad_s: float
    saturated_share: float | None


def way(base: Float, stands: Mask, off: Mask) -> tuple[Float, Float]:
    """Position (T, 3) [m] and unwrapped heading (T,) [rad] of the torso; NaN while it does not stand.

    A simulated robot whose torque was off is set up again where it began. What it does then goes on where it stood
    last, so that the ways add up.

    Args:
        base: torso position and quaternion w x y z, (T, 7).
        stands: (T,).
        off: ticks without torque, (T,).
    """
    position, heading = np.full((len(base), 3), np.nan), np.full(len(base), np.nan)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int8))).reshape(-1, 2)
    turn, begun, led = 0.0, np.zeros(2), np.zeros(2)  # where it was set up again, and where it stood before
    last: int | None = None
    for begin, end in edges.tolist():
        place, yaw = base[begin:end, :3].copy(), continuous_heading(base[begin:end, 3:])
        if last is not None and off[last:begin].any():
            turn, begun, led = float(heading[last] - yaw[0]), place[0, :2].copy(), position[last, :2].copy()
        elif last is not None:
            yaw += 2.0 * np.pi * np.round((heading[last] - turn - yaw[0]) / (2.0 * np.pi))
        cos, sin = np.cos(turn), np.sin(turn)
        place[:, :2] = led + (place[:, :2] - begun) @ np.array([[cos, sin], [-sin, cos]])
        position[begin:end], heading[begin:end], last = place, yaw + turn, end - 1
    return position, heading


def first_fall(base: Float, planned: Float, standing_height: float, should_stand: Mask) -> int | None:
    """First tick at which the torso is tilted too far or, while it should stand, too low.

    Args:
        base: torso position and quaternion w x y z, (T, 7); NaN rows are ignored.
        planned: as of `toppled`.
        standing_height: of the torso's origin [m].
        should_stand: (T,); False while the robot crouches on purpose (parking).
    """
    low = should_stand & (base[:, 2] < FALL_HEIGHT_SHARE * standing_height)
    fallen = np.flatnonzero(low | toppled(base, planned))
    return int(fallen[0]) if len(fallen) else None


def tracking_error(reference: Float, measured: Float, max_lag: int) -> tuple[float, int] | None:
    """RMS error of all joints together, after removing the common lag that fits best.

    Args:
        reference, measured: (T, k) [rad]; rows with a NaN in either are ignored.
        max_lag: longest lag tried [ticks].

    Returns:
        The error [rad] and the lag of measurement behind reference [ticks]; None with no common row.
    """
    best: tuple[float, int] | None = None
    for lag in range(min(max_lag, len(reference) - 1) + 1):
        error = measured[lag:] - reference[: len(reference) - lag]
        rows = np.isfinite(error).all(axis=1)
        if not rows.any():
            continue
        rmse = float(np.sqrt(np.mean(error[rows] ** 2)))
        if best is None or rmse < best[0]:
            best = rmse, lag
    return best


def foot_slip(velocity: Float, force: Float, weight: float) -> float | None:
    """Mean horizontal speed [m/s] of the feet that carry load, from their velocity and ground force, (T, 2, 3)."""
    speed = np.linalg.norm(velocity[..., :2], axis=-1)
    loaded = np.isfinite(speed) & (force[..., 2] >= LOADED_SHARE * weight)
    return float(speed[loaded].mean()) if loaded.any() else None


def net_path_ratio(robot: Displacement, human: Displacement, leg_ratio: float) -> float | None:
    """How far the robot went in the human's direction, over how far the human went; 0 where it went the other way.

    Args:
        robot, human: displacements, the human's scaled by leg length.
        leg_ratio: leg length of the robot over the human's.
    """
    asked = float(np.hypot(human.ahead_m, human.left_m))
    if asked < MOVING_HUMAN_M * leg_ratio:
        return None
    along = (robot.ahead_m * human.ahead_m + robot.left_m * human.left_m) / asked
    return max(along, 0.0) / asked


def heading_rms(robot: Float, human: Float) -> float:
    """RMS difference [rad] of two unwrapped headings (T,), each counted from its own start."""
    return float(np.sqrt(np.mean(((robot - robot[0]) - (human - human[0])) ** 2)))


def hand_error_share(hand_error: Float, arm_length: float) -> float | None:
    """Median distance (T, 2) [m] of the hands from their targets, over arm length; NaN: out of reach."""
    within = hand_error[np.isfinite(hand_error)]
    return float(np.median(within)) / arm_length if len(within) and arm_length > 0 else None


def limb_stiffness(stiffness: Float, legs: NDArray[np.int64]) -> float | None:
    """Mean of shares (T, n) over the joints that are no legs; None: no goals were sent, or there are no such joints."""
    limbs = np.delete(stiffness, legs, axis=1)
    known = limbs[np.isfinite(limbs)]
    return float(known.mean()) if len(known) else None


def episodes(touching: Mask, gap: int) -> int:
    """Number of runs of True in (T,); runs at most `gap` ticks apart count as one."""
    ticks = np.flatnonzero(touching)
    return int(np.sum(np.diff(ticks) > gap)) + 1 if len(ticks) else 0


def motion_figures(
    record: RunTrace,
    robot: RobotFigures,
    human: HumanTrack | None,
    *,
    should_stand: Mask,
) -> MotionFigures:
    """All figures of a run; robot and human are compared over the ticks whose reference is the human's.

    Args:
        record: the run; its ground truth may be missing (NaN) on hardware.
        human: path of the human; None if unknown.
        should_stand: ticks in which the robot must be on its feet, (used,).
    """
    rows = slice(record.used)
    base, q_ref, q = record.true_base[rows], record.q_ref[rows, robot.legs], record.q[rows, robot.legs]
    known = np.isfinite(base).all(axis=1)
    lies = laid_down(record.state[rows], before=record.totals.laid_down)
    standing = np.where(lies[:, None], np.nan, base)
    fall = first_fall(standing, record.base_ref[rows], robot.standing_height, should_stand)
    upright = np.arange(record.used) < (record.used if fall is None else fall)
    playing = np.isfinite(record.source_s[rows]) & upright

    tracking = tracking_error(np.where(playing[:, None], q_ref, np.nan), q, max_lag=int(MAX_LAG_S * record.rate_hz))
    slip = foot_slip(record.true_foot_velocity[rows][playing], record.true_foot_force[rows][playing], robot.weight)

    path_ratio = heading_error = robot_went = human_went = behind = None
    compared = playing & known & should_stand
    position, heading = way(base, known & upright & should_stand, record.state[rows] == State.OFF)
    if compared.any():
        # The robot's path ends where it comes to a stand, so that it includes the human's last step.
        first, last = np.flatnonzero(compared)[[0, -1]]
        ticks = np.arange(record.used)
        follows = (ticks >= first) & (ticks <= last + STANDS_AGAIN_S * record.rate_hz)
        moving = known & upright & should_stand & follows
        robot_went = Displacement.of(position[moving], heading[moving])
        if human is not None:
            human_position, human_heading = human.at(record.source_s[rows][compared])
            human_went = Displacement.of(human_position, human_heading, robot.leg_ratio)
            until = Displacement.of(position[compared], heading[compared])
            behind = float(np.hypot(human_went.ahead_m - until.ahead_m, human_went.left_m - until.left_m))
            path_ratio = net_path_ratio(robot_went, human_went, robot.leg_ratio)
            heading_error = heading_rms(heading[compared], human_heading)

    return MotionFigures(
        fell=fall is not None,
        time_to_fall_s=None if fall is None else fall / record.rate_hz,
        joint_rmse_rad=None if tracking is None else tracking[0],
        lag_s=None if tracking is None else tracking[1] / record.rate_hz,
        foot_slip_mm_s=None if slip is None else 1e3 * slip,
        net_path_ratio=path_ratio,
        robot_went=robot_went,
        human_went=human_went,
        behind_m=behind,
        heading_rms_rad=heading_error,
        hand_error_share=hand_error_share(record.hand_error[rows][playing], robot.arm_length),
        limb_stiffness=limb_stiffness(record.stiffness[rows][playing], robot.legs),
        self_collisions=(
            episodes(record.true_self_contact[rows], int(EPISODE_GAP_S * record.rate_hz)) if known.any() else None
        ),
    )


def joint_loads(record: RunTrace, robot: RobotFigures) -> dict[str, JointLoad]:
    """Peak and RMS of `RunTrace.torque`, peak speed and saturation of each joint over the ticks with goals sent."""
    sums = record.joint_sums
    with np.errstate(invalid="ignore"):
        rms = np.sqrt(sums.torque_squares / np.where(sums.known > 0, sums.known, np.nan))

    def figure(value: np.floating | float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return {
        name: JointLoad(
            peak_torque_nm=figure(sums.peak_torque[j]),
            rms_torque_nm=figure(rms[j]),
            torque_limit_nm=float(robot.torque_limit[j]),
            rms_share_of_stall=figure(rms[j] / robot.stall_torque[j]),
            peak_speed_rad_s=figure(sums.peak_speed[j]),
            speed_limit_rad_s=float(robot.speed_limit[j]),
            saturated_share=figure(sums.saturated[j] / sums.powered) if sums.known[j] else None,
        )
        for j, name in enumerate(record.joint_names)
    }
