"""`ImuPlausibility`: samples of the IMU that cannot be are not believed."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from flexmotion.configs.robot import Robot
from flexmotion.drivers.interface import RobotState
from flexmotion.drivers.masks import some
from flexmotion.spatial.gravity import GRAVITY
from flexmotion.streamer.control.believed import Believed, Suspicion

FALL_STEPS = 4.0
"""Change of the angular velocity in a tick, over that of a falling robot, g / h; a larger one needs an impact, which
the accelerometer shows. What turns a robot without one (its weight, friction of the feet, servos) is at most about its
weight, at a lever of its own size: g / h is the measure for robots of every size. OP3 in simulation reaches 1.1 where
it walks, and 2.3 pushed every 1.5 s on a floor with a friction of 0.25. About its upright axis a robot is smaller by
what its radius of gyration is: OP3 by a factor of 2.1."""
IMPACT_TICKS = 3
"""Ticks for which a change of the specific force explains a change of the speed: one of `FALL_STEPS` for each g, and a
part of one for a part of it. In 360 pushes, which felled every second OP3 in simulation, feet that struck made up to
1.9 of `FALL_STEPS` with 0.8 g, and at most 0.97 of what the force explains."""
MOST_ACCEL, ACCEL_STEP = 17.0 * GRAVITY, 5.0 * GRAVITY
"""Greatest specific force, above the range of the usual sensors, and greatest change that is believed at once [m/s²].
The foot of a walking robot strikes with up to 4 g."""
MEAN_S, MEAN_ERROR = 0.5, 0.6 * GRAVITY
"""Over this time [s] the mean specific force is gravity to within this [m/s²], also of a robot that topples over."""

REST_S, REST_TURN, REST_FORCE = 0.3, 0.3, 0.05 * GRAVITY
"""The torso of a robot that lies is at rest where it turns by no more than this [rad/s] and the specific force is
gravity, and that of the beginning of the rest, to within this [m/s²], for this time [s]. In a torso that turns gravity
turns; one that topples with 1.2 rad/s or more, of which a gyro could fall silent unseen, loses a twentieth of it."""


class ImuPlausibility:
    """Checks samples in place; allocates nothing that grows.

    A wrong value is replaced by the one before. If it goes on for more reads than a servo may be silent, the IMU counts
    as silent (`imu_stale`). Nothing of this delays the detection of a fall: a robot that topples over stays within
    these limits, and an impact is believed at once. One that the accelerometer missed, whose peak fell between two
    samples, leaves a gyro that is right and not believed: while the robot lies it is again once the torso is at rest.

    Args:
        suspicion: counts the wrong samples.

    Attributes:
        doubted: something of this sample is not believed.
        restored: with this sample the gyro is believed again, because the torso is at rest.
    """

    def __init__(self, robot: Robot, suspicion: Suspicion) -> None:
        self._suspicion, self._patience = suspicion, robot.safety.max_stale_reads
        self._period = 1.0 / robot.rate_hz
        # A robot that topples over turns with sqrt(3 g / h) as it hits the ground; its joints may add their speed.
        height = robot.gait.stand_hip_height
        turn = 2.0 * (math.sqrt(3 * GRAVITY / height) + float(robot.no_load_speed.max()))
        # By a change of the specific force, (3,) [rad/s by m/s²].
        self._turn_of = FALL_STEPS / height / robot.rate_hz * np.array([1.0, 1.0, _slenderness(robot)])
        self._gyro = Believed(3, np.full(3, -turn), np.full(3, turn), step=GRAVITY * self._turn_of, agreeing=None)
        self._accel = Believed(3, np.full(3, -MOST_ACCEL), np.full(3, MOST_ACCEL), step=ACCEL_STEP)
        # Plain numbers: numpy takes longer for three of them than for all of a robot's joints.
        self._last_accel, self._mean = [math.nan] * 3, [math.nan] * 3
        self._since, self._unread = 0.0, 0
        self._changes = [0.0] * IMPACT_TICKS  # of the specific force, in the last ticks [m/s²]
        self.doubted = self.restored = False
        self._held = False  # whether the last gyro sample was not believed
        self._held_for = np.zeros(3, np.int64)  # ticks for which each axis has not been believed
        self._rest, self._rested = [math.nan] * 3, 0.0  # specific force as the rest began, and its length [s]

    def check(self, state: RobotState, elapsed: float, *, powered: bool = True, lies: bool = False) -> None:
        """Check one sample.

        Args:
            elapsed: time since the check before [s].
            powered: whether torque is on; hands may turn a limp robot as they like, and what was held against its gyro
                ends with the torque.
            lies: the robot lies or gets up: its balance does not depend on the gyro.
        """
        self._since, self.restored = self._since + elapsed, False
        if not powered:
            self._gyro.forget()
            self._accel.forget()
        # Where the sum of squares is a number, all are.
        known = math.isfinite(state.gyro.dot(state.gyro) + state.accel.dot(state.accel))
        if not known and not (np.isfinite(state.gyro).all() and np.isfinite(state.accel).all()):
            state.gyro.fill(0.0)
            if state.imu_stale >= 0:
                self._unread += 1
                state.imu_stale = max(state.imu_stale, self._unread)
            return
        self._unread = 0
        if state.imu_stale != 0:
            return
        # Between samples that are further apart than usual more may change.
        gap, self._since = max(self._since / self._period, 1.0), 0.0
        accel = state.accel.tolist()
        changes = (abs(now - last) for now, last in zip(accel, self._last_accel, strict=True))
        change = max((one for one in changes if not math.isnan(one)), default=0.0)
        self._last_accel = accel
        self._changes = [*self._changes[1:], change]
        if not (lies and self._held):
            self._rested = 0.0
        elif self._rests(state, accel):
            self._gyro.forget()
            self._suspicion.reset()
            self.restored = True
        explained = self._turn_of * max(self._changes)
        if self._held:  # a turn that was there before an impact is not its doing
            explained *= self._held_for < IMPACT_TICKS
        unbelieved = self._gyro.take(state.gyro, gap, explained)
        self._held = wrong = some(unbelieved)
        if wrong:
            self._held_for = np.where(unbelieved, self._held_for + 1, 0)
        elif self._held_for.any():
            self._held_for.fill(0)
        wrong |= some(self._accel.take(state.accel, gap))
        wrong |= self._no_gravity(state, gap)
        self.doubted = wrong
        if not wrong and not self._suspicion.raised:
            return
        self._suspicion.note(np.array([wrong]), np.ones(1, np.bool_))
        level = int(self._suspicion.level[0])
        if level > self._patience:
            state.imu_stale = level

    def _rests(self, state: RobotState, accel: list[float]) -> bool:
        """Whether the torso has been at rest for long; samples that did not come are no rest."""
        still = max(map(abs, state.gyro.tolist())) < REST_TURN and abs(math.hypot(*accel) - GRAVITY) < REST_FORCE
        if still and max(abs(now - then) for now, then in zip(accel, self._rest, strict=True)) < REST_FORCE:
            self._rested += self._period
        else:
            self._rest, self._rested = accel, 0.0
        return self._rested >= REST_S

    def _no_gravity(self, state: RobotState, gap: float) -> bool:
        """Whether the specific force has been far from gravity for long."""
        accel, follows = state.accel.tolist(), 1.0 - math.exp(-gap * self._period / MEAN_S)
        if any(map(math.isnan, self._mean)):
            self._mean = accel
        self._mean = [mean + follows * (now - mean) for now, mean in zip(accel, self._mean, strict=True)]
        return abs(math.hypot(*self._mean) - GRAVITY) > MEAN_ERROR


def _slenderness(robot: Robot) -> float:
    """Radius of gyration of a standing robot about axes about which it topples, over that about its upright one."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[robot.qpos_address] = robot.stand_pose
    mujoco.mj_forward(model, data)
    bodies = np.flatnonzero(model.body_rootid == model.body_rootid[robot.torso_id])
    away = data.xipos[bodies] - data.subtree_com[robot.torso_id]
    axes = data.ximat[bodies].reshape(-1, 3, 3)
    own = np.einsum("kij,kj->ki", axes**2, model.body_inertia[bodies])
    inertia = (own + model.body_mass[bodies, None] * ((away**2).sum(axis=1, keepdims=True) - away**2)).sum(axis=0)
    return max(math.sqrt(min(inertia[:2]) / inertia[2]), 1.0)
